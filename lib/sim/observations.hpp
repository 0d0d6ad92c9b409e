// The table of observations, and what writes them. To add one: a header that says of what, type, shape and how it is
// written, an entry in sim/observation.hpp and a row in for_each_observation. Buffers, rows, exports and the parity
// test go by the table.
#pragma once

#include "sim/ego_image.hpp"
#include "sim/egocentric_view.hpp"
#include "sim/global_image.hpp"
#include "sim/image_state.hpp"
#include "sim/state_observation.hpp"
#include "sim/vector_observation.hpp"
#include "sim/world.hpp"

namespace giga {

/// The table: calls f with each kind of observation, in the order of the enumeration. A kind K has
///   K::id, K::name, K::of, K::Element (what a row is made of) and K::type (the same, as a value)
///   K::offered(p), K::shape(p)               whether a scenario has it, and with which shape
///   K::prepare(p, w, e)                      of an agent: what its row needs, before any row is written
///   K::write(lanes, p, w, n, rows)           all rows; rows(e): that of agent e (of the world: e = 0), or null;
///                                            rows.of_team(team): those of a team; rows.mirror(team): see TeamIo
/// What its numbers mean is told in sim/observation_text.cpp. Those that are drawn (is_drawn) have no prepare and no
/// write; draw_images draws them. n agents are written, or 0 (then lanes only keep in step).
template <class F>
GIGA_HD constexpr void for_each_observation(F&& f) {
  f(VectorObservation{});
  f(EgocentricView{});
  f(StateObservation{});
  f(EgoImage{});
  f(GlobalImage{});
  f(ImageState{});
}

constexpr int count_observations() {
  int count = 0;
  for_each_observation([&count](auto) { ++count; });
  return count;
}
static_assert(count_observations() == kNObservations, "an observation without a row in the table, or the reverse");

/// Row of agent i in its team's buffers.
GIGA_HD int64_t team_row(const Parameters auto& p, int64_t world, int i) {
  return world * p.size_of(p.team_of(i)) + p.slot_of(i);
}

/// The rows of one kind of observation that somebody wants.
template <class Kind>
struct WantedRows {
  using Element = typename Kind::Element;

  GIGA_HD static bool any(const StepIo& io) {
    if constexpr (Kind::of == ObservationOf::world)
      return io.world[Kind::id].rows != nullptr;
    else
      return io.team[0].obs[Kind::id].rows || io.team[1].obs[Kind::id].rows;
  }
  /// Those of agent e, or of the world.
  GIGA_HD static const ObservationIo& of(const Parameters auto& p, const StepIo& io, int e) {
    if constexpr (Kind::of == ObservationOf::world)
      return io.world[Kind::id];
    else
      return io.of(p.team_of(e)).obs[Kind::id];
  }
  /// Where the row of agent e (or of the world) begins, in elements.
  GIGA_HD static int64_t start(const Parameters auto& p, const StepIo& io, int64_t world, int e) {
    const int stride = of(p, io, e).stride;
    const int64_t row = Kind::of == ObservationOf::world ? world : team_row(p, world, e);
    return row * (stride > 0 ? stride : Kind::shape(p).size());
  }
  /// The row itself; null where nobody wants it.
  GIGA_HD static Element* row(const Parameters auto& p, const StepIo& io, int64_t world, int e) {
    if constexpr (Kind::of == ObservationOf::agent)
      if (!io.of(p.team_of(e)).reads_in(world, Kind::id)) return nullptr;
    Element* rows = static_cast<Element*>(of(p, io, e).rows);
    return rows ? rows + start(p, io, world, e) : nullptr;
  }
  /// Where it is kept before a reset.
  GIGA_HD static Element* final_row(const Parameters auto& p, const StepIo& io, int64_t world, int e) {
    Element* rows = static_cast<Element*>(of(p, io, e).final_rows);
    return rows ? rows + start(p, io, world, e) : nullptr;
  }
};

/// The same as Kind::write takes them: of(e) of agent e (or of the world: e = 0), of_team(team); and mirror(team),
/// as TeamIo::mirror says.
template <class Kind, class P>
struct WorldRows {
  const P& p;
  const StepIo& io;
  int64_t world;

