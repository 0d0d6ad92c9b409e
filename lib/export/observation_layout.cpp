// Rows of observations block by block, from what each kind says of itself.
#include "export/observation_layout.hpp"

#include "config/fields.hpp"
#include "core/error.hpp"
#include "scenario/scenario.hpp"
#include "sim/row_layout.hpp"

namespace giga {
namespace {

/// "45 numbers: self 1 x 9, neighbors 4 x 9", "images of 84 x 84 pixels".
std::string layout_text(const PolicyInterface& policy) {
  if (policy.image_side > 0) return cat("images of ", policy.image_side, " x ", policy.image_side, " pixels");
  std::string text;
  for (const ObservationBlock& b : policy.observation)
    text += cat(text.empty() ? ": " : ", ", b.name, " ", b.count, " x ", b.size);
  return cat(policy.inputs, " numbers", text);
}

}  // namespace

std::vector<ObservationBlock> observation_layout(const SimSpec& spec) {
  const RowLayout rows = observation_rows(spec);
  std::vector<ObservationBlock> blocks;
  int at = 0;
  const auto add = [&](const std::string& name, int count, const std::string& meaning,
                       std::vector<FeatureText> features) {
    const int size = static_cast<int>(features.size());
    blocks.push_back({name, at, count, size, meaning, std::move(features)});
    at += count * size;
  };
  for (int k = 0; k < kNObservations; ++k) {
    const auto kind = static_cast<Observation>(k);
    if (!rows.set().has(kind)) continue;
    const auto gap = static_cast<size_t>(rows.columns(kind).first) - static_cast<size_t>(at);
    if (gap > 0)
      add("unused", 1, "zeros, so that what follows starts at a multiple of 8",
          std::vector<FeatureText>(gap, {"zero", "0"}));
    for (const ObservationPart& part : describe(kind, spec.params))
      add(part.name, part.count, part.meaning, part.features);
  }
  GIGA_CHECK(at == rows.numbers(), "the layout has ", at, " numbers, observations ", rows.numbers());
  return blocks;
}

bool PolicyInterface::fits(const PolicyInterface& other) const {
  if (actions != other.actions || image_side != other.image_side) return false;
  return image_side > 0 || (inputs == other.inputs && observation == other.observation);
}

PolicyInterface interface_of(const SimSpec& spec, bool reads_image) {
  return {spec.name, spec.params.actions, spec.observation_size(), observation_layout(spec),
          reads_image ? spec.params.resolution : 0};
}

void check_fits(const PolicyInterface& policy, const SimSpec& spec, const std::string& source,
                const std::string& reasons) {
  const bool reads_image = policy.image_side > 0;
  if (spec.params.images_only && !reads_image)
    throw InputError(cat(source, " reads numbers, and agents of '", spec.name,
                         "' are given images alone (observation.type: rgb)", reasons));
  const PolicyInterface here = interface_of(spec, reads_image);
  if (policy.fits(here)) return;
  const auto kind = [](ActionKind actions) { return FieldCodec<ActionKind>::print(actions); };
  if (policy.actions != here.actions)
    throw InputError(cat(source, " was trained in '", policy.scenario, "' with ", kind(policy.actions),
                         " actions; those of '", here.scenario, "' are ", kind(here.actions), reasons));
  const std::string there_text = layout_text(policy);
  const std::string here_text = reads_image && here.image_side == 0 ? "no images" : layout_text(here);
  if (!reasons.empty())  // first, for they are what can be changed
    throw InputError(cat(source, " was trained in '", policy.scenario, "', ",
                         policy.scenario == here.scenario ? "with other settings" : cat("not in '", here.scenario, "'"),
                         reasons, "; an agent observes ", there_text, " there, ", here_text, " here"));
  throw InputError(cat(source, " was trained in '", policy.scenario, "', where an agent observes ", there_text,
                       "; in '", here.scenario, "' it observes ", here_text));
}

}  // namespace giga
