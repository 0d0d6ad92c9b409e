#include "export/policy_model.hpp"

#include <algorithm>
#include <cmath>

#include "core/error.hpp"

namespace giga {
namespace {

const NamedArray* find_tensor(const NamedArrays& tensors, const std::string& name) {
  const auto found = std::find_if(tensors.begin(), tensors.end(), [&](const NamedArray& a) { return a.name == name; });
  return found == tensors.end() ? nullptr : &*found;
}

void check_numbers(const NamedArray& tensor, const std::string& where) {
  const std::vector<float> values = array_values<float>(tensor);
  for (size_t k = 0; k < values.size(); ++k) {
    if (!std::isfinite(values[k]))
      throw InputError(cat(where, ": number ", k, " is ", values[k], "; it must be finite"));
    if (tensor.name == kStdTensor && values[k] <= 0)
      throw InputError(cat(where, ": number ", k, " is ", values[k], "; a deviation must be > 0"));
  }
}

}  // namespace

std::string layer_tensor(int layer, const char* part) { return cat("layers.", layer, ".", part); }

std::vector<TensorShape> tensors_of(const PolicyShape& shape) {
  std::vector<TensorShape> list;
  int64_t from = shape.reads_image() ? convolved_features(shape.image) : shape.inputs;
  if (shape.reads_image())
    for (const ConvolutionShape& c : convolutions_of(shape.image))
      list.insert(list.end(), {{c.weight(), {c.output, c.input, c.size, c.size}}, {c.bias(), {c.output}}});
  if (shape.normalizes) list.insert(list.end(), {{kMeanTensor, {from}}, {kStdTensor, {from}}});
  for (int k = 0; k < shape.n_layers(); ++k) {
    if (!shape.is_hidden(k) && shape.memory != MemoryKind::none) {
      const int64_t size = shape.memory_size, gates = (shape.memory == MemoryKind::lstm ? 4 : 3) * size;
      list.insert(list.end(), {{kInputWeightTensor, {gates, from}},
                               {kInputBiasTensor, {gates}},
                               {kHiddenWeightTensor, {gates, size}},
                               {kHiddenBiasTensor, {gates}}});
      from = size;
    }
    const int64_t to = shape.is_hidden(k) ? shape.network.hidden[static_cast<size_t>(k)] : shape.outputs();
    list.push_back({layer_tensor(k, "weight"), {to, from}});
    list.push_back({layer_tensor(k, "bias"), {to}});
    if (shape.is_hidden(k) && shape.network.layer_norm) {
      list.push_back({layer_tensor(k, "norm_weight"), {to}});
      list.push_back({layer_tensor(k, "norm_bias"), {to}});
    }
    from = to;
  }
  if (shape.actions == ActionKind::continuous) list.push_back({kLogStdTensor, {kActionSize}});
  return list;
}

void check_tensors(const PolicyModel& model, const std::string& source) {
  const std::vector<TensorShape> wanted = tensors_of(model.shape);
  for (const TensorShape& w : wanted) {
    const std::string where = cat(source, ": tensor '", w.name, "'");
    const NamedArray* tensor = find_tensor(model.tensors, w.name);
    if (!tensor) throw InputError(cat(where, " is missing; the manifest's architecture needs it"));
    if (tensor->type != ArrayType::f32) throw InputError(cat(where, " is not of type F32"));
    if (tensor->shape != w.shape)
      throw InputError(cat(where, " has shape ", shape_text(tensor->shape), "; the manifest's architecture needs ",
                           shape_text(w.shape)));
    check_numbers(*tensor, where);
  }
  for (const NamedArray& tensor : model.tensors)
    if (std::none_of(wanted.begin(), wanted.end(), [&](const TensorShape& w) { return w.name == tensor.name; }))
      throw InputError(cat(source, ": tensor '", tensor.name, "' has no place in the manifest's architecture"));
}

}  // namespace giga
