// Images where the recordings of the original do not reach: what `corrected` does otherwise, the edges of an image, and
// when images are drawn.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "core/error.hpp"
#include "sim/lanes.hpp"
#include "sim/observations.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"
#include "support/sim_world.hpp"

namespace giga::test {
namespace {

using Pixel = std::array<int, kChannels>;
constexpr Pixel kBlack = {0, 0, 0}, kWhite = {255, 255, 255}, kRed = {255, 0, 0}, kGreen = {0, 255, 0};
constexpr float kUp = 0.5f * kPi;  ///< heading along y: the tail lies at smaller y

/// A world of 10 x 10 units and 20 x 20 pixels: a pixel is half a unit.
SimSpec small_images(int n_team_0, int n_team_1, Rules rules) {
  SimSpec spec = open_spec(n_team_0, n_team_1);
  spec.params.rules = rules;
  spec.params.resolution = 20;
  return spec;
}

constexpr int kGlobal = -1;

/// The image of agent e, or of the world, in which everybody sees everybody.
class Image {
 public:
  Image(TestWorld& world, int e) : side_(world.params().resolution) {
    std::fill_n(world.now().seen, world.n_agents() * words_for(world.n_agents()), ~0u);
    const SimParams& p = world.params();
    bytes_.assign(static_cast<size_t>(image_bytes(side_)), 99);
    std::vector<Mark> marks(static_cast<size_t>(p.n_agents));
    const ImageRows image{bytes_.data(), side_, 0, side_, p.original()};
    if (e == kGlobal)
      draw_global_image(SerialLanes{}, p, world.now(), image, marks.data());
    else
      draw_ego_image(SerialLanes{}, p, world.now(), e, image, marks.data());
  }
  Pixel at(int x, int y) const {
    const uint8_t* pixel = bytes_.data() + (x * side_ + y) * kChannels;
    return {pixel[0], pixel[1], pixel[2]};
  }

 private:
  int side_;
  std::vector<uint8_t> bytes_;
};

// x = 10 lies on pixel 10 * 20 / 10 = 20, which the image has not; z = 4 is as bright as 4 * 255 / 10 = 102.
TEST(SimImage, AnAgentOnTheFarBorderIsDrawnOnTheLastPixel) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    TestWorld world(small_images(1, 1, rules));
    world.put(0, 5, 2);
    world.put(1, 10, 7.5f, 0, 4);  // pixel 20, 15; its tail lies at smaller x
    const Image image(world, kGlobal);
    if (rules == Rules::original) {
      EXPECT_EQ(image.at(19, 15), (Pixel{203, 255, 255})) << "no sprite; the tail adds 204: (255 + 204) mod 256";
      EXPECT_EQ(image.at(18, 15), (Pixel{153, 0, 0})) << "20 - 2";
    } else {
      EXPECT_EQ(image.at(19, 15), kWhite) << "its sprite cannot be told from the border";
      EXPECT_EQ(image.at(18, 15), (Pixel{204, 0, 0})) << "19 - 1: the clamp moves the whole agent";
      EXPECT_EQ(image.at(15, 15), (Pixel{51, 0, 0})) << "19 - 4";
    }
  }
}

// A sprite of 3 x 3 pixels around 0, 10: rows -1, 0 and 1.
TEST(SimImage, SpritesEndAtTheNearBorder) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    SimSpec spec = small_images(1, 1, rules);
    spec.agents[0].sprite = 7;
    TestWorld world(spec);
    world.put(0, 0, 5, kPi, 6);  // brightness 6 * 255 / 10 = 153; its tail lies at larger x
    world.put(1, 5, 2);
    const Image image(world, kGlobal);
    EXPECT_EQ(image.at(1, 9), (Pixel{0, 153, 255}));
    EXPECT_EQ(image.at(1, 11), (Pixel{0, 153, 255}));
    // Pixel 1, 0: columns -1, 0 and 1. The column y = 19 is the health bar of the other agent: green.
    world.put(0, 0.5f, 0, kUp, 6);
    const Image ego(world, 1);
    EXPECT_EQ(ego.at(1, 1), (Pixel{255, 153, 0})) << "an opponent";
    EXPECT_EQ(ego.at(2, 19), rules == Rules::original ? (Pixel{255, 255, 0}) : kGreen) << "column -1";
  }
}

