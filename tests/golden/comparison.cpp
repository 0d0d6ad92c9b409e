// Tolerances and messages of record comparisons.
#include "golden/comparison.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

namespace giga::golden {
namespace {

constexpr size_t kShownPerRecord = 4;
constexpr double kTurn = 6.283185307179586;

}  // namespace

void Comparison::note(const std::string& field, int agent, int column, double got, double want) {
  ++n_mismatches_;
  ++mismatches_of_[field];
  if (first_.size() < kShownPerRecord) first_.push_back({field, agent, column, got, want});
}

void Comparison::near(const std::string& field, int agent, int column, double got, double want, double tolerance) {
  ++n_compared_;
  const double difference = std::abs(got - want);
  double& worst = worst_[field];
  worst = std::max(worst, difference);
  if (!(difference <= tolerance + kTolerance * std::abs(want))) note(field, agent, column, got, want);  // NaN fails too
}

void Comparison::angle(const std::string& field, int agent, int column, double got, double want, bool modulo_turn) {
  if (modulo_turn) got -= kTurn * std::round((got - want) / kTurn);
  near(field, agent, column, got, want, kAngleTolerance);
}

void Comparison::same(const std::string& field, int agent, int column, long got, long want) {
  ++n_compared_;
  double& worst = worst_[field];
  worst = std::max(worst, std::abs(static_cast<double>(got - want)));
  if (got != want) note(field, agent, column, static_cast<double>(got), static_cast<double>(want));
}

long Comparison::n_mismatches_of(const std::string& field) const {
  const auto found = mismatches_of_.find(field);
  return found == mismatches_of_.end() ? 0 : found->second;
}

std::string Comparison::describe(const std::string& prefix) const {
  std::ostringstream out;
  out.precision(9);
  for (const Mismatch& m : first_) {
    out << prefix;
    if (m.agent >= 0) out << " agent " << m.agent;
    out << " " << m.field;
    if (m.column >= 0) out << "[" << m.column << "]";
    out << ": simulator " << m.got << ", recorded " << m.want << "\n";
  }
  if (n_mismatches_ > static_cast<long>(first_.size()))
    out << prefix << " ... " << n_mismatches_ << " differences in all\n";
  return out.str();
}

void Comparison::merge_into(WorstDifferences& worst) const {
  for (const auto& [field, difference] : worst_) {
    double& total = worst[field];
    total = std::max(total, difference);
  }
}

std::string table_of(const WorstDifferences& worst) {
  std::string table;
  for (const auto& [field, difference] : worst) {
    char line[96];
    std::snprintf(line, sizeof line, "  %-28s %.3g\n", field.c_str(), difference);
    table += line;
  }
  return table;
}

}  // namespace giga::golden
