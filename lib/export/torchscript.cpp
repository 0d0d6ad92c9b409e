// Modules made through LibTorch and opened by it. The only file that includes its scripting headers.
#include "export/torchscript.hpp"

#include <ATen/ATen.h>
#include <torch/csrc/jit/runtime/graph_executor.h>
#include <torch/script.h>

#include <algorithm>
#include <sstream>

#include "core/error.hpp"
#include "io/number.hpp"
#include "math/distributions.hpp"
#include "policy/parameters.hpp"
#include "policy/policy.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

constexpr const char* kStateSize = "state_size";
constexpr int64_t kMostState = 1 << 16;

std::string buffer_name(std::string tensor) {
  std::replace(tensor.begin(), tensor.end(), '.', '_');
  return tensor;
}

/// The lines that make x, what the network reads, of obs.
std::string input_code(const std::optional<RowView>& view) {
  if (!view) return "    x = obs\n";
  PythonWriter writer("torch", "    ");
  const Array row = with_view(*view, {&writer, "obs"});
  return cat(writer.code(), "    x = ", row.text, "\n");
}

/// The lines of a recurrent cell (math/recurrent.hpp), from x and state to both of the next step.
std::string memory_source(const PolicyShape& shape) {
  const int h = shape.memory_size;
  const bool lstm = shape.memory == MemoryKind::lstm;
  std::string code;
  const auto line = [&code](const std::string& text) { code += "    " + text + "\n"; };
  const auto columns = [h](const char* name, int k) { return cat(name, "[:, ", k * h, ":", (k + 1) * h, "]"); };
  const auto sum = [&](int k) { return columns("i", k) + " + " + columns("b", k); };
  const auto product = [](const std::string& x, const char* weight, const char* bias) {
    return cat("torch.linear(", x, ", self.", buffer_name(weight), ", self.", buffer_name(bias), ")");
  };
  line(cat("h = ", columns("state", 0)));
  line("i = " + product("x", kInputWeightTensor, kInputBiasTensor));
  line("b = " + product("h", kHiddenWeightTensor, kHiddenBiasTensor));
  if (lstm) {
    line(cat("c = torch.sigmoid(", sum(1), ") * ", columns("state", 1), " + torch.sigmoid(", sum(0), ") * torch.tanh(",
             sum(2), ")"));
    line(cat("x = torch.sigmoid(", sum(3), ") * torch.tanh(c)"));
    line("state = torch.cat([x, c], 1)");
  } else {
    line(cat("u = torch.sigmoid(", sum(1), ")"));
    line(cat("n = torch.tanh(", columns("i", 2), " + torch.sigmoid(", sum(0), ") * ", columns("b", 2), ")"));
    line("x = (1.0 - u) * n + u * h");
    line("state = x");
  }
  return code;
}

/// The Python of `forward`.
std::string source_of(const PolicyShape& shape) {
  const bool remembers = shape.memory != MemoryKind::none;
  std::string code = remembers ? "def forward(self, obs: Tensor, state: Tensor) -> Tuple[Tensor, Tensor]:\n"
                               : "def forward(self, obs: Tensor) -> Tensor:\n";
  code += shape.reads_image() ? python_convolutions(shape.image, "obs", true, "    ") : input_code(shape.view);
  const auto line = [&code](const std::string& value) { code += "    x = " + value + "\n"; };
  const std::string limit = print_number(kNormalizedLimit), epsilon = print_number(kLayerNormEpsilon);
  if (shape.normalizes)
    line(cat("torch.clamp((x - self.", buffer_name(kMeanTensor), ") / self.", buffer_name(kStdTensor), ", -", limit,
             ".0, ", limit, ".0)"));
  for (int k = 0; k < shape.n_layers(); ++k) {
    if (!shape.is_hidden(k) && remembers) code += memory_source(shape);
    const auto buffer = [k](const char* part) { return "self." + buffer_name(layer_tensor(k, part)); };
    line(cat("torch.linear(x, ", buffer("weight"), ", ", buffer("bias"), ")"));
    if (!shape.is_hidden(k)) continue;
    if (shape.network.layer_norm)
      line(cat("torch.layer_norm(x, [", shape.network.hidden[static_cast<size_t>(k)], "], ", buffer("norm_weight"),
               ", ", buffer("norm_bias"), ", ", epsilon, ")"));
    line(cat("torch.", enum_names(shape.network.activation)[static_cast<size_t>(shape.network.activation)], "(x)"));
  }
  return code + (remembers ? "    return x, state\n" : "    return x\n");
}

