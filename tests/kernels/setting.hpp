// What the tests of kernels as PTX share: cases, each with networks and a rollout as plain arrays.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <ostream>
#include <random>
#include <vector>

#include "cuda/ppo_gradients.hpp"

namespace giga::test {

constexpr size_t kSharedBytes = 227 * 1024;  // the most that a block may have
// Factors of products are rounded to half precision, by up to 2^-11 = 0.0005 each, in five products one after the
// other.
constexpr double kRounding = 0.004;
// The derivative of relu jumps: rounding switches some units on or off.
constexpr double kJumps = 0.02;

/// Memory of a kernel, with a poison that no kernel computes, and more of it behind the end.
template <class T>
class Guarded {
 public:
  explicit Guarded(int64_t size) : words_(static_cast<size_t>(size) + kGuard, kPoison) {
    static_assert(sizeof(T) == 4);
  }
  T* data() { return reinterpret_cast<T*>(words_.data()); }
  /// Whether nobody has written behind the end.
  bool intact() const { return std::count(words_.end() - kGuard, words_.end(), kPoison) == kGuard; }
  std::vector<T> numbers() const {
    const T* first = reinterpret_cast<const T*>(words_.data());
    return {first, first + words_.size() - kGuard};
  }
  /// A float that nobody has written is a NaN, and so are halves.
  static constexpr uint32_t kPoison = 0xFFFFFFFF;

 private:
  static constexpr std::ptrdiff_t kGuard = 64;
  std::vector<uint32_t> words_;
};

struct KernelCase {
  const char* name;
  std::vector<int> hidden;
  int input, n;          // numbers that the networks read; agents of the team
  int n_states, blocks;  // that are learned from; that share them
  Activation activation = Activation::tanh;
  bool composed = true, continuous = false, normalize = false;
  // Critics of the true state: numbers of the world, agents of the other team, the own one.
  int world = 0, n_other = 0, team = 0;
  float value_coef = 0.5f;
};
inline void PrintTo(const KernelCase& c, std::ostream* out) { *out << c.name; }

/// They cover sizes of layers, inputs and teams, kinds of actions and critics, and activations.
const std::vector<KernelCase>& observation_cases();
/// Critics of the true state.
const std::vector<KernelCase>& state_cases();

/// Networks of a case and a rollout, of which every third state is learned from.
struct Setting {
  const KernelCase c;
  const int64_t stride;  // numbers of a row of observations
  std::mt19937 dice{1};
  FusedState state;
  FusedMlp actor, critic;
  std::vector<float> actor_values, critic_values;
  std::vector<float> true_state;  // [states, numbers of a state]
  std::vector<float> obs, obs_mean, obs_std;
  std::vector<float> old_log_prob, advantage, pre_tanh_action, old_value, returns;
  std::vector<int32_t> action;
  std::vector<uint8_t> alive;
  std::vector<int64_t> states;
  std::vector<double> moments;
  float value_mean = 4, value_std = 2, entropy_coef = 0.05f, clip_coef = 10;

  explicit Setting(const KernelCase& of);
  int64_t n_rows() const { return static_cast<int64_t>(alive.size()); }
  FusedRows rows() const;
  FusedActor actor_pass() const;
  FusedCritic critic_pass() const;
  /// Numbers that layer k reads.
  static int inputs_of(const FusedMlp& net, int k) {
    return k == 1 && net.reads_state() ? net.state.inputs(net.width[1]) : net.width[k];
  }

 private:
  std::vector<float> normal(int64_t count, float deviation);
  FusedMlp network(int output, bool composed, std::vector<float>& values);
  void fill_true_state();
};

}  // namespace giga::test
