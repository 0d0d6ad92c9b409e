// Hyper-parameters: what a run was told, as a flat list of names and values.
#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "config/document.hpp"

namespace giga {

using HyperParameter = std::variant<double, bool, std::string>;
using HyperParameters = std::vector<std::pair<std::string, HyperParameter>>;

/// The keys of a resolved run config by their paths, in its order: "train.n_worlds" = 4096.0. A finite
/// number is a double; `true` and `false` are bool. `none` and infinite numbers stay text. A list is its text on one
/// line: "[64, 64]". An empty map is left out.
HyperParameters flat_hyper_parameters(const Node& root);

}  // namespace giga
