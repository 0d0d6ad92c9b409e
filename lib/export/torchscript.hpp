// TorchScript: a policy as a module of LibTorch's own format, and such modules as policies. PyTorch calls the format
// legacy. A module is code: opening one runs what is in it.
#pragma once

#include <string>

#include "core/memory.hpp"
#include "export/policy_model.hpp"
#include "export/read_policy.hpp"

namespace giga {

/// The bytes of a file: a module with forward(obs [B, shape.row()], or images [B, side, side, 3] of bytes) -> logits
/// [B, 27] or mean [B, 3], and its tensors as buffers, "." in their names being "_". With memory: forward(obs, state
/// [B, S]) -> (logits or mean, next state), and an attribute state_size = S.
std::string encode_torchscript(const PolicyModel& model);

/// A policy that reads rows with the egocentric view, as one that reads the vector observation and computes the view.
std::shared_ptr<const Policy> with_view_inside(std::shared_ptr<const Policy> policy, const RowView& view,
                                               Device device);

/// What a module is given: the first columns of rows of numbers, or images [B, side, side, 3] of bytes.
struct ModuleInput {
  int numbers = 0, image_side = 0;
  ModuleInput(int columns, int side = 0) : numbers(columns), image_side(side) {}
};

/// The module in the bytes of a file as a policy, which is tried once. Continuous actions: its attribute `log_std` [3]
/// is the logarithm of their deviation before squashing; a module without one only plays its mean (ReadPolicy::greedy).
/// A module with an attribute `state_size` > 0 has a memory, as above. Throws InputError where the bytes are no module
/// or `forward` does not take or give what it should; `name` stands for the file.
ReadPolicy open_torchscript(const std::string& bytes, const std::string& name, const ModuleInput& input,
                            ActionKind actions, Device device);

}  // namespace giga
