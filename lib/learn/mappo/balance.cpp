#include "learn/mappo/balance.hpp"

#include <algorithm>
#include <cmath>

#include "core/error.hpp"

namespace giga {
namespace {

/// How far the weight of the entropy bonus may go from what is configured: below, it no longer acts; above, it drowns
/// the advantages, which have deviation 1.
constexpr double kLeastEntropyShare = 0.01, kMostEntropyShare = 10;
/// Share of the old mean that an update keeps: about ten updates count.
constexpr double kLeadMemory = 0.9;
constexpr const char* kEntropyCoef = "entropy_coef";

double figure(const Metrics& figures, const std::string& name) {
  const auto found = std::find_if(figures.begin(), figures.end(), [&](const auto& f) { return f.first == name; });
  return found == figures.end() ? std::nan("") : found->second;
}

}  // namespace

Balance::Balance(const MappoConfig& config) : config_(config) {
  entropy_coef_.fill(static_cast<double>(config.entropy_coef));
}

double Balance::faded_to(float last, double done) const {
  const double from = static_cast<double>(config_.shaping_fade_start),
               to = static_cast<double>(config_.shaping_fade_end);
  const double faded = to > from ? std::clamp((done - from) / (to - from), 0.0, 1.0) : done >= to ? 1.0 : 0.0;
  return 1 + (static_cast<double>(last) - 1) * faded;
}

double Balance::shaping_factor(RewardTerm term, double done) const {
  if (term == RewardTerm::game_won) return 1;
  return faded_to(config_.shaping_final_factors[term].value_or(config_.shaping_final_factor), done);
}

float Balance::on_the_way(float first, const std::optional<float>& last, double done) {
  if (!last) return first;
  const auto from = static_cast<double>(first);
  return static_cast<float>(from + (static_cast<double>(*last) - from) * std::clamp(done, 0.0, 1.0));
}

bool Balance::is_frozen(int team) const {
  if (!config_.freeze_lead) return false;
  return (team == 0 ? lead_ : -lead_) > static_cast<double>(*config_.freeze_lead);
}

void Balance::add_metrics(double done, Metrics& out) const {
  if (shaping_fades()) out.emplace_back("shaping_factor", shaping_factor(done));
  for (int t = 0; t < kNRewardTerms; ++t)
    if (const auto term = static_cast<RewardTerm>(t); config_.shaping_final_factors[term])
      out.emplace_back(cat("shaping_factor_", kRewardTermNames[t]), shaping_factor(term, done));
  if (config_.final_gamma) out.emplace_back("gamma", gamma(done));
  if (config_.final_clip_coef) out.emplace_back("clip_coef", clip_coef(done));
  if (config_.final_entropy_coef) out.emplace_back("entropy_coef", entropy_coef(0, done));
  for (int team = 0; team < kNTeams; ++team) {
    if (config_.entropy_target) out.emplace_back(cat("entropy_coef_", team), entropy_coef_[static_cast<size_t>(team)]);
    if (config_.freeze_lead) out.emplace_back(cat("frozen_", team), is_frozen(team) ? 1 : 0);
  }
}

void Balance::note(const Metrics& figures) {
  for (size_t team = 0; config_.entropy_target && team < kNTeams; ++team) {
    const double entropy = figure(figures, cat("entropy_", team));
    if (!std::isfinite(entropy) || is_frozen(static_cast<int>(team))) continue;  // a team that rests cannot follow
    // The logarithm moves, so that the weight stays positive and moves by shares of itself, as the temperature of soft
    // actor-critic does (Haarnoja et al. 2018, arXiv 1812.05905, section 5).
    const double missing = static_cast<double>(*config_.entropy_target) - entropy;
    const double coef = entropy_coef_[team] * std::exp(static_cast<double>(config_.entropy_rate) * missing);
    const auto usual = static_cast<double>(config_.entropy_coef);
    entropy_coef_[team] = std::clamp(coef, kLeastEntropyShare * usual, kMostEntropyShare * usual);
  }
  const double lead = figure(figures, "win_rate_0") - figure(figures, "win_rate_1");
  if (config_.freeze_lead && std::isfinite(lead)) lead_ = kLeadMemory * lead_ + (1 - kLeadMemory) * lead;
}

void Balance::save_team(int team, NamedArrays& out) const {
  if (config_.entropy_target)
    out.push_back(make_array<double>(kEntropyCoef, {entropy_coef_[static_cast<size_t>(team)]}));
}

void Balance::load_team(int team, const NamedArrays& in) {
  const NamedArray* const saved = config_.entropy_target ? look_for_array(in, kEntropyCoef) : nullptr;
  if (saved) entropy_coef_[static_cast<size_t>(team)] = array_values<double>(*saved).at(0);
}

void Balance::save(const std::string& prefix, NamedArrays& out) const {
  if (config_.entropy_target)
    out.push_back(make_array<double>(prefix + kEntropyCoef, {entropy_coef_[0], entropy_coef_[1]}));
  if (config_.freeze_lead) out.push_back(make_array<double>(prefix + "lead", {lead_}));
}

void Balance::load(const std::string& prefix, const NamedArrays& in) {
  if (config_.entropy_target) {
    const std::vector<double> coefs = array_values<double>(find_array(in, prefix + kEntropyCoef));
    if (coefs.size() != kNTeams)
      throw InputError(cat("array '", prefix, "entropy_coef' has ", coefs.size(), " numbers"));
    std::copy(coefs.begin(), coefs.end(), entropy_coef_.begin());
  }
  if (config_.freeze_lead) lead_ = array_values<double>(find_array(in, prefix + "lead")).at(0);
}

}  // namespace giga
