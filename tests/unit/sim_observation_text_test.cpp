// Each kind of observation describes all its numbers.
#include "sim/observation_text.hpp"

#include <gtest/gtest.h>

#include "sim/observations.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

TEST(SimObservationText, DescriptionsAreAsLongAsTheObservations) {
  for (unsigned mask = 0; mask < kNSwitchMasks; mask += 7) {
    SimSpec spec = random_spec(mask, 1 + static_cast<int>(mask % 3), 2);
    set_switches(spec, mask);
    spec.finish();
    for_each_observation([&](auto kind) {
      int numbers = 0;
      for (const ObservationPart& part : describe(kind.id, spec.params)) {
        numbers += part.count * part.size();
        EXPECT_FALSE(part.name.empty() || part.meaning.empty());
        for (const FeatureText& feature : part.features)
          EXPECT_FALSE(feature.name.empty() || feature.meaning.empty()) << part.name;
      }
      EXPECT_EQ(numbers, kind.shape(spec.params).size()) << kind.name << ", mask " << mask;
    });
  }
}

}  // namespace
}  // namespace giga::test
