// Exports that are read back: the same policy, and clear words for what cannot be one.
#include <gtest/gtest.h>

#include <filesystem>

#include "config/fields.hpp"
#include "cuda/runtime.hpp"
#include "export/export.hpp"
#include "export/safetensors.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "policies.hpp"
#include "scenario/scenario.hpp"

namespace giga::test {
namespace {
namespace fs = std::filesystem;

void write(const fs::path& folder, ExportFormat format, const ActorKind& kind = {}) {
  write_export(folder, format, make_random_actor(kind), small_spec(kind.actions), sample_origin());
}

ReadPolicy read(const fs::path& path, const SimSpec& spec, bool trust, Device device = {}) {
  return read_exported_policy(find_exported_policy(path, trust), spec, device);
}

/// The message of the InputError when a policy is read for a scenario of discrete actions.
std::string export_refusal(const fs::path& path, bool trust = true) {
  return input_error_of([&] { read(path, small_spec(ActionKind::discrete), trust); });
}

double worst(const at::Tensor& a, const at::Tensor& b) { return (a - b).abs().max().item<double>(); }

at::Tensor without_unused_logit(const at::Tensor& head) { return head.slice(1, 0, kNDiscreteActions); }

TEST(ExportRoundTrip, SafetensorsGiveTheSameActor) {
  const TemporaryFolder folder;
  const at::Tensor obs = random_observations(33);
  for (const ActorKind& kind : all_kinds()) {
    SCOPED_TRACE(kind.name());
    const Actor actor = make_random_actor(kind);
    const SimSpec spec = small_spec(kind.actions);
    write(folder / kind.name(), ExportFormat::safetensors, kind);
    const auto policy = read(folder / kind.name(), spec, false).policy;
    ASSERT_EQ(policy->actions(), kind.actions);
    const at::Tensor head = third_head(*policy, obs), expected = third_head(actor, obs);
    ASSERT_EQ(head.sizes(), expected.sizes());
    EXPECT_TRUE(at::equal(without_unused_logit(head), without_unused_logit(expected)));
    EXPECT_TRUE(kind.actions == ActionKind::discrete || at::equal(policy->log_std(), actor.log_std()));
  }
}

TEST(ExportRoundTrip, TorchScriptGivesTheSameNumbers) {
  const TemporaryFolder folder;
  const at::Tensor obs = random_observations(33);
  for (const ActorKind& kind : all_kinds()) {
    SCOPED_TRACE(kind.name());
    const Actor actor = make_random_actor(kind);
    write(folder / kind.name(), ExportFormat::torchscript, kind);
    const auto policy = read(folder / kind.name(), small_spec(kind.actions), true).policy;
    ASSERT_EQ(policy->actions(), kind.actions);
    const at::Tensor head = third_head(*policy, obs), expected = third_head(actor, obs);
    ASSERT_EQ(head.sizes(), expected.sizes());
    ASSERT_TRUE(head.is_contiguous());
    EXPECT_LE(worst(without_unused_logit(head), without_unused_logit(expected)), 1e-5);
    EXPECT_TRUE(kind.actions == ActionKind::discrete || at::equal(policy->log_std(), actor.log_std()));
  }
}

TEST(ExportRoundTrip, PoliciesOfImages) {
  const TemporaryFolder folder;
  for (const ActorKind& kind : image_kinds()) {
    const Actor actor = make_random_actor(kind);
    SimSpec spec = small_spec_with_images(kind);
    const at::Tensor images = varied_images(5, kind.image_side()), expected = third_head(actor, images);
    EXPECT_GT(worst(expected[0], expected[1]), 1e-3) << "other images, other numbers";
    for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
      SCOPED_TRACE(kind.name() + FieldCodec<ExportFormat>::print(format));
      const fs::path path = folder / (kind.name() + FieldCodec<ExportFormat>::print(format));
      write_export(path, format, actor, spec, sample_origin());
      const auto policy = read(path, spec, true).policy;
      EXPECT_TRUE(policy->reads_image());
      EXPECT_EQ(policy->state_size(), actor.state_size());
      const at::Tensor head = third_head(*policy, images);
      if (format == ExportFormat::safetensors) {
        EXPECT_TRUE(at::equal(without_unused_logit(head), without_unused_logit(expected)));
      }
      EXPECT_LE(worst(without_unused_logit(head), without_unused_logit(expected)), 1e-5);
      SimSpec larger = spec, none = spec;
      larger.params.resolution = 50;
      none.params.resolution = 0;
      none.params.images_only = false;
      const std::string trained = cat("where an agent observes images of ", kind.image_side(), " x ");
      EXPECT_TRUE(contains(input_error_of([&] { read(path, larger, true); }),
                           {trained.c_str(), "pixels; in 'small' it observes images of 50 x 50 pixels"}));
      EXPECT_TRUE(contains(input_error_of([&] { read(path, none, true); }), {"in 'small' it observes no images"}));
    }
  }
}

TEST(ExportRoundTripGpu, PoliciesPlayOnTheGpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const TemporaryFolder folder;
  const at::Tensor obs = random_observations(33);
  for (const ActorKind& kind : all_kinds()) {
    const at::Tensor expected = without_unused_logit(third_head(make_random_actor(kind), obs));
    for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
      const std::string name = kind.name() + "_" + FieldCodec<ExportFormat>::print(format);
      write(folder / name, format, kind);
      const auto policy = read(folder / name, small_spec(kind.actions), true, {Device::Kind::cuda, 0}).policy;
      const at::Tensor head = third_head(*policy, obs.to(at::kCUDA));
      EXPECT_LT(worst(without_unused_logit(head).cpu(), expected), 1e-2) << name;  // matrix products may be TF32
    }
  }
}