/// The first line: LibTorch puts pages behind it.
std::string first_line(const std::exception& e) {
  const std::string message = e.what();
  return message.substr(0, message.find('\n'));
}

class TorchScriptPolicy final : public Policy {
 public:
  TorchScriptPolicy(torch::jit::Module module, const ModuleInput& input, ActionKind actions, Device device)
      : module_(std::move(module)), input_(input), actions_(actions) {
    module_.eval();
    if (module_.hasattr(kStateSize)) state_size_ = module_.attr(kStateSize).toInt();
    if (state_size_ < 0 || state_size_ > kMostState)
      throw InputError(cat("its ", kStateSize, " is ", state_size_, "; allowed: 0 to ", kMostState));
    if (actions == ActionKind::continuous) find_log_std(torch_device(device));
  }

  at::Tensor forward(const at::Tensor& obs, NetworkState& state) const override {
    const int64_t side = input_.image_side;
    const at::Tensor head =
        call(side > 0 ? obs.view({-1, side, side, kChannels}) : obs.narrow(1, 0, input_.numbers).contiguous(), state)
            .contiguous();
    return actions_ == ActionKind::discrete ? at::constant_pad_nd(head, {0, kLogitStride - kNDiscreteActions}) : head;
  }
  int64_t state_size() const override { return state_size_; }
  ObservationSet reads() const override { return input_.image_side > 0 ? Observation::image : all_numbers(); }
  ActionKind actions() const override { return actions_; }
  at::Tensor log_std() const override { return log_std_; }
  /// A mean without a deviation.
  bool greedy() const { return actions_ == ActionKind::continuous && !has_deviation_; }

  /// What is wrong with the answer to two observations; empty where nothing is.
  std::string fault(Device device) const {
    const int64_t outputs = actions_ == ActionKind::discrete ? kNDiscreteActions : kActionSize;
    const auto options = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
    NetworkState state;
    const int64_t side = input_.image_side;
    const at::Tensor input = side > 0 ? at::zeros({2, side, side, kChannels}, options.dtype(at::kByte))
                                      : at::zeros({2, input_.numbers}, options);
    const at::Tensor head = call(input, state);
    if (state_size_ > 0 && (state.rows.scalar_type() != at::kFloat || state.rows.device() != options.device() ||
                            state.rows.sizes() != at::IntArrayRef({2, state_size_})))
      return cat("forward gave a next state of ", state.rows.scalar_type(), " ", state.rows.sizes(), " on ",
                 state.rows.device().str(), "; needed: Float [2, ", state_size_, "] on ", options.device().str());
    if (head.scalar_type() == at::kFloat && head.device() == options.device() &&
        head.sizes() == at::IntArrayRef({2, outputs}))
      return "";
    return cat("forward gave a tensor of ", head.scalar_type(), " ", head.sizes(), " on ", head.device().str(),
               " for observations ", input.sizes(), "; needed: Float [2, ", outputs, "] on ", options.device().str());
  }

