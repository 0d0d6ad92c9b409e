#include "rollout/stream.hpp"

#include <c10/core/impl/VirtualGuardImpl.h>

#include "cuda/runtime.hpp"
#include "rollout/tensors.hpp"

namespace giga {

void* current_stream(Device device) {
  if (!device.is_cuda()) return nullptr;
  const c10::impl::VirtualGuardImpl cuda(at::kCUDA);
  const at::Device gpu = torch_device(device);
  if (cuda.getStream(gpu) == cuda.getDefaultStream(gpu)) {
    // LibTorch knows a stream that it did not make by its address.
    const auto id = reinterpret_cast<c10::StreamId>(work_stream(device.index));
    cuda.exchangeStream(c10::Stream(c10::Stream::UNSAFE, gpu, id));
  }
  return cuda.getStream(gpu).native_handle();
}

}  // namespace giga
