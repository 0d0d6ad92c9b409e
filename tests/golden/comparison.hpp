// Comparing one record with the simulator: tolerances, mismatches, worst differences by field.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace giga::golden {

constexpr double kTolerance = 2e-5;            ///< absolute, plus as much relative to the recorded value
constexpr double kAngleTolerance = 6.2832e-5;  ///< 1e-5 * 2 pi
constexpr double kMarginLimit = 2e-5;          ///< below it rounding may decide a comparison differently

/// Largest |difference| seen, by field.
using WorstDifferences = std::map<std::string, double>;

/// Collects what differs between the recording (`want`) and the simulator (`got`).
class Comparison {
 public:
  /// A real number. `agent` and `column` say where it stands (-1 = nowhere special).
  void near(const std::string& field, int agent, int column, double got, double want, double tolerance = kTolerance);
  /// An angle. Whole turns count as equal where `modulo_turn`.
  void angle(const std::string& field, int agent, int column, double got, double want, bool modulo_turn = false);
  /// A flag or a counter.
  void same(const std::string& field, int agent, int column, long got, long want);

  bool passed() const { return n_mismatches_ == 0; }
  long n_mismatches() const { return n_mismatches_; }
  long n_compared() const { return n_compared_; }
  long n_mismatches_of(const std::string& field) const;
  /// The first mismatches, one line each, every line beginning with `prefix`.
  std::string describe(const std::string& prefix) const;
  /// Raises `worst` to what was seen here.
  void merge_into(WorstDifferences& worst) const;

 private:
  void note(const std::string& field, int agent, int column, double got, double want);

  struct Mismatch {
    std::string field;
    int agent, column;
    double got, want;
  };
  std::vector<Mismatch> first_;
  std::map<std::string, long> mismatches_of_;
  WorstDifferences worst_;
  long n_mismatches_ = 0, n_compared_ = 0;
};

/// `name  worst difference` lines.
std::string table_of(const WorstDifferences& worst);

}  // namespace giga::golden
