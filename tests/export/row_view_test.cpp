// The egocentric view as exported policies compute it from the row of the vector observation, against the simulator's.
#include "export/row_view.hpp"

#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <torch/csrc/jit/runtime/graph_executor.h>
#include <torch/script.h>

#include <algorithm>
#include <functional>

#include "config/fields.hpp"
#include "export/export.hpp"
#include "io/temporary_folder.hpp"
#include "policies.hpp"
#include "python.hpp"
#include "scenario/compile.hpp"
#include "scenario/data_dirs.hpp"
#include "scenario/loader.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// The function of the row, as LibTorch runs the code that TorchScript modules get.
class ComputedView {
 public:
  explicit ComputedView(const RowView& view) : module_("View") {
    PythonWriter writer("torch", "    ");
    const Array x = with_view(view, {&writer, "obs"});
    module_.define("def forward(self, obs: Tensor) -> Tensor:\n" + writer.code() + "    return " + x.text + "\n");
  }
  at::Tensor operator()(const at::Tensor& row) {
    torch::jit::GraphOptimizerEnabledGuard as_written(false);
    return module_.forward({row}).toTensor();
  }

 private:
  torch::jit::Module module_;
};

/// By how much numbers may differ: 1e-5, but more where the last bit of a place in the row decides: the bearing of what
/// is very near, the distance of a wall that a line grazes. There it is twice what that bit changes.
at::Tensor tolerance(const RowView& view, ComputedView& computed, const at::Tensor& row) {
  const int agents = (1 + view.neighbors) * kNeighborFeatures;
  std::vector<std::pair<int, int>> places = {{kX, kNeighborFeatures}, {kY, kNeighborFeatures}};  // from, up to
  if (view.neighbors > 0)
    places.insert(places.end(), {{kNeighborFeatures + kX, agents}, {kNeighborFeatures + kY, agents}});
  if (view.waypoint) places.insert(places.end(), {{agents, agents + 1}, {agents + 1, agents + 2}});
  const at::Tensor here = computed(row);
  at::Tensor limit = at::full_like(here, 1e-5);
  for (const auto& [from, to] : places)
    for (const double bit : {-0x1p-23, 0x1p-23}) {
      at::Tensor moved = row.clone();
      moved.slice(1, from, to, kNeighborFeatures).add_(bit);
      limit = at::maximum(limit, 2 * (computed(moved) - here).abs());
    }
  return limit;
}

void expect_same_view(const SimSpec& spec, int64_t n_rows) {
  SCOPED_TRACE(spec.name);
  const RowView view = row_view(spec).value();
  ComputedView computed(view);
  const at::Tensor expected = played_rows(spec, n_rows), row = expected.slice(1, 0, view.row_size()).contiguous();
  const at::Tensor actual = computed(row), limit = tolerance(view, computed, row);
  ASSERT_EQ(actual.sizes(), expected.sizes());
  const at::Tensor wrong = (actual - expected).abs() > limit, places = wrong.nonzero();
  if (places.size(0) > 0) {
    ADD_FAILURE() << places.size(0) << " numbers; row and column " << places[0] << ": "
                  << actual.masked_select(wrong)[0] << " not " << expected.masked_select(wrong)[0] << " by "
                  << limit.masked_select(wrong)[0];
  }
  const auto numbers = static_cast<double>(expected.size(0) * view.view_size());
  // The larger the map, the more a last bit of a share of it is.
  const double rare = 1e-2 * std::max(1.0, static_cast<double>(view.limit_x) / 100);
  EXPECT_LT((limit > 1.01e-5).sum().item<double>() / numbers, rare) << "numbers that a last bit decides are rare";
}

/// A policy whose logits are numbers of the view, from `first` on: x = relu(x) - relu(-x), to the last bit.
Actor actor_that_shows(const SimSpec& spec, int first, int count) {
  ActorConfig config;
  config.hidden = {2 * kNDiscreteActions};
  config.activation = Activation::relu;
  config.inputs = NetworkInputs::egocentric;
  Actor actor(config, input_columns(config.inputs, spec), ActionKind::discrete, false, Precision::fp32, at::kCPU, 1);
  at::NoGradGuard no_grad;
  actor.parameters().values().zero_();
  const at::Tensor &in = actor.parameters()[0], &out = actor.parameters()[2];
  for (int k = 0; k < count; ++k)
    for (int sign = 0; sign < 2; ++sign) {
      in[2 * k + sign][first + k] = 1 - 2 * sign;
      out[k][2 * k + sign] = 1 - 2 * sign;
    }
  return actor;
}