TEST(ExportRoundTripGpu, PoliciesOfImagesPlayOnTheGpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const TemporaryFolder folder;
  for (const ActorKind& kind : image_kinds()) {
    const at::Tensor images = varied_images(5, kind.image_side());
    const at::Tensor expected = without_unused_logit(third_head(make_random_actor(kind), images));
    for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
      const std::string name = kind.name() + "_" + FieldCodec<ExportFormat>::print(format);
      const SimSpec spec = small_spec_with_images(kind);
      write_export(folder / name, format, make_random_actor(kind), spec, sample_origin());
      const auto policy = read(folder / name, spec, true, {Device::Kind::cuda, 0}).policy;
      const at::Tensor head = third_head(*policy, images.to(at::kCUDA));
      EXPECT_LT(worst(without_unused_logit(head).cpu(), expected), 1e-2) << name;  // products may be TF32
    }
  }
}

TEST(ExportRoundTrip, FilesAndFoldersAreRecognised) {
  const TemporaryFolder folder;
  write(folder / "tensors", ExportFormat::safetensors);
  EXPECT_TRUE(is_exported_policy(folder / "tensors"));
  EXPECT_TRUE(is_exported_policy(folder / "tensors/policy.safetensors"));
  EXPECT_TRUE(is_exported_policy("elsewhere/module.pt"));
  EXPECT_FALSE(is_exported_policy(folder.path()));
  EXPECT_FALSE(is_exported_policy("runs/first/checkpoints/best.h5"));
  write(folder / "module", ExportFormat::torchscript);
  fs::rename(folder / "module/policy.pt", folder / "module/of_another_name");
  EXPECT_TRUE(is_exported_policy(folder / "module/of_another_name"));
  EXPECT_EQ(export_refusal(folder / "tensors/policy.safetensors"), "no error");
}

TEST(ExportRoundTrip, WhatEvolvedToBeGreedyStaysSo) {
  const TemporaryFolder folder;
  for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript})
    for (const ActionSelection selection : {ActionSelection::sampled, ActionSelection::greedy}) {
      PolicyOrigin origin = sample_origin();
      origin.selection = selection;
      const fs::path path = folder / cat(policy_file_name(format), static_cast<int>(selection));
      write_export(path, format, make_random_actor({}), small_spec(ActionKind::discrete), origin);
      const bool greedy = selection == ActionSelection::greedy;
      EXPECT_EQ(read(path, small_spec(ActionKind::discrete), true).greedy, greedy) << path;
      EXPECT_EQ(read(path / policy_file_name(format), small_spec(ActionKind::discrete), true).greedy, greedy) << path;
    }
}