TEST(SimImage, TailsSaturateOrWrap) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    TestWorld world(small_images(1, 2, rules));
    world.put(0, 2, 5);
    world.put(1, 5, 5);  // pixel 10, 10
    world.put(2, 5, 5);  // the same: both tails lie on the same pixels
    const Image image(world, 0);
    const bool wraps = rules == Rules::original;
    EXPECT_EQ(image.at(9, 10), (Pixel{wraps ? (204 + 204) % 256 : 255, 0, 0}));
    EXPECT_EQ(image.at(8, 10), (Pixel{wraps ? (153 + 153) % 256 : 255, 0, 0}));
    EXPECT_EQ(image.at(7, 10), (Pixel{102 + 102, 0, 0}));
    EXPECT_EQ(image.at(6, 10), (Pixel{51 + 51, 0, 0}));
    EXPECT_EQ(image.at(10, 10), (Pixel{255, 0, 0})) << "two opponents on the ground";
  }
}

// Pixel 9, 10 gets: of the ego 204 to blue, then the ego's 204 in all channels, then 153 to red of the opponent whose
// second pixel it is. So the sum comes after the maximum of the step before.
TEST(SimImage, TheEgosTailIsRaisedBetweenTheSums) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    TestWorld world(small_images(1, 1, rules));
    world.put(0, 5, 5);        // pixel 10, 10: its tail begins at 9, 10
    world.put(1, 5.5f, 5, 0);  // pixel 11, 10: its tail is 10, 10, then 9, 10
    const Image image(world, 0);
    EXPECT_EQ(image.at(9, 10), (Pixel{rules == Rules::original ? (204 + 153) % 256 : 255, 204, 204}));
    // Its second pixel: 153 to blue, raised to 153 everywhere, then 102 to red of the opponent's third.
    EXPECT_EQ(image.at(8, 10), (Pixel{153 + 102, 153, 153}));
  }
}

TEST(SimImage, AWaypointIsDrawnWhereThereIsOne) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    SimSpec spec = small_images(1, 1, rules);
    spec.params.waypoints = true;
    spec.params.waypoint_size = 1.2f;  // int(1.2 * 20 / 10) = 2 pixels
    TestWorld world(spec);
    world.put(0, 5, 5);
    world.put(1, 7, 7);
    *world.now().waypoint_time = 0;
    std::fill_n(world.now().waypoint, 4, 0.0f);
    const bool painted = rules == Rules::original;
    EXPECT_EQ(Image(world, 0).at(0, 0), painted ? kBlack : kWhite) << "over the border";
    EXPECT_EQ(Image(world, 0).at(1, 1), kBlack);
    EXPECT_EQ(Image(world, 0).at(0, 2), kWhite);
    *world.now().waypoint_time = 3;
    const float active[4] = {1, 1.5f, 2.2f, 2.7f};
    std::copy_n(active, 4, world.now().waypoint);
    const Image image(world, kGlobal);
    for (const int x : {2, 3})
      for (const int y : {3, 4}) EXPECT_EQ(image.at(x, y), (Pixel{127, 0, 127})) << x << ", " << y;
    EXPECT_EQ(image.at(4, 3), kBlack);
    EXPECT_EQ(image.at(2, 5), kBlack);
    EXPECT_EQ(image.at(0, 0), kWhite);
  }
}

TEST(SimImage, HealthAndDamageOfTheEgo) {
  SimSpec spec = small_images(1, 1, Rules::corrected);
  spec.agents[0].max_health = 3;
  spec.params.min_tracking_time = 3;
  TestWorld world(spec);
  world.put(0, 5, 5);
  world.put(1, 7, 7);
  world.now().health[0] = 1;  // int(20 * 1 / 3) = 6 pixels
  EXPECT_EQ(Image(world, 0).at(5, 19), kGreen);
  EXPECT_EQ(Image(world, 0).at(6, 19), kWhite);
  EXPECT_EQ(Image(world, 0).at(19, 19), kWhite);
  EXPECT_EQ(Image(world, 0).at(0, 7), kWhite) << "border";
  world.now().tracked[1] = 3;  // agent 0 by agent 1: no damage yet
  EXPECT_EQ(Image(world, 0).at(0, 7), kWhite);
  world.now().tracked[1] = 4;
  EXPECT_EQ(Image(world, 0).at(0, 7), kRed);
  EXPECT_EQ(Image(world, 0).at(7, 0), kRed);
  EXPECT_EQ(Image(world, 0).at(19, 7), kRed);
  EXPECT_EQ(Image(world, 0).at(7, 19), kWhite) << "the bar";
  EXPECT_EQ(Image(world, 1).at(0, 7), kWhite) << "the other was not hit";
  EXPECT_EQ(Image(world, kGlobal).at(7, 19), kWhite);
}