/// What ONNX Runtime makes of the graph and Python of act.py: all numbers of the view, 27 of them in each policy.
void expect_same_view_in_python(const SimSpec& spec, int64_t n_rows) {
  SCOPED_TRACE(spec.name);
  const TemporaryFolder folder;
  const RowView view = row_view(spec).value();
  ComputedView computed(view);
  const at::Tensor rows = played_rows(spec, n_rows), row = rows.slice(1, 0, view.row_size()).contiguous();
  const at::Tensor limits = tolerance(view, computed, row);
  write_tensor(folder / "obs.f32", row);
  size_t n = 0;
  for (int first = 0; first < view.view_size(); first += kNDiscreteActions) {
    const int count = std::min(kNDiscreteActions, view.view_size() - first);
    const auto logits = [&](const at::Tensor& all, double others) {
      return at::constant_pad_nd(all.narrow(1, view.view_at() + first, count), {0, kNDiscreteActions - count}, others);
    };
    for (const ExportFormat format : {ExportFormat::onnx, ExportFormat::safetensors}) {
      const std::string name = cat(FieldCodec<ExportFormat>::print(format), first);
      write_export(folder / name, format, actor_that_shows(spec, first, count), spec, sample_origin());
      write_tensor(folder / (name + ".f32"), logits(rows, 0));
      write_tensor(folder / (name + ".limit.f32"), logits(limits, 1e-5));
      ++n;
    }
  }
  expect_agreement(folder, n);
}

/// Calls `check` with scenarios that offer the view, every `stride`-th of those that come with gigastep.
void for_scenarios(int stride, const std::function<void(const SimSpec&)>& check) {
  int n_scenarios = 0;
  for (const ScenarioInfo& info : list_scenarios(data_dirs())) {
    Scenario scenario = load_scenario(info.name, data_dirs());
    scenario.observation.egocentric_view = true;
    int n_agents = 0;
    for (const auto* team : {&scenario.team_0, &scenario.team_1})
      for (const auto& group : *team) n_agents += group.count;
    if (n_agents > 2000) continue;  // as those of 1,000 against 1,000, with other counts
    if (n_scenarios++ % stride == 0) check(compile(scenario));
  }
  EXPECT_GT(n_scenarios, 20);
}

TEST(ExportRowView, EqualsTheSimulatorsInEveryScenario) {
  const int stride = thinned(6);
  for_scenarios(stride, [&](const SimSpec& spec) { expect_same_view(spec, stride == 1 ? 10'000 : 1'000); });
}

TEST(ExportRowView, GraphsAndActPyGiveTheSimulatorsInEveryScenario) {
  const int stride = thinned(12);
  // In full where the original's base scenarios are, of up to 40 agents; numpy takes its time.
  for_scenarios(stride, [&](const SimSpec& spec) {
    expect_same_view_in_python(spec, stride == 1 && spec.params.n_agents <= 40 ? 10'000 : 1'000);
  });
}

// All switches that change rows: waypoints, boxes with and without heights, mixed teams, few neighbors, original rules.
TEST(ExportRowView, EqualsTheSimulatorsWithEverySwitch) {
  const auto stride = static_cast<unsigned>(thinned(211));
  for (unsigned mask = 0; mask < kNSwitchMasks; mask += stride) {
    SimSpec spec = random_spec(mask, 1 + static_cast<int>(mask % 5), 3);
    set_switches(spec, mask);
    spec.params.actions = ActionKind::discrete;
    spec.params.egocentric_view = true;
    spec.neighbor_limit = 1 + static_cast<int>(mask % 4);
    spec.agents[0].sprite = 6;
    spec.finish();
    expect_same_view(spec, 500);
  }
}

}  // namespace
}  // namespace giga::test
