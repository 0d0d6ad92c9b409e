// What the instructions of PTX do (PTX ISA 9.0, chapter 9).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "kernels/ptx_thread.hpp"

namespace giga::test {

/// An operand: registers, more than one of them in {..}; or an address [register + offset]. Immediates lie in registers
/// too.
struct PtxOperand {
  std::vector<int> registers;
  int64_t offset = 0;

  int at() const { return registers.front(); }
};

/// What an instruction does: its name by parts, as {"add", "ftz", "f32"}, without those that change the order of
/// instructions (bra, ret). Throws Error where it is not known.
std::function<void(PtxThread&)> ptx_operation(const std::vector<std::string>& words,
                                              const std::vector<PtxOperand>& operands);

/// Takes the results of what the warp has done together; empty for instructions without.
std::function<void(PtxThread&)> ptx_result(const std::vector<std::string>& words,
                                           const std::vector<PtxOperand>& operands);

/// What a warp does together once all its lanes have asked for it. Throws Error where they ask for different things.
void do_warp_work(PtxThread* lanes);

}  // namespace giga::test
