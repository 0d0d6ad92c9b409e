// Series and sparkline: how a figure went over a whole run, in a few columns.
#pragma once

#include <string>
#include <vector>

namespace giga {

/// The values of a figure so far, thinned: each point is the mean of the same number of values, a power of two, so that
/// existing points do not change until their number is halved.
class Series {
 public:
  /// NaN (not known) counts as no value within a mean; before the first value it is left out.
  void add(double value);
  /// The whole series in at most `n` > 0 points; NaN where a point has no value.
  std::vector<double> points(int n) const;

 private:
  struct Sum {
    double sum = 0;
    int count = 0;
    void operator+=(const Sum& other) { sum += other.sum, count += other.count; }
  };
  static void halve(std::vector<Sum>& sums);

  std::vector<Sum> sums_;  // each of values_per_sum_ values, the last one of fewer until it is full
  int values_per_sum_ = 1, values_in_last_ = 0;
};

/// One character per value, by its height between `lowest` and `highest`: U+2581 to U+2588, or in ASCII . : - = + * # @
/// A space for NaN; middle height where lowest = highest.
std::string sparkline(const std::vector<double>& values, double lowest, double highest, bool unicode);
/// Between the smallest and the largest of the values.
std::string sparkline(const std::vector<double>& values, bool unicode);

}  // namespace giga