TEST(ExportRoundTrip, FilesOfAnExport) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "empty");  // may be there, if empty
  write(folder / "empty", ExportFormat::onnx);
  for (const char* name : {"policy.onnx", "manifest.json", "act.py"})
    EXPECT_TRUE(fs::is_regular_file(folder / "empty" / name)) << name;
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "empty"), {}), 3);
}

TEST(ExportRoundTrip, NothingIsOverwritten) {
  const TemporaryFolder folder;
  write_file(folder / "notes.txt", "mine");
  EXPECT_TRUE(contains(input_error_of([&] { write(folder.path(), ExportFormat::onnx); }), {"is not empty"}));
  EXPECT_TRUE(contains(input_error_of([&] { write(folder / "notes.txt", ExportFormat::onnx); }), {"is a file"}));
  EXPECT_TRUE(contains(input_error_of([&] { write(folder / "notes.txt/x", ExportFormat::onnx); }), {"cannot create"}));
  EXPECT_EQ(folder.entries(), 1);
  EXPECT_EQ(read_file(folder / "notes.txt"), "mine");
}

TEST(ExportRoundTrip, WhatCannotPlayIsSaid) {
  const TemporaryFolder folder;
  write(folder / "onnx", ExportFormat::onnx);
  write(folder / "module", ExportFormat::torchscript);
  write(folder / "tensors", ExportFormat::safetensors);
  EXPECT_TRUE(contains(export_refusal(folder / "onnx"), {"policy.onnx is an ONNX graph", "--format safetensors"}));
  EXPECT_TRUE(contains(export_refusal(folder / "onnx/policy.onnx"), {"policy.onnx is an ONNX graph"}));
  EXPECT_TRUE(
      contains(export_refusal(folder / "module", false),
               {"policy.pt is a TorchScript module", "add --trust to eval, rate or record", "--format safetensors"}));
  EXPECT_TRUE(contains(export_refusal(folder / "nothing"), {"there is no exported policy", "nothing"}));
  EXPECT_TRUE(contains(export_refusal(folder / "tensors/act.py"), {"act.py is no exported policy", ".safetensors"}));
  fs::remove(folder / "tensors/manifest.json");
  fs::remove(folder / "onnx/manifest.json");
  fs::remove(folder / "module/manifest.json");
  for (const char* path : {"tensors", "tensors/policy.safetensors"})
    EXPECT_TRUE(contains(export_refusal(folder / path),
                         {"policy.safetensors has no manifest.json beside it", "or export the policy again"}))
        << path;
  for (const char* path : {"tensors", "onnx", "module"}) EXPECT_TRUE(is_exported_policy(folder / path)) << path;
  EXPECT_TRUE(contains(export_refusal(folder / "module"), {"policy.pt has no manifest.json beside it"}));
  EXPECT_TRUE(contains(export_refusal(folder / "onnx"), {"policy.onnx is an ONNX graph"}));
  EXPECT_EQ(export_refusal(folder / "module/policy.pt"), "no error") << "a module may be from elsewhere";
  EXPECT_TRUE(contains(export_refusal(folder / "module", false), {"has no manifest.json"})) << "first";
  fs::create_directory(folder / "module/checkpoints");
  EXPECT_FALSE(is_exported_policy(folder / "module")) << "a run, into which somebody has exported";
}

