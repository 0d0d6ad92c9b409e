// Writing of run folders made by hand.
#include "synthetic_run.hpp"

#include <fstream>
#include <sstream>

namespace giga::test {

void SyntheticRun::write(const std::filesystem::path& folder) const {
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "config.yaml", std::ios::binary) << config;
  std::ofstream(folder / "scenario.yaml", std::ios::binary) << scenario;
  std::ofstream(folder / "run.json", std::ios::binary) << info;
  std::ofstream(folder / "metrics.csv", std::ios::binary) << metrics;
}

std::string config_with(int seed, const std::string& gamma) {
  std::ostringstream text;
  text << "scenario: duel\nseed: " << seed
       << "\ndevice: auto\ntrain: {total_agent_steps: 120000}\nmappo: {gamma: " << gamma << "}\neval: {episodes: 64}\n";
  return text.str();
}

std::string metrics_of_a_run(double offset) {
  std::ostringstream text;
  text << "update,agent_steps,seconds,update_seconds,evaluation_seconds,checkpoint_seconds,agent_steps_per_second,"
          "episode_length,win_rate_0,win_rate_1,tie_rate,return_0,return_1,score_0,score_1,policy_loss_0,value_loss_"
          "0,"
          "entropy_0,entropy_1,approx_kl_0,explained_variance_0,first_ratio_error_0,mutual_information_0,reward_damage_"
          "0,"
          "reward_game_won_0,reward_idle_0,win_rate_0_vs_circle,win_rate_1_vs_circle\r\n";
  for (int k = 1; k <= 120; ++k) {
    const double part = k / 120.0;
    text << k << ',' << 1000 * k << ',' << 0.5 * k << ",0.4," << (k % 10 ? 0.0 : 0.5) << ",0,2500," << 300 - k << ','
         << 0.5 + 0.2 * part << ',' << 0.4 - 0.2 * part << ",0.1," << 10 + k * 0.1 + offset << ','
         << 12 - k * 0.05 + offset << ",0,0," << -0.01 * (1 - part) << ',' << 1 - 0.5 * part << ','
         << 3 - k * 0.02 + offset << ',' << 3 - k * 0.015 << ',' << 0.01 * (1 - part) << ',' << part * 0.8 << ",0,"
         << part << ',' << 5 * part << ',' << 2 * part << ",0,";
    if (k % 10 == 0) text << offset + 0.005 * k << ',' << offset + 0.004 * k;
    if (k % 10 != 0) text << ',';
    text << "\r\n";
  }
  return text.str();
}

}  // namespace giga::test
