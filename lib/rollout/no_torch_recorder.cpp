// A build without CUDA records nothing.
#include "rollout/torch_recorder.hpp"

namespace giga {

std::shared_ptr<TorchRecorder> make_torch_recorder(Device) { return nullptr; }

}  // namespace giga
