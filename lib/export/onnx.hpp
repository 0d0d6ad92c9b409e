// ONNX: a policy as a graph that ONNX Runtime and many other programs run.
#pragma once

#include <string>

#include "export/policy_model.hpp"

namespace giga {

/// The bytes of an ONNX file, operator set 17: input `obs` [batch, shape.row()] fp32, output `logits` [batch, 27] or
/// `mean` [batch, 3], the batch being of any size; the egocentric view (where the shape has it) and the normalisation
/// of observations are part of the graph. Throws InputError for a policy of 2 GiB, which the format does not hold.
std::string encode_onnx(const PolicyModel& model, const std::string& gigastep_version);

}  // namespace giga
