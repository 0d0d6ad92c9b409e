#include "eval/torchscript_policy.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>
#include <torch/csrc/jit/api/module.h>
#include <torch/csrc/jit/serialization/import.h>

#include "core/error.hpp"
#include "math/distributions.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// LibTorch's messages without the pages of stack behind them.
std::string short_message(const std::exception& e) {
  const std::string message = e.what();
  return message.substr(0, message.find("\nException raised from"));
}

}  // namespace

struct TorchScriptPolicy::Module {
  torch::jit::Module module;
};

std::shared_ptr<TorchScriptPolicy> TorchScriptPolicy::load(const std::filesystem::path& file, Device device) {
  try {
    auto module = std::make_unique<Module>();
    module->module = torch::jit::load(file.string(), torch_device(device));
    module->module.eval();
    return std::shared_ptr<TorchScriptPolicy>(new TorchScriptPolicy(file.string(), std::move(module), device));
  } catch (const c10::Error& e) {
    throw InputError(cat(file.string(), ": LibTorch cannot read it as a TorchScript module: ", short_message(e)));
  }
}

TorchScriptPolicy::TorchScriptPolicy(std::string name, std::unique_ptr<Module> module, Device device)
    : name_(std::move(name)), module_(std::move(module)), device_(device) {
  if (!module_->module.hasattr("log_std")) return;
  const at::IValue value = module_->module.attr("log_std");
  if (!value.isTensor() || value.toTensor().numel() != kActionSize)
    throw InputError(cat(name_, ": its log_std is not a tensor of ", kActionSize, " numbers"));
  log_std_ = value.toTensor().detach().to(torch_device(device), at::kFloat).reshape({kActionSize}).contiguous();
}

TorchScriptPolicy::~TorchScriptPolicy() = default;

at::Tensor TorchScriptPolicy::run(const at::Tensor& obs) const {
  at::NoGradGuard no_grad;
  const at::IValue result = module_->module.get_method("forward")({obs});
  if (!result.isTensor()) throw InputError(cat(name_, ": the module returns no tensor"));
  return result.toTensor();
}

void TorchScriptPolicy::bind(const SimSpec& spec) {
  actions_ = spec.params.actions;
  observation_size_ = spec.observation_size();
  const int64_t wanted = actions_ == ActionKind::discrete ? kNDiscreteActions : kActionSize;
  const at::Tensor obs = at::zeros({2, observation_size_}, at::TensorOptions().device(torch_device(device_)));
  const std::string what = cat("scenario '", spec.name, "' (", observation_size_, " numbers in, ", wanted,
                               actions_ == ActionKind::discrete ? " logits out)" : " means out)");
  at::Tensor out;
  try {
    out = run(obs);
  } catch (const c10::Error& e) {
    throw InputError(cat(name_, " does not play ", what, ": ", short_message(e)));
  } catch (const std::runtime_error& e) {
    if (dynamic_cast<const Error*>(&e)) throw;
    throw InputError(cat(name_, " does not play ", what, ": ", short_message(e)));
  }
  if (out.dim() != 2 || out.size(0) != 2 || out.size(1) != wanted || !out.is_floating_point()) {
    std::string shape;
    for (const int64_t side : out.sizes()) shape += cat(shape.empty() ? "" : ", ", side);
    throw InputError(
        cat(name_, " does not play ", what, ": for two observations it returns ", out.scalar_type(), " [", shape, "]"));
  }
}

at::Tensor TorchScriptPolicy::forward(const at::Tensor& obs) const {
  const at::Tensor out = run(obs.slice(1, 0, observation_size_)).to(at::kFloat);
  if (actions_ == ActionKind::continuous) return out.contiguous();
  at::Tensor logits = at::zeros({out.size(0), kLogitStride}, out.options());
  logits.slice(1, 0, kNDiscreteActions).copy_(out);
  return logits;
}

at::Tensor TorchScriptPolicy::log_std() const {
  if (has_log_std()) return log_std_;
  return at::zeros({kActionSize}, at::TensorOptions().device(torch_device(device_)));
}

}  // namespace giga
