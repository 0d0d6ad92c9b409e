#include "export/actor_model.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Where the tensor of a model stands among the arrays of an actor: "layers.2.weight" is "mlp/2/weight", "memory.bias"
/// is "mlp/memory/bias".
std::string actor_name(std::string name) {
  constexpr std::string_view kLayers = "layers.", kMemory = "memory.", kObservation = "observation.";
  if (name.starts_with(kLayers) || name.starts_with(kMemory)) {
    std::replace(name.begin(), name.end(), '.', '/');
    return "mlp/" + (name.starts_with("layers") ? name.substr(kLayers.size()) : name);
  }
  return name.starts_with(kObservation) ? "normalizer/" + name.substr(kObservation.size()) : name;
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
  if (actor.network().encoder().layers().empty())
    throw InputError("only policies of dense layers can be exported (encoder: mlp)");
  NamedArrays arrays;
  actor.save("", arrays);
  PolicyModel model;
  const NetworkConfig& network = actor.config();
  model.shape = {inputs, actor.actions(), network, actor.normalizes()};
  model.shape.view = view;
  if (network.remembers()) {
    model.shape.memory = network.memory;
    model.shape.memory_size = network.memory_size;
  }
  for (const TensorShape& tensor : tensors_of(model.shape)) {
    NamedArray array = find_array(arrays, actor_name(tensor.name));
    if (tensor.name == layer_tensor(0, "weight")) array = for_whole_rows(array, actor.inputs());
    if (tensor.name == layer_tensor(0, "weight")) check_reads_within(array, inputs);
    model.tensors.push_back(resized(array, tensor.name, tensor.shape, 0));
  }
  return model;
}

Actor actor_of(const PolicyModel& model, int padded_inputs, Precision precision, Device device) {
  const PolicyShape& shape = model.shape;
  GIGA_CHECK(padded_inputs >= shape.inputs, padded_inputs, " < ", shape.inputs);
  ActorConfig config;
  static_cast<MlpConfig&>(config) = shape.network;
  config.memory = shape.memory;
  config.memory_size = shape.memory_size;
  Actor actor(config, padded_inputs, shape.actions, shape.normalizes, precision, torch_device(device), 0);
  NamedArrays own, arrays;
  actor.save("", own);
  for (const TensorShape& tensor : tensors_of(shape)) {
    const std::string name = actor_name(tensor.name);
    if (tensor.name != kMeanTensor && tensor.name != kStdTensor)
      arrays.push_back(resized(find_array(model.tensors, tensor.name), name, find_array(own, name).shape, 0));
  }
  if (shape.normalizes) add_moments(model, padded_inputs, arrays);
  actor.load("", arrays);
  return actor;
}

}  // namespace giga