TEST(ExportRoundTrip, OfAnotherScenario) {
  const TemporaryFolder folder;
  write(folder / "continuous", ExportFormat::safetensors, {ActionKind::continuous});
  EXPECT_TRUE(contains(export_refusal(folder / "continuous"),
                       {"trained in 'small' with continuous actions; those of 'small' are discrete"}));
  write(folder / "tensors", ExportFormat::safetensors);
  SimSpec bigger = small_spec(ActionKind::discrete);
  bigger.maps[0].boxes.push_back({3, 3, 4, 4, 0, 10});
  bigger.finish();
  const std::string message = input_error_of([&] { read(folder / "tensors", bigger, false); });
  EXPECT_TRUE(contains(message, {"49 numbers: self 1 x 9, neighbors 3 x 9, waypoint 1 x 5, boxes 2 x 4; in",
                                 "53 numbers: self 1 x 9, neighbors 3 x 9, waypoint 1 x 5, boxes 3 x 4"}));
  write(folder / "module", ExportFormat::torchscript);
  fs::rename(folder / "module/policy.pt", folder / "alone.pt");
  const std::string alone = input_error_of([&] { read(folder / "alone.pt", bigger, true); });
  EXPECT_TRUE(contains(alone, {"alone.pt is no TorchScript module that can play here"}));
}

TEST(ExportRoundTrip, DamagedFiles) {
  const TemporaryFolder folder;
  write(folder / "tensors", ExportFormat::safetensors);
  const fs::path file = folder / "tensors/policy.safetensors";
  const NamedArrays good = decode_safetensors(read_file(file), "good");
  const auto refusal_of = [&](const NamedArrays& tensors) {
    write_file(file, encode_safetensors(tensors, {}));
    return export_refusal(file);
  };
  EXPECT_EQ(refusal_of(good), "no error");
  NamedArrays fewer(good.begin() + 1, good.end());
  EXPECT_TRUE(contains(refusal_of(fewer), {"tensor 'layers.0.weight' is missing"}));
  NamedArrays more = good;
  more.push_back(make_array<float>("extra", {1}));
  EXPECT_TRUE(contains(refusal_of(more), {"tensor 'extra' has no place"}));
  NamedArrays turned = good;
  std::swap(turned[0].shape[0], turned[0].shape[1]);
  EXPECT_TRUE(contains(refusal_of(turned), {"layers.0.weight' has shape [49, 12]", "needs [12, 49]"}));
  NamedArrays wide = good;
  wide[1] = make_array<double>("layers.0.bias", std::vector<double>(12));
  EXPECT_TRUE(contains(refusal_of(wide), {"layers.0.bias' is not of type F32"}));
  NamedArrays infinite = good;
  infinite[1] = make_array<float>("layers.0.bias", std::vector<float>(12, 1.0f / 0.0f));
  EXPECT_TRUE(contains(refusal_of(infinite), {"layers.0.bias': number 0 is inf; it must be finite"}));
  write_file(file, "");
  EXPECT_TRUE(contains(export_refusal(file), {"policy.safetensors is no safetensors file"}));
  write_file(folder / "junk.pt", "not a module");
  EXPECT_TRUE(contains(export_refusal(folder / "junk.pt"), {"junk.pt is no TorchScript module"}));
}

TEST(ExportRoundTrip, DeviationsArePositive) {
  const TemporaryFolder folder;
  const ActorKind kind{ActionKind::discrete, Activation::tanh, false, true};
  write(folder / "tensors", ExportFormat::safetensors, kind);
  const fs::path file = folder / "tensors/policy.safetensors";
  NamedArrays tensors = decode_safetensors(read_file(file), "good");
  for (NamedArray& tensor : tensors)
    if (tensor.name == kStdTensor) tensor = make_array<float>(kStdTensor, std::vector<float>(kInputs, 0));
  for (NamedArray& tensor : tensors)
    tensor.shape = tensor.name == kStdTensor ? std::vector<int64_t>{kInputs} : tensor.shape;
  write_file(file, encode_safetensors(tensors, {}));
  EXPECT_TRUE(contains(export_refusal(file), {"observation.std': number 0 is 0; a deviation must be > 0"}));
}

