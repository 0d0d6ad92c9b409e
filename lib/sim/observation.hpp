// What can be observed, by name: a table row for each kind stands in sim/observations.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

/// The kinds of observations, in the order of the table.
enum class Observation : uint8_t {
  vector,        ///< of an agent: the original's row of numbers (sim/vector_observation.hpp)
  egocentric,    ///< of an agent: what is around it along its own heading (sim/egocentric_view.hpp)
  state,         ///< of a world: its true state, for critics (sim/state_observation.hpp)
  image,         ///< of an agent: the ego image (sim/ego_image.hpp)
  global_image,  ///< of a world: the image with all agents (sim/global_image.hpp)
  image_state,   ///< of a world: what its ego images are drawn from (sim/image_state.hpp)
};
constexpr int kNObservations = 6;

/// Images, and what they are drawn from, are written by a job of their own (Job::draw), from the state alone; the other
/// observations are written by the step.
constexpr bool is_drawn(Observation kind) { return kind >= Observation::image; }

/// What the elements of an observation are.
enum class ElementType : uint8_t { f32, i32, u8, bf16 };
constexpr int size_of(ElementType type) { return type == ElementType::u8 ? 1 : type == ElementType::bf16 ? 2 : 4; }

/// Whose an observation is: each agent has one, or each world.
enum class ObservationOf : uint8_t { agent, world };

/// The shape of an observation: [size] or, for images, [height, width, channels].
struct ObservationShape {
  int sides[3] = {1, 1, 1};
  int n_sides = 1;

  constexpr ObservationShape(int size) : sides{size, 1, 1} {}
  constexpr ObservationShape(int height, int width, int channels) : sides{height, width, channels}, n_sides(3) {}
  constexpr int size() const { return sides[0] * sides[1] * sides[2]; }
};

/// Some of the observations.
class ObservationSet {
 public:
  constexpr ObservationSet() = default;
  constexpr ObservationSet(Observation one) : bits_(1u << static_cast<int>(one)) {}
  /// Whatever a scenario offers.
  static constexpr ObservationSet all() {
    ObservationSet set;
    set.bits_ = (1u << kNObservations) - 1u;
    return set;
  }
  constexpr bool has(Observation one) const { return (bits_ >> static_cast<int>(one) & 1u) != 0; }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr ObservationSet& operator|=(ObservationSet other) {
    bits_ |= other.bits_;
    return *this;
  }
  /// What is in both.
  friend constexpr ObservationSet operator&(ObservationSet a, ObservationSet b) {
    a.bits_ &= b.bits_;
    return a;
  }
  friend constexpr ObservationSet operator|(ObservationSet a, ObservationSet b) { return a |= b; }
  bool operator==(const ObservationSet&) const = default;

  /// As a number: a bit each.
  constexpr uint8_t bits() const { return static_cast<uint8_t>(bits_); }
  static_assert(kNObservations <= 8);

 private:
  uint32_t bits_ = 0;
};

}  // namespace giga
