// The graph of a policy in ONNX's messages. Field numbers are those of onnx.proto3.
#include "export/onnx.hpp"

#include <bit>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "core/error.hpp"
#include "export/manifest.hpp"
#include "io/number.hpp"
#include "io/protobuf_wire.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

constexpr uint64_t kIrVersion = 8;  // that of operator set 17
constexpr uint64_t kOperatorSet = 17;
constexpr uint64_t kFloatTensor = 1, kByteTensor = 2, kInt64Tensor = 7;         // TensorProto.DataType
constexpr uint64_t kFloatAttribute = 1, kIntAttribute = 2, kIntsAttribute = 7;  // AttributeProto.AttributeType

ProtobufMessage tensor_message(const std::string& name, const std::vector<int64_t>& shape, std::string_view bytes,
                               uint64_t type = kFloatTensor) {
  ProtobufMessage tensor;
  for (const int64_t side : shape) tensor.varint(1, static_cast<uint64_t>(side));
  return tensor.varint(2, type).text(8, name).bytes(9, bytes);
}

/// An input or output [batch, sides].
ProtobufMessage value_message(const std::string& name, const std::vector<int>& sides, uint64_t type = kFloatTensor) {
  ProtobufMessage shape;
  shape.message(1, ProtobufMessage().text(2, "batch"));
  for (const int side : sides) shape.message(1, ProtobufMessage().varint(1, static_cast<uint64_t>(side)));
  const ProtobufMessage tensor_type = ProtobufMessage().varint(1, type).message(2, shape);
  return ProtobufMessage().text(1, name).message(2, ProtobufMessage().message(1, tensor_type));
}

ProtobufMessage int_attribute(const std::string& name, int64_t value) {
  return ProtobufMessage().text(1, name).varint(3, static_cast<uint64_t>(value)).varint(20, kIntAttribute);
}
ProtobufMessage ints_attribute(const std::string& name, const std::vector<int>& values) {
  ProtobufMessage attribute;
  attribute.text(1, name);
  for (const int value : values) attribute.varint(8, static_cast<uint64_t>(value));
  return attribute.varint(20, kIntsAttribute);
}
ProtobufMessage float_attribute(const std::string& name, float value) {
  return ProtobufMessage().text(1, name).float32(2, value).varint(20, kFloatAttribute);
}

/// Builds the graph node by node; values are known by their names.
class GraphBuilder {
 public:
  /// A node with one output, which gets a name of its own.
  std::string add(const std::string& op, const std::vector<std::string>& inputs,
                  const std::vector<ProtobufMessage>& attributes = {}) {
    return add_many(op, inputs, 1, attributes).front();
  }
  /// The columns of x in so many equal parts.
  std::vector<std::string> split(const std::string& x, int parts) {
    return add_many("Split", {x}, parts, {int_attribute("axis", 1)});
  }

  std::string constant(const std::string& name, float value) {
    if (names_.insert(name).second)
      initializers_.push_back(tensor_message(name, {}, little_endian(std::bit_cast<uint32_t>(value))));
    return name;
  }
  /// The whole numbers from `first` below `end`.
  std::string range(int first, int end) {
    const std::string name = cat("range_", first, "_", end);
    std::string bytes;
    for (int value = first; value < end; ++value) bytes += little_endian(static_cast<uint64_t>(int64_t{value}));
    if (names_.insert(name).second) initializers_.push_back(tensor_message(name, {end - first}, bytes, kInt64Tensor));
    return name;
  }
  /// Whole numbers, of one dimension or, `scalar`, none.
  std::string integers(const std::vector<int>& values, bool scalar = false) {
    std::string name = scalar ? "index" : "integers", bytes;
    for (const int value : values) {
      name += cat("_", value);
      bytes += little_endian(static_cast<uint64_t>(int64_t{value}));
    }
    std::vector<int64_t> shape;
    if (!scalar) shape.push_back(static_cast<int64_t>(values.size()));
    if (names_.insert(name).second) initializers_.push_back(tensor_message(name, shape, bytes, kInt64Tensor));
    return name;
  }
  void tensor(const NamedArray& array) {
    const std::string_view bytes(reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size());
    initializers_.push_back(tensor_message(array.name, array.shape, bytes));
  }