// Where the scenario offers the view, its numbers are those of the training; elsewhere the policy computes them.
TEST(ExportRoundTrip, APolicyComputesTheEgocentricView) {
  const TemporaryFolder folder;
  for (const ActorKind& kind : {ActorKind{ActionKind::discrete, Activation::tanh, false, false, true},
                                ActorKind{ActionKind::continuous, Activation::tanh, false, true, false}}) {
    const SimSpec with = small_spec_with_view(kind.actions), without = small_spec(kind.actions);
    const Actor actor = make_actor_with_view(kind);
    const at::Tensor rows = played_rows(with, 33), expected = actor.forward(padded(rows, with));
    for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
      SCOPED_TRACE(kind.name() + FieldCodec<ExportFormat>::print(format));
      const fs::path path = folder / (kind.name() + FieldCodec<ExportFormat>::print(format));
      write_export(path, format, actor, with, sample_origin());
      const Manifest manifest = read_manifest(path / kManifestName);
      EXPECT_EQ(manifest.shape.view, row_view(with));
      EXPECT_EQ(interface_of(manifest).inputs, kInputs);
      const at::Tensor here = read(path, with, true).policy->forward(padded(rows, with));
      const at::Tensor alone = read(path, without, true).policy->forward(padded(rows.slice(1, 0, kInputs), without));
      EXPECT_LE(worst(without_unused_logit(alone), without_unused_logit(expected)), 1e-4);
      if (format == ExportFormat::safetensors) {
        EXPECT_TRUE(at::equal(without_unused_logit(here), without_unused_logit(expected)));
      }
      EXPECT_LE(worst(without_unused_logit(here), without_unused_logit(expected)), 1e-4);
    }
  }
}

TEST(ExportRoundTrip, TheEgocentricViewAsInput) {
  const TemporaryFolder folder;
  const ActorKind kind{ActionKind::discrete, Activation::tanh, false, false, true};
  const SimSpec spec = small_spec_with_view(kind.actions);
  write_export(folder / "input", ExportFormat::safetensors, make_actor_with_view(kind), spec, sample_origin(),
               {ViewPlace::input});
  const Manifest manifest = read_manifest(folder / "input/manifest.json");
  EXPECT_FALSE(manifest.shape.view);
  EXPECT_EQ(interface_of(manifest).inputs, spec.observation_size());
  EXPECT_TRUE(contains(export_refusal(folder / "input"), {"egocentric_self"}));  // small_spec offers no view
}

TEST(ExportRoundTrip, AModuleComputesTheViewOfMapsOfItsSize) {
  const TemporaryFolder folder;
  const ActorKind kind{ActionKind::discrete, Activation::tanh, false, false, true};
  const Actor actor = make_actor_with_view(kind);
  SimSpec wider = small_spec(kind.actions);
  wider.params.limit_x = 12;
  wider.finish();
  for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
    const fs::path path = folder / FieldCodec<ExportFormat>::print(format);
    write_export(path, format, actor, small_spec_with_view(kind.actions), sample_origin());
    const std::string message = input_error_of([&] { read(path, wider, true); });
    EXPECT_TRUE(contains(message, {format == ExportFormat::torchscript ? "view of maps of 10 x 10; those of 'small' "
                                                                         "are 12 x 10"
                                                                       : "no error"}));
  }
}

// The first step of an episode and a later one differ, and so do both formats' modules.
TEST(ExportRoundTrip, AMemoryIsExportedToo) {
  const TemporaryFolder folder;
  const at::Tensor obs = random_observations(5);
  for (const MemoryKind memory : {MemoryKind::gru, MemoryKind::lstm}) {
    ActorKind kind;
    kind.memory = memory;
    for (const ExportFormat format : {ExportFormat::safetensors, ExportFormat::torchscript}) {
      const fs::path to = folder / (kind.name() + FieldCodec<ExportFormat>::print(format));
      write(to, format, kind);
      const Manifest manifest = read_manifest(to / "manifest.json");
      EXPECT_EQ(manifest.shape.memory, memory);
      EXPECT_EQ(manifest.shape.memory_size, 9);
      const auto policy = read(to, small_spec(kind.actions), true).policy;
      EXPECT_EQ(policy->state_size(), memory == MemoryKind::lstm ? 18 : 9);
      EXPECT_GT(worst(policy->forward(obs), third_head(*policy, obs)), 0.01);
    }
  }
}

}  // namespace
}  // namespace giga::test
