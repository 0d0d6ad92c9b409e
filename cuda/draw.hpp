// How the GPU back end draws images: a thread block for each, or for some rows of a large one. It puts them together in
// shared memory, and writes them in one go. Plain host-device code, as executor.hpp.
#pragma once

#include <algorithm>
#include <climits>

#include "core/error.hpp"
#include "cuda/executor.hpp"

namespace giga {

constexpr int kDrawThreads = 128;
constexpr int kStripBytes = 24 << 10;  // an image of 84 x 84 takes 21 KB: a multiprocessor has room for 9 blocks or 10

/// Blocks of a launch over all worlds: [world][image][strip].
struct DrawShape {
  int images = 0;  ///< of a world: of its agents, then the global one and the image state
  int strips = 0;  ///< of an image
  int rows = 0;    ///< of a strip
  int blocks = 0;
  size_t strip_bytes = 0, shared_bytes = 0;
};

/// `images` for each of `n_worlds`.
inline DrawShape draw_shape(const SimParams& p, int64_t n_worlds, int images) {
  // Each strip begins at a multiple of 16 bytes, for wide copies.
  constexpr int kStep = 16;
  DrawShape s;
  s.images = images;
  const int fit = kStripBytes / row_bytes(p.resolution);
  s.rows = p.resolution <= fit ? p.resolution : std::max(kStep, fit / kStep * kStep);
  s.strips = (p.resolution + s.rows - 1) / s.rows;
  const int64_t blocks = int64_t{1} * n_worlds * s.images * s.strips;
  GIGA_CHECK(blocks <= INT_MAX, blocks, " blocks of a launch");
  s.blocks = static_cast<int>(blocks);
  s.strip_bytes = static_cast<size_t>(s.rows * row_bytes(p.resolution) + 15) & ~size_t{15};
  s.shared_bytes = s.strip_bytes + sizeof(Mark) * static_cast<size_t>(p.n_agents);
  return s;
}

inline DrawShape draw_shape(const SimParams& p, int n_worlds) { return draw_shape(p, n_worlds, p.n_agents + 2); }
inline DrawShape redraw_shape(const SimParams& p, const Redraw& request) {
  return draw_shape(p, request.count, p.n_team[request.team]);
}

/// What a thread does in a launch of Job::draw or Job::draw_final. All threads of a block draw the same image, so they
/// leave together where there is nothing to draw.
template <Job job, class Sync>
GIGA_HD void run_draw_thread(const Launch& k, const DrawShape& s, const ThreadIndex& at, char* shared, Sync sync) {
  const int strip = at.block % s.strips, number = at.block / s.strips % s.images;
  const int index = at.block / s.strips / s.images;
  if (index >= k.count()) return;
  const SimParams& p = k.params;
  const int world = k.world(index);
  const WorldView w = world_view(k.state, p.n_agents, world);
  constexpr bool kFinal = job == Job::draw_final;
  if (kFinal && !keeps_final(w, k.io)) return;

  const BlockLanes<Sync> lanes{at.thread, at.n_threads, sync};
  if (number == p.n_agents + 1) {
    using States = WantedRows<ImageState>;
    int32_t* row = kFinal ? States::final_row(p, k.io, world, 0) : States::row(p, k.io, world, 0);
    if (row && strip == 0) write_image_state(lanes, p, w, row);
    return;
  }
  const bool global = number == p.n_agents;
  using Ego = WantedRows<EgoImage>;
  using Global = WantedRows<GlobalImage>;
  uint8_t* out = nullptr;
  if (global)
    out = kFinal ? Global::final_row(p, k.io, world, 0) : Global::row(p, k.io, world, 0);
  else
    out = kFinal ? Ego::final_row(p, k.io, world, number) : Ego::row(p, k.io, world, number);
  if (!out) return;

  const int x0 = strip * s.rows, x1 = x0 + s.rows < p.resolution ? x0 + s.rows : p.resolution;
  const ImageRows image{reinterpret_cast<uint8_t*>(shared), p.resolution, x0, x1, p.original()};
  Mark* marks = reinterpret_cast<Mark*>(shared + s.strip_bytes);
  if (global)
    draw_global_image(lanes, p, w, image, marks);
  else
    draw_ego_image(lanes, p, w, number, image, marks);
  copy_bytes(lanes, image.bytes, out + x0 * row_bytes(p.resolution), (x1 - x0) * row_bytes(p.resolution));
}

/// What a thread does in a launch of Simulator::redraw.
template <class Sync>
GIGA_HD void run_redraw_thread(const SimParams& p, const Redraw& request, const DrawShape& s, const ThreadIndex& at,
                               char* shared, Sync sync) {
  const int strip = at.block % s.strips;
  const int64_t number = at.block / s.strips;
  const BlockLanes<Sync> lanes{at.thread, at.n_threads, sync};
  const int x0 = strip * s.rows, x1 = x0 + s.rows < p.resolution ? x0 + s.rows : p.resolution;
  const ImageRows image{reinterpret_cast<uint8_t*>(shared), p.resolution, x0, x1, p.original()};
  redraw_image(lanes, p, request, number, image, reinterpret_cast<Mark*>(shared + s.strip_bytes));
  uint8_t* out = request.images + number * image_bytes(p.resolution);
  copy_bytes(lanes, image.bytes, out + x0 * row_bytes(p.resolution), (x1 - x0) * row_bytes(p.resolution));
}

}  // namespace giga
