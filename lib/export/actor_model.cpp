#include "export/actor_model.hpp"

#include <ATen/ATen.h>

#include <algorithm>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Where the tensor of a model stands among the arrays of an actor: "layers.2.weight" is "mlp/2/weight", "memory.bias"
/// is "mlp/memory/bias". Of an encoder of images "conv_0.weight" is "nature/conv_0/weight", "layers.0.weight"
/// "nature/dense_0/weight", and that of the output layer "nature/0/weight".
std::string actor_name(const PolicyShape& shape, std::string name) {
  constexpr std::string_view kLayers = "layers.", kObservation = "observation.";
  if (name == kLogStdTensor) return name;
  if (name.starts_with(kObservation)) return "normalizer/" + name.substr(kObservation.size());
  const std::string output = layer_tensor(shape.n_layers() - 1, "");
  if (shape.reads_image() && name.starts_with(output))
    name = "0." + name.substr(output.size());
  else if (name.starts_with(kLayers))
    name = (shape.reads_image() ? "dense_" : "") + name.substr(kLayers.size());
  std::replace(name.begin(), name.end(), '.', '/');
  return cat(FieldCodec<EncoderKind>::print(shape.image.kind), "/", name);
}

/// The weight of a convolution between an actor's matrix [output, size size input] and [output, input, size, size].
NamedArray convolution_weight(const NamedArray& array, const std::string& name, const ConvolutionShape& c,
                              bool of_actor) {
  const std::vector<float> values = array_values<float>(array);
  at::Tensor x = at::tensor(values);
  x = of_actor ? x.view({c.output, c.size, c.size, c.input}).permute({0, 3, 1, 2})
               : x.view({c.output, c.input, c.size, c.size}).permute({0, 2, 3, 1}).reshape({c.output, -1});
  return to_array(name, x.contiguous());
}

/// The convolution whose weight a tensor is.
std::optional<ConvolutionShape> convolution_of(const PolicyShape& shape, const std::string& tensor) {
  if (shape.reads_image())
    for (const ConvolutionShape& c : convolutions_of(shape.image))
      if (c.weight() == tensor) return c;
  return std::nullopt;
}

/// An array of one or two dimensions cut or extended at the end of each; what is new is `filling`.
NamedArray resized(const NamedArray& array, const std::string& name, const std::vector<int64_t>& shape, float filling) {
  GIGA_CHECK(array.shape.size() == shape.size() && !shape.empty() && shape.size() <= 2, array.name);
  const auto as_matrix = [](const std::vector<int64_t>& s) { return std::pair(s.size() == 2 ? s[0] : 1, s.back()); };
  const auto [from_rows, from_columns] = as_matrix(array.shape);
  const auto [rows, columns] = as_matrix(shape);
  const std::vector<float> from = array_values<float>(array);
  std::vector<float> values(static_cast<size_t>(rows * columns), filling);
  for (int64_t row = 0; row < std::min(rows, from_rows); ++row)
    std::copy_n(from.begin() + row * from_columns, std::min(columns, from_columns), values.begin() + row * columns);
  NamedArray result = make_array(name, values);
  result.shape = shape;
  return result;
}

/// A first layer's weights [out, columns read] as [out, row]: 0 for the columns that are not read.
NamedArray for_whole_rows(const NamedArray& weight, const InputColumns& inputs) {
  const std::vector<float> from = array_values<float>(weight);
  const int64_t rows = weight.shape[0];
  std::vector<float> values(static_cast<size_t>(rows * inputs.row), 0.0f);
  for (int64_t row = 0; row < rows; ++row)
    std::copy_n(from.begin() + row * inputs.size, inputs.size, values.begin() + row * inputs.row + inputs.first);
  NamedArray result = make_array(weight.name, values);
  result.shape = {rows, inputs.row};
  return result;
}

