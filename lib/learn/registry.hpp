// The only list of algorithms. A new one is a folder with its settings, checks, resume rules and learner, and a row
// here.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "config/settings.hpp"
#include "learn/evolution/config.hpp"
#include "learn/mappo/config.hpp"

namespace giga {

using Algorithms = AlgorithmList<MappoAlgorithm, OpenAiEsAlgorithm, SnesAlgorithm, DesAlgorithm>;

/// All of them, in the order of the list.
const std::vector<const Algorithm*>& algorithms();
std::vector<std::string> algorithm_names();

/// The one of that name; null where there is none.
const Algorithm* find_algorithm(const std::string& name);
/// Whether a setting of a run means something to the algorithm of that name.
bool reads_setting(const std::string& algorithm, std::string_view key);
/// Whether a setting of a run has no part in what is learned: two runs that differ in such alone, the seed among them,
/// are of one configuration.
bool is_run_time_setting(std::string_view key);
/// The settings of a scenario but descriptions, which are for people.
Settings game_settings(const Node& scenario, std::string (*print)(const Node&) = print_node);
/// The one that `train.algorithm` names. Throws InputError where there is none.
const Algorithm& algorithm_of(const RunConfig& config);

}  // namespace giga
