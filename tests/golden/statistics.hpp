// Comparing samples of our simulator with recorded statistics of the original.
//
// The tests: means by a z test with pooled variance; standard deviations by a z test with the variance of the sample
// variance estimated from our sample (fourth moment); counts by Fisher's exact test. Several hundred cells are tested
// with |z| < 4.5 (a p-value of 6.8e-6), so that the chance of a false alarm over 600 cells is below 0.5 % (Bonferroni).
// Our seeds are fixed: the result is the same every time.
#pragma once

#include <string>
#include <vector>

namespace giga::golden {

constexpr double kMaxZ = 4.5;

struct Sample {
  double n = 0, mean = 0, std = 0, fourth = 0;  ///< fourth central moment; unknown (0) for recordings
  double min = 0, max = 0;

  static Sample of(const std::vector<double>& values);
};

/// z of the difference of two means. Infinite where neither side varies and the means differ by more than 1e-4.
double z_of_means(const Sample& a, const Sample& b);
/// z of the difference of two standard deviations; both populations are taken to be like `ours`.
double z_of_deviations(const Sample& ours, const Sample& recorded);
/// Fisher's exact test, two-sided, of k of n against k of n, as |z|: the normal deviate with the same p-value.
double z_of_counts(double k1, double n1, double k2, double n2);

/// Collects cells and fails the test at those beyond kMaxZ.
class CellReport {
 public:
  explicit CellReport(std::string what) : what_(std::move(what)) {}
  void cell(const std::string& name, double z, double ours, double recorded);
  long n_cells() const { return n_cells_; }
  /// One line: cells, the largest |z| and where.
  void print() const;

 private:
  std::string what_, worst_name_;
  long n_cells_ = 0;
  double worst_ = 0;
};

}  // namespace giga::golden