  /// The graph that gives `value` out under the name of the policy's output.
  ProtobufMessage finish(const PolicyShape& shape, const std::string& value, const std::string& state) {
    const auto name = [&](const std::string& from, const char* to) {
      nodes_.push_back(ProtobufMessage().text(1, from).text(2, to).text(4, "Identity"));
    };
    name(value, shape.output_name());
    const bool remembers = shape.state_size() > 0;
    if (remembers) name(state, kStateOutput);
    ProtobufMessage graph;
    for (const ProtobufMessage& node : nodes_) graph.message(1, node);
    graph.text(2, "policy");
    for (const ProtobufMessage& initializer : initializers_) graph.message(5, initializer);
    const int side = shape.image.side;
    graph.message(11, side > 0 ? value_message(kImageInput, {side, side, kChannels}, kByteTensor)
                               : value_message(kRowInput, {shape.row()}));
    if (remembers) graph.message(11, value_message(kStateInput, {shape.state_size()}));
    graph.message(12, value_message(shape.output_name(), {shape.outputs()}));
    return remembers ? graph.message(12, value_message(kStateOutput, {shape.state_size()})) : graph;
  }

 private:
  std::vector<std::string> add_many(const std::string& op, const std::vector<std::string>& inputs, int outputs,
                                    const std::vector<ProtobufMessage>& attributes) {
    const std::string name = cat(op, "_", n_nodes_++);
    std::vector<std::string> names;
    for (int k = 0; k < outputs; ++k) names.push_back(k == 0 ? name : cat(name, "_", k));
    ProtobufMessage node;
    for (const std::string& input : inputs) node.text(1, input);
    for (const std::string& output : names) node.text(2, output);
    node.text(3, name).text(4, op);
    for (const ProtobufMessage& attribute : attributes) node.message(5, attribute);
    nodes_.push_back(std::move(node));
    return names;
  }

  std::vector<ProtobufMessage> nodes_, initializers_;
  std::set<std::string> names_;  // of constants
  int n_nodes_ = 0;
};

/// Formulas as nodes of the graph.
class OnnxWriter final : public ArrayWriter {
 public:
  explicit OnnxWriter(GraphBuilder& graph) : graph_(graph) {}

  std::string operation(const ArrayOperation& op, const std::vector<std::string>& arguments) override {
    return graph_.add(op.onnx, arguments);
  }
  std::string number(float value) override { return graph_.constant(cat("number_", print_number(value)), value); }
  std::string columns(const std::string& x, int first, int end) override {
    return graph_.add("Slice", {x, graph_.integers({first}), graph_.integers({end}), graph_.integers({1})});
  }
  std::string reshaped(const std::string& x, const std::vector<int>& sides) override {
    std::vector<int> shape = {-1};
    shape.insert(shape.end(), sides.begin(), sides.end());
    return graph_.add("Reshape", {x, graph_.integers(shape)});
  }
  std::string feature(const std::string& x, int k) override {
    return graph_.add("Gather", {x, graph_.integers({k}, true)}, {int_attribute("axis", 2)});
  }
  std::string running_sum(const std::string& x) override {
    return graph_.add("CumSum", {x, graph_.integers({1}, true)});
  }
  std::string sum_of_items(const std::string& x) override {
    return graph_.add("ReduceSum", {x, graph_.integers({1})}, {int_attribute("keepdims", 0)});
  }
  std::string least(const std::string& x) override {
    return graph_.add("ReduceMin", {x}, {ints_attribute("axes", {2}), int_attribute("keepdims", 0)});
  }
  std::string joined(const std::vector<std::string>& parts) override {
    return graph_.add("Concat", parts, {int_attribute("axis", 1)});
  }
  std::string named(const std::string&, const std::string& x) override { return x; }

 private:
  GraphBuilder& graph_;
};

/// The convolutions of an encoder of images.
class OnnxImageWriter final : public ImageWriter {
 public:
  explicit OnnxImageWriter(GraphBuilder& graph) : graph_(graph) {}

  std::string convolution(const ConvolutionShape& c, const std::string& x) override {
    return graph_.add(
        "Conv", {x, c.weight(), c.bias()},
        {ints_attribute("kernel_shape", {c.size, c.size}), ints_attribute("strides", {c.stride, c.stride}),
         ints_attribute("pads", {c.padding, c.padding, c.padding, c.padding})});
  }
  std::string relu(const std::string& x) override { return graph_.add("Relu", {x}); }
  std::string pool(const std::string& x) override {
    return graph_.add("MaxPool", {x},
                      {ints_attribute("kernel_shape", {3, 3}), ints_attribute("strides", {2, 2}),
                       ints_attribute("pads", {1, 1, 1, 1})});
  }
  std::string sum(const std::string& x, const std::string& y) override { return graph_.add("Add", {x, y}); }

