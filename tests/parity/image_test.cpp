// Images of the CPU back end against those of the GPU's, byte for byte: sizes that are and are not a multiple of what a
// thread moves, images that take several blocks, teams of any size, and images before a reset. Each test runs twice: on
// a GPU where there is one, and everywhere with the GPU's threads run by the CPU.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <tuple>

#include "core/error.hpp"
#include "cuda/draw.hpp"
#include "cuda/runtime.hpp"
#include "parity/emulated_simulator.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

struct ImageSize {
  int n_team_0, n_team_1, resolution;
  int n_worlds, n_variants;
};
void PrintTo(const ImageSize& c, std::ostream* out) {
  *out << c.n_team_0 << " v " << c.n_team_1 << ", " << c.resolution << " pixels";
}
// 84: 16 bytes at a time. 38: 4. 21 and 9: single bytes. 150: four strips of 48 rows, of which the last has 6.
const ImageSize kImageSizes[] = {{2, 2, 38, 7, 8},   {5, 5, 84, 65, 8}, {7, 3, 21, 5, 8},
                                 {20, 20, 84, 5, 8}, {3, 1, 150, 5, 8}, {150, 50, 9, 2, 4}};

/// As many as the executor has time for.
ImageSize cut(ImageSize c, bool on_gpu) {
  if (on_gpu) return c;
  const bool large = c.n_team_0 >= 20 || c.resolution > 84;
  c.n_team_0 = std::min(c.n_team_0, 28);
  c.n_team_1 = std::min(c.n_team_1, 20);
  c.n_worlds = large ? 1 : 2;
  c.n_variants = large ? 2 : 4;
  return c;
}

