// Every recorded image of the original, drawn from the recorded state: all bytes are equal. And the order of agents in
// vectors beside images.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "golden/golden_world.hpp"
#include "golden/recording.hpp"
#include "sim/lanes.hpp"
#include "sim/map_picture.hpp"

namespace giga::golden {
namespace {

constexpr int kMostShown = 10;

SimSpec with_images(SimSpec spec, const H5Group& g, const std::string& name) {
  const Params params(g.text_attribute("params"), name + " params");
  spec.params.resolution = static_cast<int>(params.number("resolution_x"));
  return spec;
}

/// The recorded states after the steps of a case, with what an image needs besides.
struct ImageCase {
  std::string where;
  GoldenWorld world;
  Array<float> x, y, z, heading, health, alive, waypoint, waypoint_time;
  Array<int32_t> tracked, map, seen, took_damage, ego, global;

  ImageCase(const std::string& file, const H5Group& g, const std::string& name)
      : where(file + " " + name),
        world(with_images(recorded_spec(g, name), g, name)),
        x(g.floats("after/x")),
        y(g.floats("after/y")),
        z(g.floats("after/z")),
        heading(g.floats("after/heading")),
        health(g.floats("after/health")),
        alive(g.floats("after/alive")),
        waypoint(g.floats("after/waypoint_location")),
        waypoint_time(g.floats("after/waypoint_enabled")),
        tracked(g.ints("after/tracked")),
        map(g.ints("after/map_idx")),
        seen(g.ints("out/seen")),
        took_damage(g.ints("out/took_damage")),
        ego(g.ints("out/rgb")),
        global(g.ints("out/global_rgb")) {}

  void load(size_t t) {
    WorldView& w = world.view();
    const int n = world.n_agents(), words = words_for(n);
    std::fill_n(w.seen, n * words, 0u);
    for (int i = 0; i < n; ++i) {
      w.x[i] = x.row(t)[i];
      w.y[i] = y.row(t)[i];
      w.z[i] = z.row(t)[i];
      w.heading[i] = heading.row(t)[i];
      w.health[i] = health.row(t)[i];
      w.alive[i] = alive.row(t)[i] != 0;
      for (int a = 0; a < n; ++a)
        if (seen.row(t)[i * n + a]) w.seen[i * words + a / 32] |= 1u << (a % 32);
    }
    for (int k = 0; k < n * n; ++k) w.tracked[k] = static_cast<uint8_t>(std::min(tracked.row(t)[k], 255));
    std::copy_n(waypoint.row(t), 4, w.waypoint);
    *w.waypoint_time = waypoint_time.data[t];
    *w.map = std::clamp(map.data[t], 0, world.params().n_maps - 1);
  }
};

/// Where the image differs first, as text; empty if nowhere.
std::string first_difference(const std::vector<uint8_t>& got, const int32_t* want, int side) {
  for (size_t k = 0; k < got.size(); ++k) {
    const size_t pixel = k / kChannels, row = static_cast<size_t>(side);
    if (got[k] != want[k])
      return cat("pixel ", pixel / row, ", ", pixel % row, ", channel ", k % kChannels, ": got ",
                 static_cast<int>(got[k]), ", recorded ", want[k]);
  }
  return "";
}

TEST(GoldenImages, EveryRecordedImageIsReproduced) {
  long n_ego = 0, n_global = 0, n_hurt = 0, shown = 0;
  for (const Recording& recording : recordings())
    for (const std::string& name : step_cases(recording.root)) {
      const H5Group group = recording.root.group(name);
      if (!group.has("out/rgb")) continue;
      ImageCase c(recording.file, group, name);
      ASSERT_EQ(c.ego.rows(), c.x.rows()) << c.where << ": an image of each step";
      const SimParams& p = c.world.params();
      const int side = p.resolution, n = p.n_agents;
      const auto bytes = static_cast<size_t>(image_bytes(side));
      std::vector<Mark> marks(static_cast<size_t>(n));
      for (size_t t = 0; t < c.ego.rows(); ++t) {
        c.load(t);
        const auto check = [&](auto draw, const int32_t* want, const std::string& what) {
          std::vector<uint8_t> got(bytes, 99);
          draw(ImageRows{got.data(), side, 0, side, p.original()});
          const std::string difference = first_difference(got, want, side);
          if (difference.empty()) return 1;
          if (shown++ < kMostShown) ADD_FAILURE() << c.where << " record " << t << ", " << what << ": " << difference;
          return 0;
        };
        for (int e = 0; e < n; ++e) {
          const bool hurt = was_hurt(SerialLanes{}, p, c.world.view(), e);
          EXPECT_EQ(hurt, c.took_damage.row(t)[e] != 0) << c.where << " record " << t << ", agent " << e;
          n_hurt += hurt;
          n_ego +=
              check([&](const ImageRows& to) { draw_ego_image(SerialLanes{}, p, c.world.view(), e, to, marks.data()); },
                    c.ego.row(t) + static_cast<size_t>(e) * bytes, cat("agent ", e));
        }
        n_global +=
            check([&](const ImageRows& to) { draw_global_image(SerialLanes{}, p, c.world.view(), to, marks.data()); },
                  c.global.row(t), "global");
      }
    }
  std::printf("golden images: %ld ego (%ld of agents that took damage) and %ld global images, all bytes equal\n", n_ego,
              n_hurt, n_global);
  if (n_ego == 0 && foreign_folder()) GTEST_SKIP() << "no recorded images in GIGASTEP_GOLDEN_DIR";
  if (foreign_folder()) return;
  EXPECT_EQ(n_ego, 1328);
  EXPECT_EQ(n_global, 139);
  EXPECT_GT(n_hurt, 0);
}

}  // namespace
}  // namespace giga::golden