  GIGA_HD typename Kind::Element* operator()(int e) const { return WantedRows<Kind>::row(p, io, world, e); }
  GIGA_HD TeamRows of_team(int team) const {
    const ObservationIo& to = io.of(team).obs[Kind::id];
    const int stride = to.stride > 0 ? to.stride : Kind::shape(p).size();
    float* rows = io.of(team).reads_in(world, Kind::id) ? static_cast<float*>(to.rows) : nullptr;
    return {rows ? rows + world * p.size_of(team) * stride : nullptr, stride, to.room};
  }
  GIGA_HD float mirror(int team) const { return io.of(team).mirror(world); }
};

/// Whether anybody wants rows of agents, or of worlds, images apart.
GIGA_HD bool wants_rows(const StepIo& io, ObservationOf of = ObservationOf::agent) {
  bool wanted = false;
  for_each_observation([&](auto kind) {
    if (decltype(kind)::of == of && !is_drawn(kind.id) && WantedRows<decltype(kind)>::any(io)) wanted = true;
  });
  return wanted;
}

/// What has to be known of agent e before any row is written; and says whether it lives.
GIGA_HD void prepare_rows(const Parameters auto& p, World auto& w, const StepIo& io, int64_t world, bool wanted,
                          int e) {
  if (wanted) rank_neighbors(p, w, e);
  for_each_observation([&](auto kind) {
    using Kind = decltype(kind);
    if constexpr (Kind::of == ObservationOf::agent && !is_drawn(Kind::id))
      if (WantedRows<Kind>::any(io)) Kind::prepare(p, w, e);
  });
  uint8_t* alive = io.of(p.team_of(e)).alive;
  if (alive) alive[team_row(p, world, e)] = w.alive[e];
}

/// The rows of n agents, which have been prepared, or of none; and those of the worlds.
template <class Lanes>
GIGA_HD void write_rows(const Lanes& lanes, const Parameters auto& p, World auto& w, const StepIo& io, int64_t world,
                        int n) {
  for_each_observation([&](auto kind) {
    using Kind = decltype(kind);
    using Rows = WantedRows<Kind>;
    if constexpr (!is_drawn(Kind::id))
      if (Rows::any(io)) Kind::write(lanes, p, w, n, WorldRows<Kind, std::remove_cvref_t<decltype(p)>>{p, io, world});
  });
}

/// Writes what every agent sees, by w.seen, and the worlds' observations. `active` false keeps the lanes in lockstep
/// without work.
template <class Lanes>
GIGA_HD void write_observations(const Lanes& lanes, const Parameters auto& p, World auto& w, const StepIo& io,
                                int64_t world, bool active = true) {
  const int n = active ? p.n_agents : 0;
  const bool wanted = wants_rows(io);
  lanes.each_agent(n, [&](int e) { prepare_rows(p, w, io, world, wanted, e); });
  write_rows(lanes, p, w, io, world, n);
}

/// Copies the observations that have just been written to where those before a reset are kept.
template <class Lanes>
GIGA_HD void keep_final(const Lanes& lanes, const Parameters auto& p, const StepIo& io, int64_t world, bool active) {
  const int n = active ? p.n_agents : 0;
  lanes.each(n, [&](int e) {
    const TeamIo& team = io.of(p.team_of(e));
    if (team.final_alive && team.alive) team.final_alive[team_row(p, world, e)] = team.alive[team_row(p, world, e)];
  });
  for_each_observation([&](auto kind) {
    using Kind = decltype(kind);
    using Rows = WantedRows<Kind>;
    if (is_drawn(Kind::id) || !Rows::any(io)) return;
    struct Row {
      const typename Kind::Element* from;
      typename Kind::Element* to;
      GIGA_HD explicit operator bool() const { return from && to; }
    };
    const auto row_of = [&](int e) { return Row{Rows::row(p, io, world, e), Rows::final_row(p, io, world, e)}; };
    const auto copy = [](const Row& row, int k) { row.to[k] = row.from[k]; };
    const int columns = Kind::shape(p).size();
    if constexpr (Kind::of == ObservationOf::agent) {
      lanes.each_cell(n, columns, row_of, copy);
    } else {
      const Row row = row_of(0);
      lanes.each(active && row ? columns : 0, [&](int k) { copy(row, k); });
    }
  });
}

/// Room for the marks of all agents, where their features lie while observations are written.
GIGA_HD Mark* marks_of(World auto& w) {
  static_assert(sizeof(Mark) <= sizeof(w.features[0]));
  return reinterpret_cast<Mark*>(&w.features[0]);
}

/// Draws the images of a world that are wanted, into their rows or, `final`, where those before a reset are kept.
/// `marks`: room for all agents.
template <class Lanes>
GIGA_HD void draw_images(const Lanes& lanes, const Parameters auto& p, const World auto& w, const StepIo& io,
                         int64_t world, bool final, Mark* marks) {
  const auto whole = [&](uint8_t* row) { return ImageRows{row, p.resolution, 0, p.resolution, p.original()}; };
  for (int e = 0; e < p.n_agents; ++e) {
    using Rows = WantedRows<EgoImage>;
    uint8_t* row = final ? Rows::final_row(p, io, world, e) : Rows::row(p, io, world, e);
    if (row) draw_ego_image(lanes, p, w, e, whole(row), marks);
  }
  using Rows = WantedRows<GlobalImage>;
  uint8_t* row = final ? Rows::final_row(p, io, world, 0) : Rows::row(p, io, world, 0);
  if (row) draw_global_image(lanes, p, w, whole(row), marks);
  using States = WantedRows<ImageState>;
  int32_t* state = final ? States::final_row(p, io, world, 0) : States::row(p, io, world, 0);
  if (state) write_image_state(lanes, p, w, state);
}

}  // namespace giga