 private:
  /// As written, without fusing: the same numbers at every call, and nothing is compiled while a game is played.
  at::Tensor call(const at::Tensor& obs, NetworkState& state) const {
    at::NoGradGuard no_grad;
    torch::jit::GraphOptimizerEnabledGuard as_written(false);
    if (state_size_ == 0) return module_.forward({obs}).toTensor();
    if (!state.rows.defined()) state.rows = at::zeros({obs.size(0), state_size_}, obs.options().dtype(at::kFloat));
    const auto out = module_.forward({obs, state.rows}).toTuple();
    if (out->elements().size() != 2) throw InputError("forward of a module with a state gives a head and a state");
    state.rows = out->elements()[1].toTensor().contiguous();
    return out->elements()[0].toTensor();
  }

  void find_log_std(at::Device device) {
    const auto options = at::TensorOptions().dtype(at::kFloat).device(device);
    has_deviation_ = module_.hasattr("log_std");
    log_std_ = has_deviation_ ? module_.attr("log_std").toTensor().to(options).contiguous()
                              : at::zeros({kActionSize}, options);
    if (log_std_.sizes() != at::IntArrayRef({kActionSize}))
      throw InputError(cat("its log_std has shape ", log_std_.sizes(), "; needed: [", kActionSize, "]"));
  }

  mutable torch::jit::Module module_;  // `forward` of a module is not const
  ModuleInput input_;
  int64_t state_size_ = 0;
  ActionKind actions_;
  bool has_deviation_ = false;
  at::Tensor log_std_;
};

/// A policy that reads the egocentric view, where nobody but itself computes it.
class PolicyWithView final : public Policy {
 public:
  PolicyWithView(std::shared_ptr<const Policy> policy, const RowView& view, Device device)
      : policy_(std::move(policy)), view_(view), module_("RowView") {
    module_.define("def forward(self, obs: Tensor) -> Tensor:\n" + input_code(view) + "    return x\n");
    module_.to(torch_device(device));
  }

  at::Tensor forward(const at::Tensor& obs, NetworkState& state) const override {
    at::NoGradGuard no_grad;
    torch::jit::GraphOptimizerEnabledGuard as_written(false);
    const at::Tensor row = module_.forward({obs.narrow(1, 0, view_.row_size())}).toTensor();
    return policy_->forward(row, state);
  }
  int64_t state_size() const override { return policy_->state_size(); }
  ObservationSet reads() const override { return Observation::vector; }
  ActionKind actions() const override { return policy_->actions(); }
  at::Tensor log_std() const override { return policy_->log_std(); }

 private:
  std::shared_ptr<const Policy> policy_;
  RowView view_;
  mutable torch::jit::Module module_;  // `forward` of a module is not const
};

}  // namespace

std::string encode_torchscript(const PolicyModel& model) {
  torch::jit::Module module("GigastepPolicy");
  module.register_attribute("training", c10::BoolType::get(), false);  // Python's eval() asks for it
  for (const NamedArray& tensor : model.tensors) {
    const at::Tensor buffer = at::empty(tensor.shape, at::kFloat);
    from_array(tensor, buffer);
    module.register_buffer(buffer_name(tensor.name), buffer);
  }
  if (model.shape.state_size() > 0)
    module.register_attribute(kStateSize, c10::IntType::get(), int64_t{model.shape.state_size()});
  module.define(source_of(model.shape));
  std::ostringstream out;
  module.save(out);
  return out.str();
}

std::shared_ptr<const Policy> with_view_inside(std::shared_ptr<const Policy> policy, const RowView& view,
                                               Device device) {
  return std::make_shared<PolicyWithView>(std::move(policy), view, device);
}

ReadPolicy open_torchscript(const std::string& bytes, const std::string& name, const ModuleInput& input,
                            ActionKind actions, Device device) {
  try {
    std::istringstream in(bytes);
    auto policy =
        std::make_shared<TorchScriptPolicy>(torch::jit::load(in, torch_device(device)), input, actions, device);
    if (const std::string fault = policy->fault(device); !fault.empty()) throw InputError(fault);
    const bool greedy = policy->greedy();
    return {std::move(policy), greedy};
  } catch (const std::exception& e) {
    throw InputError(cat(name, " is no TorchScript module that can play here: ", first_line(e)));
  }
}

}  // namespace giga