class ImageParity : public ::testing::TestWithParam<std::tuple<bool, ImageSize>> {
 protected:
  void SetUp() override {
    if (on_gpu_ && cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  }
  SimSpec variant_of(int variant) const {
    SimSpec spec = random_spec(static_cast<uint64_t>(variant + 100 * case_.resolution), case_.n_team_0, case_.n_team_1);
    spec.params.rules = variant % 2 ? Rules::original : Rules::corrected;
    spec.params.waypoints = variant % 4 < 2;
    spec.params.resolution = case_.resolution;
    spec.params.max_episode_length = 2;
    return spec;
  }
  SimOptions options_of(int variant) const {
    constexpr OnDone kEndings[] = {OnDone::reset, OnDone::freeze, OnDone::keep, OnDone::freeze};
    SimOptions options;
    options.n_worlds = case_.n_worlds;
    options.seed = static_cast<uint64_t>(variant);
    options.on_done = kEndings[variant % 4];
    options.episodes = variant % 4 == 3 ? 2 : 1;
    return options;
  }
  std::unique_ptr<Simulator> other(const SimSpec& spec, const SimOptions& options, int variant) const {
    if (on_gpu_) return make_cuda_simulator(spec, options, 0);
    return make_emulated_simulator(spec, options, static_cast<ThreadOrder>(variant % 3));
  }

  const bool on_gpu_ = std::get<0>(GetParam());
  const ImageSize case_ = cut(std::get<1>(GetParam()), on_gpu_);
};

/// Pixels of the images of team 0 that are not black.
int64_t lit(const Snapshot& snapshot) {
  const auto& bytes = snapshot.field("image of team 0").bytes;
  return std::count_if(bytes.begin(), bytes.end(), [](uint8_t b) { return b != 0 && b != 0xFF; });
}

/// The ego images of a team drawn again from rows of the image state, the last world first.
std::vector<uint8_t> redrawn(Simulator& sim, int team, const std::vector<uint8_t>& states) {
  std::vector<int64_t> order;
  for (int world = sim.n_worlds() - 1; world >= 0; --world) order.push_back(world);
  const SimParams& p = sim.params();
  const Buffer<uint8_t> from(sim.memory(), states);
  const Buffer<int64_t> rows(sim.memory(), order);
  const auto bytes = static_cast<size_t>(image_bytes(p.resolution)) * static_cast<size_t>(p.n_team[team]);
  Buffer<uint8_t> images(sim.memory(), std::vector<uint8_t>(bytes * order.size(), 0xAA));
  sim.redraw({team, reinterpret_cast<const int32_t*>(from.data()), rows.data(), sim.n_worlds(), images.data()});
  sim.synchronize();
  return images.to_host();
}

/// Blocks of equal size, the last one first.
std::vector<uint8_t> reversed_blocks(const std::vector<uint8_t>& bytes, size_t n_blocks) {
  const size_t size = bytes.size() / n_blocks;
  std::vector<uint8_t> result;
  for (size_t block = n_blocks; block-- > 0;)
    result.insert(result.end(), bytes.begin() + static_cast<int64_t>(block * size),
                  bytes.begin() + static_cast<int64_t>((block + 1) * size));
  return result;
}

// What is learned from is what was acted on: images that are drawn again from the rows that were kept, of either back
// end, by either.
TEST_P(ImageParity, DrawnAgainFromTheImageState) {
  int64_t colored = 0;
  for (int variant = 0; variant < case_.n_variants; ++variant) {
    const SimSpec spec = variant_of(variant);
    const SimOptions options = options_of(variant);
    SimRunner a(make_cpu_simulator(spec, options));
    SimRunner b(other(spec, options, variant));
    a.start();
    b.start();
    for (int k = 0; k < 2; ++k) {
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
    }
    const Snapshot now = a.snapshot();
    const std::vector<uint8_t>& states = now.field("image_state").bytes;
    // Six words an agent and its row of bits, then map, waypoint and its time.
    const auto n = static_cast<size_t>(spec.params.n_agents);
    EXPECT_EQ(states.size(), 4 * now.n_worlds * (n * (6 + (n + 31) / 32) + 6));
    for (int team = 0; team < kNTeams; ++team) {
      const auto expected = reversed_blocks(now.field(cat("image of team ", team)).bytes, now.n_worlds);
      EXPECT_TRUE(redrawn(a.sim(), team, states) == expected) << "variant " << variant << ", team " << team;
      EXPECT_TRUE(redrawn(b.sim(), team, states) == expected) << "variant " << variant << ", team " << team;
    }
    colored += lit(now);
    // So are the last images of an episode.
    const auto& last = now.field("final image_state").bytes;
    const auto& final_images = now.field("final image of team 0").bytes;
    const size_t image = final_images.size() / now.n_worlds, row = last.size() / now.n_worlds;
    for (size_t world = 0; world < now.n_worlds; ++world) {
      if (now.byte_at("done", world) == 0 || options.on_done == OnDone::keep) continue;
      std::vector<uint8_t> kept(last.begin() + static_cast<int64_t>(world * row),
                                last.begin() + static_cast<int64_t>((world + 1) * row));
      std::vector<uint8_t> all;  // as many rows as redrawn() draws
      for (size_t k = 0; k < now.n_worlds; ++k) all.insert(all.end(), kept.begin(), kept.end());
      const std::vector<uint8_t> drawn = redrawn(b.sim(), 0, all);
      EXPECT_TRUE(std::equal(drawn.begin(), drawn.begin() + static_cast<int64_t>(image),
                             final_images.begin() + static_cast<int64_t>(world * image)))
          << "variant " << variant << ", world " << world;
    }
  }
  EXPECT_GT(colored, 0);
}

TEST_P(ImageParity, EveryByteOfEveryStep) {
  int64_t colored = 0, final_images = 0;
  for (int variant = 0; variant < case_.n_variants; ++variant) {
    const SimSpec spec = variant_of(variant);
    const SimOptions options = options_of(variant);
    const int row_step = variant % 3 == 1 ? 16 : 0;  // rows with a gap that nobody may touch
    SimRunner a(make_cpu_simulator(spec, options), Outputs::all, row_step);
    SimRunner b(other(spec, options, variant), Outputs::all, row_step);
    a.start();
    b.start();
    Snapshot now = a.snapshot();
    ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", start";
    for (int k = 0; k < 3; ++k) {
      a.step(static_cast<uint64_t>(k));
      b.step(static_cast<uint64_t>(k));
      now = a.snapshot();
      ASSERT_EQ(difference(now, b.snapshot()), "") << "variant " << variant << ", step " << k;
      colored += lit(now);
      const auto& last = now.field("final image of team 0").bytes;
      final_images += std::any_of(last.begin(), last.end(), [](uint8_t byte) { return byte != 0xFF; });
    }
    // From the state alone the same images are drawn again.
    const Snapshot drawn = observations(now);
    b.observe();
    if (options.on_done != OnDone::freeze) {
      EXPECT_EQ(difference(drawn, observations(b.snapshot())), "");
    }
  }
  EXPECT_GT(colored, 0);
  EXPECT_GT(final_images, 0);
}

const auto kSizeName = [](const auto& test) {
  const ImageSize& c = std::get<1>(test.param);
  return cat(c.n_team_0, "v", c.n_team_1, "at", c.resolution);
};
INSTANTIATE_TEST_SUITE_P(Gpu, ImageParity,
                         ::testing::Combine(::testing::Values(true), ::testing::ValuesIn(kImageSizes)), kSizeName);
INSTANTIATE_TEST_SUITE_P(Emulated, ImageParity,
                         ::testing::Combine(::testing::Values(false), ::testing::ValuesIn(kImageSizes)), kSizeName);

TEST(DrawShape, AStripFitsAndBeginsAtAWideAddress) {
  SimParams p;
  p.n_agents = 10;
  for (int resolution = 8; resolution <= 512; ++resolution) {
    p.resolution = resolution;
    const DrawShape s = draw_shape(p, 3);
    EXPECT_EQ(s.blocks, 3 * 12 * s.strips);  // ten agents, the global image and the image state
    EXPECT_GE(s.rows * s.strips, resolution);
    EXPECT_LT(s.rows * (s.strips - 1), resolution);
    EXPECT_LE(s.strip_bytes, static_cast<size_t>(kStripBytes));
    if (s.strips > 1) {
      EXPECT_EQ(s.rows * row_bytes(resolution) % 16, 0) << resolution;
    }
  }
}

}  // namespace
}  // namespace giga::test
