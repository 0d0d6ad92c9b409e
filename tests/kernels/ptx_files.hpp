// The kernels of fused networks as PTX, which the build leaves beside the tests where it has CUDA.
#pragma once

#include <string>

#include "kernels/ptx_module.hpp"

namespace giga::test {

/// Whether the build has CUDA, and so the files.
bool has_ptx();
/// The kernels of cuda/NAME.cu, read once. Throws Error where there are none.
const PtxModule& ptx_module(const std::string& name);

}  // namespace giga::test
