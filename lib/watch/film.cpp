#include "watch/film.hpp"

#include <algorithm>
#include <cmath>

#include "core/error.hpp"
#include "watch/games.hpp"

namespace giga {
namespace {

constexpr int kTrail = 25;    // steps
constexpr double kEdge = 10;  // pixels around the world

const ReplayEpisode& chosen(const Replay& replay, const FilmOptions& options) {
  return episode_of(replay, options.episode);
}

}  // namespace

const ReplayEpisode& episode_of(const Replay& replay, int episode) {
  if (episode < 0 || episode >= static_cast<int>(replay.episodes.size()))
    throw InputError(cat("episode ", episode, ": the replay has ", replay.episodes.size(), ", counted from 0"));
  return replay.episodes[static_cast<size_t>(episode)];
}

int film_length(const Replay& replay, const FilmOptions& options) {
  return (chosen(replay, options).steps + options.every - 1) / options.every + 1;
}

Canvas film_picture(const Replay& replay, const FilmOptions& options, int k) {
  const GameView game(replay, chosen(replay, options));
  const int state = std::min(k * options.every, game.episode().steps);
  const auto limit_x = static_cast<double>(replay.rules.limit_x), limit_y = static_cast<double>(replay.rules.limit_y);
  const double scale = options.side / std::max(limit_x, limit_y);
  const auto size = [&](double limit) { return static_cast<int>(std::lround(limit * scale + 2 * kEdge)); };
  Canvas canvas(size(limit_x), size(limit_y), colour_of("#ffffff"));
  const auto at = [&](double x, double y) { return Point{kEdge + x * scale, kEdge + (limit_y - y) * scale}; };
  const auto box = [&](auto x1, auto y1, auto x2, auto y2, const char* colour, double opacity) {
    canvas.rectangle(at(static_cast<double>(x1), static_cast<double>(y1)),
                     at(static_cast<double>(x2), static_cast<double>(y2)), colour_of(colour), opacity);
  };
  box(0, 0, limit_x, limit_y, "#eef1f4", 1);
  for (const auto& b : game.boxes()) box(b[0], b[1], b[2], b[3], "#8a94a3", 1);
  for (const ReplayWaypoint& w : game.episode().waypoints)
    if (w.from <= state && state <= w.to) box(w.x1, w.y1, w.x2, w.y2, "#009e73", 0.5);

  const int n = replay.n_agents();
  const double radius = std::clamp(0.22 * scale, 3.0, 9.0);
  for (int i = 0; i < n; ++i) {
    const Colour colour = colour_of(kTeamColours[game.team(i)]);
    for (int s = std::max(0, state - kTrail); s < std::min(state, game.last(i)); ++s) {
      const AgentPlace a = game.place(i, s), b = game.place(i, s + 1);
      canvas.line(at(a.x, a.y), at(b.x, b.y), 1.5, colour, 0.15 + 0.5 * (s - state + kTrail) / kTrail);
    }
  }
  for (const auto& [shooter, target] : game.hits(state)) {
    const AgentPlace a = game.place(shooter, state), b = game.place(target, state);
    canvas.line(at(a.x, a.y), at(b.x, b.y), 2, colour_of("#c2185b"));
  }
  for (int i = 0; i < n; ++i) {
    const Colour colour = colour_of(kTeamColours[game.team(i)]);
    const AgentPlace p = game.place(i, state);
    const Point centre = at(p.x, p.y);
    if (!game.alive(i, state)) {
      const double r = 0.6 * radius;
      canvas.line({centre.x - r, centre.y - r}, {centre.x + r, centre.y + r}, 1.6, colour, 0.6);
      canvas.line({centre.x - r, centre.y + r}, {centre.x + r, centre.y - r}, 1.6, colour, 0.6);
      continue;
    }
    const auto corner = [&](double turn, double far) {
      const double heading = p.heading + turn;
      return Point{centre.x + far * radius * std::cos(heading), centre.y - far * radius * std::sin(heading)};
    };
    canvas.polygon({corner(0, 1.2), corner(2.5, 1), corner(-2.5, 1)}, colour);
    const auto row = static_cast<size_t>(int64_t{i} * game.states() + state);
    const double health = static_cast<double>(replay.rules.health_unit) * game.episode().health[row] /
                          static_cast<double>(replay.agents[static_cast<size_t>(i)].max_health);
    if (health < 0.995) {
      const Point left{centre.x - radius, centre.y - radius - 5}, right{centre.x + radius, centre.y - radius - 5};
      canvas.line(left, right, 3, colour_of("#d4dae2"));
      canvas.line(left, {left.x + 2 * radius * std::clamp(health, 0.0, 1.0), left.y}, 3, colour);
    }
  }
  return canvas;
}

}  // namespace giga