/// A first layer may have columns for the zeros behind a row, up to the next multiple of 8; beyond, its weights are 0.
void check_reads_within(const NamedArray& weight, int64_t inputs) {
  const std::vector<float> values = array_values<float>(weight);
  for (size_t k = 0; k < values.size(); ++k)
    GIGA_CHECK(static_cast<int64_t>(k) % weight.shape[1] < (inputs + 7) / 8 * 8 || values[k] == 0, "reads beyond ",
               inputs, " numbers");
}

/// The moments of a normaliser with that mean and deviation, as it saves them after infinitely many updates.
void add_moments(const PolicyModel& model, int64_t size, NamedArrays& arrays) {
  const NamedArray mean = resized(find_array(model.tensors, kMeanTensor), "normalizer/mean", {size}, 0);
  const NamedArray std = resized(find_array(model.tensors, kStdTensor), "normalizer/std", {size}, 1);
  const std::vector<float> sum = array_values<float>(mean), deviation = array_values<float>(std);
  std::vector<float> sum_squares(sum.size());
  for (size_t k = 0; k < sum.size(); ++k) sum_squares[k] = deviation[k] * deviation[k] + sum[k] * sum[k];
  arrays.insert(arrays.end(),
                {mean, std, make_array("normalizer/sum", sum), make_array("normalizer/sum_squares", sum_squares),
                 make_array<float>("normalizer/weight", {1})});
}

}  // namespace

PolicyModel model_of(const Actor& actor, int inputs, const std::optional<RowView>& view) {
  NamedArrays arrays;
  actor.save("", arrays);
  PolicyModel model;
  const NetworkConfig& network = actor.config();
  model.shape = {inputs, actor.actions(), network, actor.normalizes()};
  model.shape.view = view;
  if (network.reads_image())
    model.shape.image = {network.encoder, actor.inputs().side,
                         network.encoder == EncoderKind::impala ? network.impala_width : 0};
  if (network.remembers()) {
    model.shape.memory = network.memory;
    model.shape.memory_size = network.memory_size;
  }
  for (const TensorShape& tensor : tensors_of(model.shape)) {
    NamedArray array = find_array(arrays, actor_name(model.shape, tensor.name));
    if (const auto convolution = convolution_of(model.shape, tensor.name)) {
      model.tensors.push_back(convolution_weight(array, tensor.name, *convolution, true));
      continue;
    }
    if (tensor.name == layer_tensor(0, "weight") && !model.shape.reads_image()) {
      array = for_whole_rows(array, actor.inputs());
      check_reads_within(array, inputs);
    }
    model.tensors.push_back(resized(array, tensor.name, tensor.shape, 0));
  }
  return model;
}

Actor actor_of(const PolicyModel& model, int padded_inputs, Precision precision, Device device) {
  const PolicyShape& shape = model.shape;
  GIGA_CHECK(shape.reads_image() || padded_inputs >= shape.inputs, padded_inputs, " < ", shape.inputs);
  ActorConfig config;
  static_cast<MlpConfig&>(config) = shape.network;
  config.memory = shape.memory;
  config.memory_size = shape.memory_size;
  config.encoder = shape.image.kind;
  if (shape.image.impala_width > 0) config.impala_width = shape.image.impala_width;
  const InputColumns inputs =
      shape.reads_image() ? InputColumns::image_of(shape.image.side) : InputColumns(padded_inputs);
  Actor actor(config, inputs, shape.actions, shape.normalizes, precision, torch_device(device), 0);
  NamedArrays own, arrays;
  actor.save("", own);
  for (const TensorShape& tensor : tensors_of(shape)) {
    const std::string name = actor_name(shape, tensor.name);
    if (const auto convolution = convolution_of(shape, tensor.name))
      arrays.push_back(convolution_weight(find_array(model.tensors, tensor.name), name, *convolution, false));
    else if (tensor.name != kMeanTensor && tensor.name != kStdTensor)
      arrays.push_back(resized(find_array(model.tensors, tensor.name), name, find_array(own, name).shape, 0));
  }
  if (shape.normalizes) add_moments(model, padded_inputs, arrays);
  actor.load("", arrays);
  return actor;
}

}  // namespace giga
