#include "learn/mappo/view_teacher.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include "learn/team_policy.hpp"

namespace giga {

ViewTeacher::ViewTeacher(const LoadedRun& run, int team, const Actor& actor, at::Device device)
    : coef_(run.config.mappo.view_coef),
      view_(input_columns(NetworkInputs::egocentric, run.spec)),
      bfloat16_(actor.precision() == Precision::bf16) {
  layer_ = add_dense(parameters_, "view", {actor.network().encoder().features(), view_.size, 1.0f});
  parameters_.allocate(device, network_seed(run, team, 2));
  adam_ = Adam(parameters_, run.config.mappo.adam_epsilon);
}

at::Tensor ViewTeacher::told(const at::Tensor& features) const {
  const ReadParameters p(parameters_, bfloat16_);
  return dense(*p, layer_, features, Rounding::none).to(at::kFloat);
}

ViewTeacher::Loss ViewTeacher::loss(const at::Tensor& told, const at::Tensor& obs, const at::Tensor& alive,
                                    const at::Tensor& inv_count) const {
  at::NoGradGuard no_grad;
  const at::Tensor error = (told - columns_of(view_, obs)) * alive.unsqueeze(-1);
  const double share = 1.0 / static_cast<double>(view_.size);
  return {error * (inv_count * (2 * coef_ * share)), error.square().sum() * share};
}

void ViewTeacher::save(const std::string& prefix, NamedArrays& out) const {
  parameters_.save(prefix + "view/", out);
  adam_.save(prefix + "view_adam/", out);
}

void ViewTeacher::load(const std::string& prefix, const NamedArrays& in) {
  parameters_.load(prefix + "view/", in);
  adam_.load(prefix + "view_adam/", in);
}

}  // namespace giga
