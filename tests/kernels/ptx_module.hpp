// PtxModule: kernels as PTX, what nvcc makes of a .cu file before it is machine code, run on a CPU without a GPU. Each
// thread of a block has registers of its own and goes from barrier to barrier; warps of 32 do products of tiles (mma),
// loads of matrices and shuffles together.
//
// It knows what the kernels of the fused gradients are made of, and says of other instructions that it does not. Global
// memory is the host's. ex2, lg2, tanh, rcp, sqrt and div are exact to the last place where a GPU's are approximations,
// and a product of tiles adds up in fp64 and rounds once; all else is rounded as on a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "parity/lockstep_threads.hpp"

namespace giga::test {

struct PtxThread;
using PtxOperation = std::function<void(PtxThread&)>;

/// A kernel that is ready to run: operation k is what instruction k does.
struct PtxKernel {
  std::string name;
  std::vector<PtxOperation> operations;
  std::vector<std::string> lines;                   // the instructions in words, for messages
  int n_registers = 0;                              // of 64 bits, all kinds together
  std::vector<std::pair<int, uint64_t>> constants;  // registers that hold them
  size_t local_bytes = 0;                           // of a thread
};

/// How many blocks a kernel has in each direction.
struct PtxGrid {
  int x, y = 1, z = 1;
};

class PtxModule {
 public:
  /// Throws Error where the text has what it does not know.
  explicit PtxModule(const std::string& text);

  /// Runs the blocks of the one kernel whose name contains all of `words`, one after the other. `parameter`: the
  /// kernel's only one. Its shared memory is poisoned with 0xFF before a block begins. `order`: of the warps between
  /// barriers of the block, and of the lanes between those of a warp; asynchronous copies come at once with `backward`,
  /// else when they are waited for. Throws Error where threads do not come to the same barrier, or an address of shared
  /// memory is none.
  template <class Parameter>
  void launch(const std::vector<std::string>& words, const PtxGrid& grid, int threads, size_t shared_bytes,
              const Parameter& parameter, ThreadOrder order) const {
    run(find(words), grid, threads, shared_bytes, &parameter, sizeof parameter, order);
  }

 private:
  const PtxKernel& find(const std::vector<std::string>& words) const;
  static void run(const PtxKernel& kernel, const PtxGrid& grid, int threads, size_t shared_bytes, const void* parameter,
                  size_t parameter_bytes, ThreadOrder order);

  std::vector<PtxKernel> kernels_;
  std::map<std::string, std::unique_ptr<std::vector<uint8_t>>> tables_;  // that the kernels read, by name
};

}  // namespace giga::test
