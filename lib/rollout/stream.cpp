#include "rollout/stream.hpp"

#include <c10/core/impl/VirtualGuardImpl.h>

#include "rollout/tensors.hpp"

namespace giga {

void* current_stream(Device device) {
  if (!device.is_cuda()) return nullptr;
  return c10::impl::VirtualGuardImpl(at::kCUDA).getStream(torch_device(device)).native_handle();
}

}  // namespace giga
