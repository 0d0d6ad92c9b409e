// A config as a flat list.
#include "io/hyper_parameters.hpp"

#include <gtest/gtest.h>

namespace giga::test {
namespace {

TEST(HyperParameters, PathsAndKindsOfValues) {
  const Document config = parse_yaml_text(R"(seed: 7
scenario: maps/duel.yaml
train:
  n_worlds: 4_096
  desynchronize: true
  opponent: none
mappo:
  learning_rate: 3e-4
  actor: {hidden: [64, 32], precision: "16"}
environment: {}
limit: .inf
nothing:
)",
                                          "f.yaml");
  const HyperParameters expected = {{"seed", 7.0},
                                    {"scenario", "maps/duel.yaml"},
                                    {"train.n_worlds", 4096.0},
                                    {"train.desynchronize", true},
                                    {"train.opponent", "none"},
                                    {"mappo.learning_rate", 0.0003},
                                    {"mappo.actor.hidden", "[64, 32]"},
                                    {"mappo.actor.precision", "16"},  // in quotes: a text
                                    {"limit", ".inf"},                // TensorBoard's JSON has no infinity
                                    {"nothing", "null"}};
  EXPECT_EQ(flat_hyper_parameters(config.root), expected);
}

}  // namespace
}  // namespace giga::test
