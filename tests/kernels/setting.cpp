#include "kernels/setting.hpp"

#include <cmath>
#include <utility>

#include "policy/cpu_kernels.hpp"

namespace giga::test {

const std::vector<KernelCase>& observation_cases() {
  static const std::vector<KernelCase> all = {
      {.name = "Shipped", .hidden = {64, 64}, .input = 59, .n = 5, .n_states = 120, .blocks = 2},
      {.name = "MixedTeams", .hidden = {64, 64}, .input = 77, .n = 5, .n_states = 120, .blocks = 2},
      {.name = "MixedTeamsContinuous",
       .hidden = {64, 32},
       .input = 96,
       .n = 10,
       .n_states = 40,
       .blocks = 1,
       .activation = Activation::silu,
       .continuous = true,
       .normalize = true},
      {.name = "IndependentContinuous",
       .hidden = {32, 48},
       .input = 106,
       .n = 3,
       .n_states = 90,
       .blocks = 1,
       .activation = Activation::silu,
       .composed = false,
       .continuous = true,
       .normalize = true},
      {.name = "Wide",
       .hidden = {64, 16},
       .input = 176,
       .n = 20,
       .n_states = 9,
       .blocks = 2,
       .activation = Activation::gelu},
      {.name = "RowsOfCrowds", .hidden = {64, 50}, .input = 135, .n = 20, .n_states = 9, .blocks = 2},
      {.name = "RowsOfCrowdsContinuous",
       .hidden = {64, 64},
       .input = 144,
       .n = 20,
       .n_states = 30,
       .blocks = 1,
       .activation = Activation::silu,
       .continuous = true,
       .normalize = true},
      {.name = "Broad", .hidden = {128, 128}, .input = 59, .n = 5, .n_states = 40, .blocks = 2},
      // Gradients far below the least number of half precision, 6e-8.
      {.name = "SmallValueCoef",
       .hidden = {64, 64},
       .input = 20,
       .n = 5,
       .n_states = 40,
       .blocks = 1,
       .value_coef = 1e-7f},
      {.name = "BroadSmallValueCoef",
       .hidden = {128, 128},
       .input = 59,
       .n = 5,
       .n_states = 40,
       .blocks = 1,
       .value_coef = 1e-7f},
      {.name = "BroadIndependentContinuous",
       .hidden = {100, 72},
       .input = 106,
       .n = 2,
       .n_states = 70,
       .blocks = 1,
       .activation = Activation::silu,
       .composed = false,
       .continuous = true,
       .normalize = true},
      {.name = "BroadWide", .hidden = {72, 128}, .input = 176, .n = 1, .n_states = 70, .blocks = 2},
      // Hidden layers of up to 256: kernels that follow each other.
      {.name = "Broadest", .hidden = {256, 256}, .input = 59, .n = 5, .n_states = 60, .blocks = 3},
      {.name = "BroadestIndependentContinuous",
       .hidden = {130, 200},
       .input = 106,
       .n = 2,
       .n_states = 70,
       .blocks = 1,
       .activation = Activation::silu,
       .composed = false,
       .continuous = true,
       .normalize = true},
      {.name = "BroadestWide",
       .hidden = {64, 129},
       .input = 176,
       .n = 1,
       .n_states = 150,
       .blocks = 2,
       .activation = Activation::relu},
      {.name = "BroadestFewRows", .hidden = {130, 8}, .input = 20, .n = 5, .n_states = 7, .blocks = 3},
      {.name = "BroadestCrowd", .hidden = {256, 1}, .input = 70, .n = 33, .n_states = 4, .blocks = 2},
      {.name = "BroadestMany",
       .hidden = {256, 40},
       .input = 20,
       .n = 20,
       .n_states = 9,
       .blocks = 2,
       .activation = Activation::gelu},
  };
  return all;
}

const std::vector<KernelCase>& state_cases() {
  const auto of = [](const char* name, std::vector<int> hidden, int team, int n, int n_other, int world, int n_states,
                     int blocks, Activation activation) {
    return KernelCase{.name = name,
                      .hidden = std::move(hidden),
                      .input = 12,
                      .n = n,
                      .n_states = n_states,
                      .blocks = blocks,
                      .activation = activation,
                      .world = world,
                      .n_other = n_other,
                      .team = team};
  };
  static const std::vector<KernelCase> all = {
      of("FiveAgainstFive", {64, 64}, 1, 5, 5, 21, 50, 3, Activation::tanh),
      of("OneAgainstTwo", {48, 32}, 0, 1, 2, 5, 37, 2, Activation::silu),
      of("TwentyAgainstOne", {64, 16}, 0, 20, 1, 29, 7, 1, Activation::gelu),
      of("ThreeAgainstTen", {40, 64}, 1, 3, 10, 7, 13, 2, Activation::silu),
      of("Broad", {128, 128}, 0, 5, 5, 21, 30, 2, Activation::tanh),
      of("BroadManyStates", {128, 72}, 1, 2, 2, 21, 150, 1, Activation::silu),
      of("BroadCrowd", {72, 128}, 1, 64, 64, 47, 3, 2, Activation::tanh),
  };
  return all;
}

Setting::Setting(const KernelCase& of) : c(of), stride(of.input + 7) {
  if (c.world > 0)
    state = {
        .first_own = c.team * c.n_other, .first_other = (1 - c.team) * c.n, .n_other = c.n_other, .world = c.world};
  actor = network(c.continuous ? kActionSize : kLogitStride, false, actor_values);
  critic = network(1, c.composed && c.world == 0, critic_values);
  const int64_t rows = int64_t{3} * c.n_states * c.n;
  obs = normal(rows * stride, 1);
  obs_mean = normal(c.input, 0.2f);
  for (int k = 0; k < c.input; ++k) obs_std.push_back(0.5f + 0.01f * static_cast<float>(dice() % 100));
  old_log_prob = normal(rows, 0.3f);
  for (float& x : old_log_prob) x -= 3;
  pre_tanh_action = normal(rows * kActionSize, 1);
  advantage = normal(rows, 2);
  old_value = normal(rows, 0.3f);
  returns = normal(rows, 2);
  for (int64_t k = 0; k < rows; ++k) {
    action.push_back(static_cast<int32_t>(dice() % kNDiscreteActions));
    alive.push_back(k >= c.n && dice() % 4 != 0);  // in the first state nobody lives
  }
  if (c.world > 0) fill_true_state();
  for (int64_t k = c.n_states - 1; k >= 0; --k) states.push_back(3 * k);
  moments.resize(kMomentParts * kMoments);
  run_moments(this->rows(), {c.n_states, 1}, advantage.data(), moments.data());
}

std::vector<float> Setting::normal(int64_t count, float deviation) {
  std::normal_distribution<float> draw(0, deviation);
  std::vector<float> x(static_cast<size_t>(count));
  for (float& y : x) y = draw(dice);
  return x;
}

FusedMlp Setting::network(int output, bool composed, std::vector<float>& values) {
  FusedMlp net;
  if (output == 1) net.state = state;
  net.n_layers = FusedMlp::kLayers;
  net.activation = c.activation;
  const int width[] = {c.input, c.hidden[0], c.hidden[1], output};
  const auto place = [&](int count, float deviation) {
    const auto at = static_cast<int>(values.size());
    for (const float x : normal(count, deviation)) values.push_back(x);
    return at;
  };
  net.width[0] = c.input;
  for (int k = 0; k < net.n_layers; ++k) {
    net.width[k + 1] = width[k + 1];
    const float size = 1 / std::sqrt(static_cast<float>(width[k]));
    net.weight[k] = place(inputs_of(net, k) * width[k + 1], size);
    net.bias[k] = place(width[k + 1], 0.2f);
    if (composed && k > 0) net.team_weight[k] = place(width[k] * width[k + 1], size);
  }
  net.log_std = place(kActionSize, 0.2f);
  net.size = static_cast<int64_t>(values.size());
  return net;
}

/// The numbers of the dead are 0; the first one of the living is 1. In every seventh state none of the others lives.
void Setting::fill_true_state() {
  for (int s = 0; s < 3 * c.n_states; ++s) {
    for (int i = 0; i < c.n + c.n_other; ++i) {
      const int own = i - state.first_own;
      const bool lives =
          own >= 0 && own < c.n ? alive[static_cast<size_t>(s * c.n + own)] != 0 : s % 7 != 3 && dice() % 4 != 0;
      std::vector<float> numbers = normal(c.input, 1);
      numbers[0] = 1;
      for (const float x : numbers) true_state.push_back(lives ? x : 0.0f);
    }
    for (const float x : normal(c.world, 1)) true_state.push_back(x);
  }
}

FusedRows Setting::rows() const {
  FusedRows rows{.states = states.data(),
                 .n_states = c.n_states,
                 .n = c.n,
                 .obs = obs.data(),
                 .obs_stride = stride,
                 .alive = alive.data()};
  if (c.normalize) {
    rows.obs_mean = obs_mean.data();
    rows.obs_std = obs_std.data();
    rows.obs_limit = 10;
  }
  return rows;
}

FusedActor Setting::actor_pass() const {
  return {.net = actor,
          .parameters = actor_values.data(),
          .rows = rows(),
          .loss = {.old_log_prob = old_log_prob.data(),
                   .advantage = advantage.data(),
                   .action = c.continuous ? nullptr : action.data(),
                   .pre_tanh_action = pre_tanh_action.data(),
                   .entropy_coef = &entropy_coef,
                   .clip_coef = &clip_coef},
          .moments = moments.data()};
}

FusedCritic Setting::critic_pass() const {
  FusedRows seen = rows();
  if (c.world > 0) {
    seen.obs = true_state.data();
    seen.obs_stride = (c.n + c.n_other) * c.input + c.world;
  }
  return {.net = critic,
          .parameters = critic_values.data(),
          .rows = seen,
          .loss = {.old_value = old_value.data(),
                   .returns = returns.data(),
                   .value_mean = &value_mean,
                   .value_std = &value_std,
                   .value_coef = c.value_coef,
                   .error = {0.3f, 0}},
          .moments = moments.data()};
}

}  // namespace giga::test
