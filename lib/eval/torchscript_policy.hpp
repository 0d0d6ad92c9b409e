// TorchScriptPolicy: a TorchScript module from anywhere as a policy: obs [B, F] -> logits [B, 27] or means [B, 3].
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "core/memory.hpp"
#include "policy/policy.hpp"

namespace giga {

/// The module's `forward` gets observations without padding, F = SimSpec::observation_size(), and returns logits for
/// discrete actions, or means before squashing by tanh for continuous ones. For the latter an attribute or parameter
/// `log_std` [3] of the module, if it has one, says how far actions scatter around the means.
class TorchScriptPolicy final : public Policy {
 public:
  /// Loads a file, which runs what is in it: only from where it can be trusted. Throws InputError where LibTorch cannot
  /// read it.
  static std::shared_ptr<TorchScriptPolicy> load(const std::filesystem::path& file, Device device);
  ~TorchScriptPolicy() override;

  /// Prepares for a scenario, until the next call; tries the module, and throws InputError where it does not take such
  /// observations or return such actions.
  void bind(const SimSpec& spec);
  /// Whether its continuous actions scatter; else the means are played.
  bool has_log_std() const { return log_std_.defined(); }

  at::Tensor forward(const at::Tensor& obs) const override;
  ActionKind actions() const override { return actions_; }
  at::Tensor log_std() const override;

 private:
  struct Module;
  TorchScriptPolicy(std::string name, std::unique_ptr<Module> module, Device device);
  at::Tensor run(const at::Tensor& obs) const;

  std::string name_;
  std::unique_ptr<Module> module_;
  Device device_;
  ActionKind actions_ = ActionKind::discrete;
  int64_t observation_size_ = 0;
  at::Tensor log_std_;
};

}  // namespace giga
