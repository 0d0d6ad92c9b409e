// Exports as Python sees them: act.py of each loads its policy with the library of its format, and gives the same
// numbers as the actor that was exported.
#include <gtest/gtest.h>

#include "config/fields.hpp"
#include "export/export.hpp"
#include "io/temporary_folder.hpp"
#include "policies.hpp"
#include "python.hpp"

namespace giga::test {
namespace {

constexpr int kRows = 33;
/// Exports an actor of every kind, with the numbers that it gives beside it.
void compare_with_python(ExportFormat format) {
  const TemporaryFolder folder;
  const at::Tensor obs = random_observations(kRows);
  write_tensor(folder / "obs.f32", obs.slice(1, 0, kInputs));
  for (const ActorKind& kind : all_kinds()) {
    const Actor actor = make_random_actor(kind);
    const int outputs = kind.actions == ActionKind::discrete ? kNDiscreteActions : kActionSize;
    PolicyOrigin origin = sample_origin();
    if (kind.layer_norm) origin.selection = ActionSelection::greedy;
    write_export(folder / kind.name(), format, actor, small_spec(kind.actions), origin);
    write_tensor(folder / (kind.name() + ".f32"), third_head(actor, obs).slice(1, 0, outputs));
  }
  expect_agreement(folder, all_kinds().size());
}

/// The same of policies that read the egocentric view: they compute it from the vector observation.
void compare_view_with_python(ExportFormat format) {
  const TemporaryFolder folder;
  size_t n = 0;
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous})
    for (const bool normalizes : {false, true}) {
      ActorKind kind{actions, Activation::tanh, false, normalizes, actions == ActionKind::discrete};
      if (normalizes) kind.memory = MemoryKind::gru;
      const SimSpec spec = small_spec_with_view(actions);
      const at::Tensor rows = played_rows(spec, kRows);
      const Actor actor = make_actor_with_view(kind);
      const int outputs = actions == ActionKind::discrete ? kNDiscreteActions : kActionSize;
      write_tensor(folder / "obs.f32", rows.slice(1, 0, kInputs));
      write_export(folder / kind.name(), format, actor, spec, sample_origin());
      write_tensor(folder / (kind.name() + ".f32"), third_head(actor, padded(rows, spec)).slice(1, 0, outputs));
      ++n;
    }
  expect_agreement(folder, n);
}

/// The same of policies that take images.
void compare_images_with_python(ExportFormat format) {
  const TemporaryFolder folder;
  write_tensor(folder / "obs.f32", at::zeros({0}));
  for (const ActorKind& kind : image_kinds()) {
    const Actor actor = make_random_actor(kind);
    const at::Tensor images = varied_images(5, kind.image_side());
    const int outputs = kind.actions == ActionKind::discrete ? kNDiscreteActions : kActionSize;
    write_export(folder / kind.name(), format, actor, small_spec_with_images(kind), sample_origin());
    write_tensor(folder / (kind.name() + ".u8"), images);
    write_tensor(folder / (kind.name() + ".f32"), third_head(actor, images).slice(1, 0, outputs));
  }
  expect_agreement(folder, image_kinds().size());
}

TEST(ExportPython, SafetensorsGiveTheSameNumbers) { compare_with_python(ExportFormat::safetensors); }
TEST(ExportPython, OnnxRuntimeGivesTheSameNumbers) { compare_with_python(ExportFormat::onnx); }
TEST(ExportPython, TorchScriptGivesTheSameNumbers) { compare_with_python(ExportFormat::torchscript); }
TEST(ExportPython, SafetensorsComputeTheView) { compare_view_with_python(ExportFormat::safetensors); }
TEST(ExportPython, OnnxRuntimeComputesTheView) { compare_view_with_python(ExportFormat::onnx); }
TEST(ExportPython, TorchScriptComputesTheView) { compare_view_with_python(ExportFormat::torchscript); }
TEST(ExportPython, SafetensorsTakeImages) { compare_images_with_python(ExportFormat::safetensors); }
TEST(ExportPython, OnnxRuntimeTakesImages) { compare_images_with_python(ExportFormat::onnx); }
TEST(ExportPython, TorchScriptTakesImages) { compare_images_with_python(ExportFormat::torchscript); }

}  // namespace
}  // namespace giga::test