 private:
  GraphBuilder& graph_;
};

std::string add_cast(GraphBuilder& graph, const std::string& x, uint64_t type) {
  return graph.add("Cast", {x}, {int_attribute("to", static_cast<int64_t>(type))});
}

/// What `centred` of example/images.py does, with numbers [B, side, side, 3].
std::string add_centred(GraphBuilder& graph, const std::string& images, int side) {
  const int middle = side / 2;
  const auto both = [&](const std::string& x, const std::string& y) { return graph.add("And", {x, y}); };
  const auto channel = [&](int k) {
    return graph.add("Slice", {images, graph.integers({k}), graph.integers({k + 1}), graph.integers({3})});
  };
  const std::string r = channel(0), g = channel(1), b = channel(2);
  const std::string white = graph.constant("white", 255), black = graph.constant("black", 0);
  const std::string own = both(both(graph.add("Equal", {g, white}), graph.add("Equal", {r, b})),
                               both(graph.add("Greater", {r, black}), graph.add("Less", {r, white})));
  const std::string flat =
      graph.add("Reshape", {add_cast(graph, own, kInt64Tensor), graph.integers({-1, side * side})});
  const std::string place = graph.add("ReduceMax", {graph.add("Mul", {flat, graph.range(1, side * side + 1)})},
                                      {ints_attribute("axes", {1}), int_attribute("keepdims", 1)});
  const std::string at =
      graph.add("Where", {graph.add("Greater", {place, graph.integers({0})}),
                          graph.add("Sub", {place, graph.integers({1})}), graph.integers({middle * side + middle})});
  const std::string x = graph.add("Div", {at, graph.integers({side})});
  const std::string y = graph.add("Sub", {at, graph.add("Mul", {x, graph.integers({side})})});
  // The rows along the first side that are taken of each image.
  const auto taken = [&](const std::string& from, const std::string& first) {
    const std::string rows =
        graph.add("Reshape", {graph.add("Add", {first, graph.range(0, side)}), graph.integers({-1, side, 1})});
    return graph.add("GatherND", {from, rows}, {int_attribute("batch_dims", 1)});
  };
  const auto turned = [&](const std::string& from) {
    return graph.add("Transpose", {from}, {ints_attribute("perm", {0, 2, 1, 3})});
  };
  const std::string wide =
      graph.add("Pad", {images, graph.integers({0, middle, middle, 0, 0, side - middle, side - middle, 0})});
  return turned(taken(turned(taken(wide, x)), y));
}

/// From the bytes of an image to the numbers that the first dense layer takes.
std::string add_image(GraphBuilder& graph, const ImageEncoderShape& shape) {
  OnnxImageWriter writer(graph);
  std::string bytes = add_cast(graph, kImageInput, kFloatTensor);
  if (centres_agent(shape)) bytes = add_centred(graph, bytes, shape.side);
  const std::string turned = graph.add("Transpose", {bytes}, {ints_attribute("perm", {0, 3, 1, 2})});
  const std::string last = write_convolutions(shape, writer, graph.add("Div", {turned, graph.constant("white", 255)}));
  const std::string channels_last = graph.add("Transpose", {last}, {ints_attribute("perm", {0, 2, 3, 1})});
  return graph.add("Reshape", {channels_last, graph.integers({-1, convolved_features(shape)})});
}

std::string add_activation(GraphBuilder& graph, Activation activation, const std::string& x) {
  switch (activation) {
    case Activation::tanh:
      return graph.add("Tanh", {x});
    case Activation::relu:
      return graph.add("Relu", {x});
    case Activation::silu:
      return graph.add("Mul", {x, graph.add("Sigmoid", {x})});
    case Activation::gelu: {  // x / 2 (1 + erf(x / sqrt 2)); a node of its own only from operator set 20 on
      const std::string erf = graph.add("Erf", {graph.add("Mul", {x, "sqrt_half"})});
      return graph.add("Mul", {graph.add("Mul", {x, "half"}), graph.add("Add", {erf, "one"})});
    }
  }
  throw Error("an activation without a graph");
}

std::string add_normalisation(GraphBuilder& graph, const std::string& x) {
  const std::string centred = graph.add("Sub", {x, kMeanTensor});
  return graph.add("Clip", {graph.add("Div", {centred, kStdTensor}), graph.constant("lower_limit", -kNormalizedLimit),
                            graph.constant("upper_limit", kNormalizedLimit)});
}