// An ego that is dead is drawn in its own image; the dead are not in the global one.
TEST(SimImage, ADeadEgo) {
  TestWorld world(small_images(1, 1, Rules::corrected));
  world.put(0, 5, 5);
  world.put(1, 7, 7);
  world.kill(0);
  EXPECT_EQ(Image(world, kGlobal).at(10, 10), kBlack);
  EXPECT_EQ(Image(world, kGlobal).at(9, 10), kBlack);
  const Image image(world, 0);
  EXPECT_EQ(image.at(10, 10), kWhite);
  EXPECT_EQ(image.at(5, 19), kWhite) << "no health left";
}

// An obstacle from 4 to 6: pixels 8 to 11 under both rules; one at the far border ends a pixel short, at 18.
TEST(SimImage, Obstacles) {
  SimSpec spec = small_images(1, 1, Rules::corrected);
  spec.maps[0].boxes = {{4, 4, 6, 6, 0, 10}, {7.5f, 8, 10, 9, 0, 10}};
  TestWorld world(spec);
  world.put(0, 1, 1);
  world.put(1, 2, 9);
  const Image image(world, 0);
  const Pixel gray = {127, 127, 127};
  EXPECT_EQ(image.at(8, 8), gray);
  EXPECT_EQ(image.at(11, 11), gray);
  EXPECT_EQ(image.at(7, 8), kBlack);
  EXPECT_EQ(image.at(12, 11), kBlack);
  EXPECT_EQ(image.at(18, 16), gray);
  EXPECT_EQ(image.at(18, 18), kBlack);
  EXPECT_EQ(image.at(19, 16), kWhite) << "the border";
}

// Opponents 0.3 and 0.2 units away: pixel 10 sees both on pixel 11, where the one with the smaller index is first.
TEST(SimImage, VectorsBesideImagesAreOrderedByPixelUnderTheOriginalRules) {
  for (const Rules rules : {Rules::original, Rules::corrected}) {
    TestWorld world(small_images(1, 2, rules));
    world.put(0, 5.2f, 5);  // 10.4
    world.put(1, 5.5f, 5);  // 11
    world.put(2, 5.4f, 5);  // 10.8
    WorldView& w = world.now();
    std::fill_n(w.seen, 3, ~0u);
    rank_neighbors(world.params(), w, 0);
    EXPECT_EQ(w.neighbors[1], rules == Rules::original ? 1 : 2);
    EXPECT_EQ(w.neighbors[2], rules == Rules::original ? 2 : 1);
  }
}

// The third step ends the episode. A world that steps on shows what its images were then.
TEST(SimImage, ImagesBeforeAResetAreKept) {
  SimSpec spec = small_images(2, 2, Rules::corrected);
  spec.params.max_episode_length = 3;
  spec.finish();
  const auto run = [&](OnDone on_done, int episodes) {
    SimOptions options;
    options.n_worlds = 3;
    options.on_done = on_done;
    options.episodes = episodes;
    SimRunner runner(make_cpu_simulator(spec, options));
    runner.start();
    for (uint64_t k = 0; k < 3; ++k) runner.step(k);
    return runner.snapshot();
  };
  const Snapshot on = run(OnDone::keep, 1), reset = run(OnDone::reset, 1), freeze = run(OnDone::freeze, 1),
                 next = run(OnDone::freeze, 2);
  for (const char* name : {"image of team 0", "image of team 1", "global_image"}) {
    const std::string final = cat("final ", name);
    const std::vector<uint8_t> last = on.field(name).bytes;
    for (const Snapshot* other : {&reset, &freeze, &next}) EXPECT_EQ(other->field(final).bytes, last) << name;
    EXPECT_EQ(freeze.field(name).bytes, last) << "a world that waits";
    EXPECT_NE(reset.field(name).bytes, last) << "the next episode";
    EXPECT_NE(next.field(name).bytes, last);
    const std::vector<uint8_t>& none = on.field(final).bytes;
    EXPECT_TRUE(std::all_of(none.begin(), none.end(), [](uint8_t byte) { return byte == 0xFF; })) << "not written";
  }
}

}  // namespace
}  // namespace giga::test
