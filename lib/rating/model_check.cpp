// Sentences and JSON about the fit and its cyclic rest.
#include "rating/model_check.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr double kSmallestTold = 1e-4;  // p below it says no more

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::vector<std::string> cycle_names(const Ratings& ratings, const PlayerCycle& cycle) {
  std::vector<std::string> names;
  for (const int k : cycle.players) names.push_back(ratings.name(ratings.list[static_cast<size_t>(k)]));
  return names;
}

Estimate cycle_sum(const PlayerCycle& cycle) { return {cycle.sum(), cycle.standard_error}; }

std::string cycle_text(const Ratings& ratings, const PlayerCycle& cycle) {
  const std::vector<std::string> names = cycle_names(ratings, cycle);
  const auto& links = cycle.log_odds;
  const Estimate sum = cycle_sum(cycle);
  return cat("strongest cycle: ", names[0], " > ", names[1], " > ", names[2], " > ", names[0], ", log-odds ",
             formatted("%.2f", links[0]), " + ", formatted("%.2f", links[1]), " + ", formatted("%.2f", links[2]), " = ",
             formatted("%.2f", sum.value), " +- ", formatted("%.2f", sum.high() - sum.value));
}

}  // namespace

std::string fit_line(const GoodnessOfFit& fit) {
  if (fit.degrees_of_freedom <= 0) return "Fit: no more pairs than ratings need; there is nothing to test.";
  const double p = fit.p_value();
  std::string line = cat("Fit: deviance ", formatted("%.1f", fit.deviance), " on ", fit.degrees_of_freedom,
                         fit.degrees_of_freedom == 1 ? " degree" : " degrees", " of freedom, p ",
                         p < kSmallestTold ? "< " + formatted("%g", kSmallestTold) : "= " + formatted("%.2g", p));
  if (fit.n_sparse > 0)
    line += cat("; rough: in ", fit.n_sparse, " of ", fit.n_pairs, " pairs one can expect less than 5 points");
  return line + ".";
}

std::string intransitivity_line(const Ratings& ratings) {
  const Intransitivity& rest = ratings.intransitivity;
  if (std::isnan(rest.share)) return "Intransitive: nothing, all pairs are even.";
  std::string line =
      cat("Intransitive: ", formatted("%.1f", 100 * rest.share), " % of the squared log-odds (",
          rest.share_by_chance < 1 ? cat("by chance ", formatted("%.1f", 100 * rest.share_by_chance), " %")
                                   : std::string("chance alone explains all of them: too few games to tell"),
          ")");
  if (rest.strongest) return cat(line, "; ", cycle_text(ratings, *rest.strongest), ".");
  return line + (ratings.sides == Sides::alike ? "; no three beat each other in a cycle." : ".");
}

Json fit_json(const GoodnessOfFit& fit) {
  return {{"deviance", fit.deviance},
          {"degrees_of_freedom", fit.degrees_of_freedom},
          {"p_value", fit.p_value()},
          {"pairs", fit.n_pairs},
          {"sparse_pairs", fit.n_sparse}};
}

Json intransitivity_json(const Ratings& ratings) {
  const Intransitivity& rest = ratings.intransitivity;
  Json cycle;
  if (rest.strongest) {
    const Estimate sum = cycle_sum(*rest.strongest);
    cycle = {{"players", cycle_names(ratings, *rest.strongest)},
             {"log_odds", rest.strongest->log_odds},
             {"sum", sum.value},
             {"standard_error", sum.standard_error},
             {"ci95", {sum.low(), sum.high()}}};
  }
  return {{"share", rest.share},
          {"share_by_chance", rest.share_by_chance},
          {"pairs", rest.n_pairs},
          {"strongest_cycle", std::move(cycle)}};
}

}  // namespace giga