std::string add_layer(GraphBuilder& graph, const PolicyShape& shape, int layer, const std::string& input) {
  const auto tensor = [layer](const char* part) { return layer_tensor(layer, part); };
  std::string x = graph.add("Gemm", {input, tensor("weight"), tensor("bias")}, {int_attribute("transB", 1)});
  if (!shape.is_hidden(layer)) return x;
  if (shape.network.layer_norm)
    x = graph.add("LayerNormalization", {x, tensor("norm_weight"), tensor("norm_bias")},
                  {int_attribute("axis", -1), float_attribute("epsilon", kLayerNormEpsilon)});
  return add_activation(graph, shape.network.activation, x);
}

/// What comes out of a recurrent cell (math/recurrent.hpp) and what it then remembers.
struct Remembered {
  std::string features, state;
};
Remembered add_memory(GraphBuilder& graph, MemoryKind kind, const std::string& x) {
  const bool lstm = kind == MemoryKind::lstm;
  const auto product = [&](const std::string& rows, const char* weight, const char* bias) {
    return graph.split(graph.add("Gemm", {rows, weight, bias}, {int_attribute("transB", 1)}), lstm ? 4 : 3);
  };
  const std::vector<std::string> parts = lstm ? graph.split(kStateInput, 2) : std::vector<std::string>{kStateInput};
  const std::vector<std::string> in = product(x, kInputWeightTensor, kInputBiasTensor),
                                 back = product(parts[0], kHiddenWeightTensor, kHiddenBiasTensor);
  const auto add = [&](const std::string& a, const std::string& b) { return graph.add("Add", {a, b}); };
  const auto times = [&](const std::string& a, const std::string& b) { return graph.add("Mul", {a, b}); };
  const auto tanh = [&](const std::string& a) { return graph.add("Tanh", {a}); };
  const auto gate = [&](size_t k) { return graph.add("Sigmoid", {add(in[k], back[k])}); };
  if (!lstm) {
    const std::string candidate = tanh(add(in[2], times(gate(0), back[2])));
    // (1 - update) candidate + update h = candidate + update (h - candidate)
    const std::string h = add(candidate, times(gate(1), graph.add("Sub", {parts[0], candidate})));
    return {h, h};
  }
  const std::string c = add(times(gate(1), parts[1]), times(gate(0), tanh(add(in[2], back[2]))));
  const std::string h = times(gate(3), tanh(c));
  return {h, graph.add("Concat", {h, c}, {int_attribute("axis", 1)})};
}

}  // namespace

std::string encode_onnx(const PolicyModel& model, const std::string& gigastep_version) {
  GraphBuilder graph;
  const PolicyShape& shape = model.shape;
  for (const NamedArray& tensor : model.tensors)
    if (tensor.name != kLogStdTensor) graph.tensor(tensor);  // it is in the manifest; the graph has no use for it
  if (shape.network.activation == Activation::gelu) {
    graph.constant("sqrt_half", static_cast<float>(std::sqrt(0.5)));
    graph.constant("half", 0.5f);
    graph.constant("one", 1.0f);
  }
  std::string x = shape.reads_image() ? add_image(graph, shape.image) : kRowInput;
  Remembered remembered;
  if (shape.view) {
    OnnxWriter writer(graph);
    x = with_view(*shape.view, {&writer, x}).text;
  }
  if (shape.normalizes) x = add_normalisation(graph, x);
  for (int layer = 0; layer < shape.n_layers(); ++layer) {
    if (!shape.is_hidden(layer) && shape.memory != MemoryKind::none) {
      remembered = add_memory(graph, shape.memory, x);
      x = remembered.features;
    }
    x = add_layer(graph, shape, layer, x);
  }

  ProtobufMessage file;
  file.varint(1, kIrVersion)
      .text(2, "gigastep")
      .text(3, gigastep_version)
      .message(7, graph.finish(shape, x, remembered.state));
  file.message(8, ProtobufMessage().text(1, "").varint(2, kOperatorSet));
  if (file.encoded().size() > static_cast<size_t>(std::numeric_limits<int32_t>::max()))
    throw InputError(cat("the policy has ", file.encoded().size(),
                         " bytes, and an ONNX file at most 2 GiB; --format safetensors holds it"));
  return file.encoded();
}

}  // namespace giga
