// ReadPolicy: an exported policy that was read and can play.
#pragma once

#include <memory>

namespace giga {

class Policy;

struct ReadPolicy {
  std::shared_ptr<const Policy> policy;
  bool greedy = false;  ///< it always takes its most likely action
};

}  // namespace giga
