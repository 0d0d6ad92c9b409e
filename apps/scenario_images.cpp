#include "apps/scenario_images.hpp"

#include <cmath>
#include <vector>

#include "core/error.hpp"
#include "game/game.hpp"
#include "sim/image_rows.hpp"
#include "watch/canvas.hpp"

namespace giga {
namespace {

constexpr int kSteps = 20, kScale = 3, kGap = 4;  // pixels of the file for one of an image; between images
constexpr Colour kPaper = {230, 230, 230};

/// Brings the buffers of the images of a world.
class ImageBuffers final : public GameObserver {
 public:
  explicit ImageBuffers(const SimParams& p) : side_(p.resolution), global_(static_cast<size_t>(image_bytes(side_))) {
    for (int team = 0; team < kNTeams; ++team)
      of_team_[team].resize(static_cast<size_t>(p.n_team[team]) * global_.size());
  }
  void before_step(int64_t, GameStep& step) override {
    for (int team = 0; team < kNTeams; ++team) step.io.team[team].obs[Observation::image].rows = of_team_[team].data();
    step.io.world[Observation::global_image].rows = global_.data();
  }
  /// The global image, then those of team 0 and of team 1.
  std::vector<const uint8_t*> all() const {
    std::vector<const uint8_t*> images = {global_.data()};
    for (const std::vector<uint8_t>& team : of_team_)
      for (size_t at = 0; at < team.size(); at += global_.size()) images.push_back(team.data() + at);
    return images;
  }

 private:
  int side_;
  std::vector<uint8_t> global_, of_team_[kNTeams];
};

}  // namespace

std::string scenario_images(const SimSpec& spec) {
  const int side = spec.params.resolution;
  if (side == 0) throw InputError(cat("agents of '", spec.name, "' are not given images: add _rgb to its name"));
  if (spec.params.n_agents > kMaxAgents)
    throw InputError(
        cat("'", spec.name, "' has ", spec.params.n_agents, " agents: images are drawn of up to ", kMaxAgents));
  SimOptions options;
  options.n_threads = 1;
  const auto sim = make_cpu_simulator(spec, options);
  const ParallelFor parallel_for(sim->device(), 0, nullptr);
  ImageBuffers buffers(sim->params());
  const auto chase = [&] { return everywhere(script_controller(Scripted::pursuer), *sim); };
  Game game(*sim, parallel_for, {chase(), chase()}, {&buffers});
  game.start();
  game.play(kSteps);

  const std::vector<const uint8_t*> images = buffers.all();
  const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(images.size()))));
  const int rows = (static_cast<int>(images.size()) + columns - 1) / columns;
  const int cell = side * kScale + kGap, width = columns * cell + kGap, height = rows * cell + kGap;
  Canvas page(width, height, kPaper);
  for (int k = 0; k < static_cast<int>(images.size()); ++k) {
    const int left = kGap + k % columns * cell, top = kGap + k / columns * cell;
    for (int row = 0; row < side * kScale; ++row)
      for (int column = 0; column < side * kScale; ++column) {
        const int x = column / kScale, y = side - 1 - row / kScale;
        const uint8_t* pixel = images[static_cast<size_t>(k)] + (x * side + y) * kChannels;
        page.set(left + column, top + row, {pixel[0], pixel[1], pixel[2]});
      }
  }
  return encode_png(page);
}

}  // namespace giga
