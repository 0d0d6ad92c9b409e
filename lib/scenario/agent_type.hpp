// AgentType: what distinguishes one kind of agent from another.
#pragma once

#include "config/fields.hpp"

namespace giga {

struct AgentType {
  int sprite = 1;
  float max_health = 1;
  float range = 1;
  float damage_range = 1;
  float thrust = 1;
  float idle_reward = 0;

  bool operator==(const AgentType&) const = default;
};

template <class V>
void visit_fields(V& v, AgentType& c) {
  v("sprite", c.sprite, "drawn shape, bits: 1 centre, 2 edges, 4 corners; also a number in the observation",
    range(0, 7));
  v("max_health", c.max_health, "health limit", greater_than(0));
  v("range", c.range, "factor on the squared sight depth: 2 sees 1.41 times as far", at_least(0));
  v("damage_range", c.damage_range, "factor on the squared weapon depth; 0 = cannot shoot", at_least(0));
  v("thrust", c.thrust, "factor on acceleration", range(0, 1000));
  v("idle_reward", c.idle_reward, "reward a step for being there");
}

}  // namespace giga
