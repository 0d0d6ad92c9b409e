// How many blocks of a GPU a world of many agents (rules 17) has, in how many launches a step is, and who looks for
// whom in them. Plain host-device code, as executor.hpp.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>

#include "cuda/grid_lanes.hpp"
#include "sim/grid_memory.hpp"

namespace giga {

constexpr int kGridThreads = 512;   // threads of a block
constexpr int kThreadsOfAgent = 4;  // of a world, where there is room: most stages look at pairs or write rows
constexpr int kLanesOfAgent = 4;    // of a crew
// Of StepLaunches::of_few. Of a crew that looks: with eight lanes 60.8 M agent-steps/s instead of 61.7 M, crowded
// 39.4 M instead of 49.7 M (2,000 agents, one H200).
constexpr int kLanesToLook = kWarp;
// Of StepLaunches::of_more where agents are crowded. 10,000 against 10,000, one H200: half a warp looks, 200 M
// agent-steps/s; four lanes 149 M, a warp 174 M, half a warp of 128 registers 193 M. A fight in `play` 164 M instead of
// 171 M (a warp looks), by four lanes 168 M.
constexpr int kLanesToFight = 8, kLanesOfCrowd = kWarp / 2;
/// From so many agents on for each block of kGridThreads that runs at the same time a crew that looks sees to two, one
/// after the other: of 20,000, 30,000 and 60,000 242, 282 and 339 M agent-steps/s instead of 236, 273 and 323 M, but of
/// 8,000 and 12,000 139 and 172 M instead of 143 and 182 M (crowded, one H200).
constexpr int kTurnsFrom = 128;
/// How many agents, spread over the map, lie in the square of the reach of ears and eyes: from so many on they are
/// crowded. 20,000 on one H200, half a warp or four lanes that look: of 8 in that square 220 or 201 M agent-steps/s, of
/// 0.5 240 or 257 M. With a fight in `play` these make 276 M.
constexpr float kCrowdInReach = 4;
inline bool is_crowded(const GridParams& p) {
  const float reach = p.hearing_reach + max_of(p.sight_reach[0], p.sight_reach[1]);
  return static_cast<float>(p.n_agents) * reach * reach > kCrowdInReach * p.limit_x * p.limit_y;
}

/// How blocks are put together. Groups go from world to world; all blocks of a launch that is not clustered run at the
/// same time, because they wait for each other.
struct GridLaunchShape {
  int groups;      ///< worlds at a time
  int blocks;      ///< of a group
  bool clustered;  ///< a group is a cluster of the hardware, whose barrier is ten times as fast as one in memory

  /// Lanes that look for an agent together.
  int lanes_of_agent(int n_agents, int threads) const {
    return blocks * threads >= kLanesOfAgent * n_agents ? kLanesOfAgent : 1;
  }
};

/// Launches of a step: one, or several (StepPart). Those that wait for nobody have as many threads as suit them.
enum class StepLaunches {
  one,
  of_few,   ///< play, with crews, whose blocks sort for themselves, in half of the GPU at most; observe has all of it.
            ///< One world on 132 multiprocessors: up to some 5,900 agents
  of_more,  ///< play, without crews, of which there would be too many in one launch; observe has them. Where agents are
            ///< crowded those that fight too: move, fight, settle
  of_many   ///< move, fight, settle, and a thread for each that looks and writes: as many at a time as registers allow
};

/// What there is to spread them over.
struct GridDevice {
  int threads;              ///< of a block
  int resident;             ///< blocks that run at the same time
  int most_clustered;       ///< blocks of a cluster, a power of two; 1 = there are no clusters
  size_t shared_bytes = 0;  ///< at most, of a block that sorts; besides its stage
  int in_parts = 0;         ///< from so many agents on a step is StepLaunches::of_many; 0 = all steps are one launch
  /// Clusters of 2^k blocks that run at the same time; -1 = as many as there are blocks for. An H200 has room for fewer
  /// of 8 blocks than it has eights of multiprocessors: those of a cluster are neighbors.
  int clusters[5] = {-1, -1, -1, -1, -1};

  int clusters_of(int blocks) const {
    const int known = clusters[std::bit_width(static_cast<unsigned>(blocks)) - 1];
    return known >= 0 ? known : resident / blocks;
  }
};

/// Shared memory of a block: the stage of each warp, then the sorted agents if there is room.
GIGA_HD constexpr size_t grid_stage_bytes(int threads, bool room_to_look = false) {
  return sizeof(float) * stage_numbers(room_to_look) * static_cast<size_t>((threads + kWarp - 1) / kWarp);
}
inline size_t grid_sorted_bytes(int n_agents, const GridDevice& device) {
  GridWorld w{};
  const size_t bytes = attach_sorted(n_agents, w, nullptr);
  return bytes <= device.shared_bytes ? bytes : 0;
}

/// As many blocks for a world as have work, and for as many worlds as there is room for. Clusters are powers of two:
/// the next larger one where that gives each agent a crew, else the next smaller one. Where all worlds find room at the
/// same time in smaller clusters, but not in larger ones, in these: else some would wait for the others.
inline GridLaunchShape grid_launch_shape(int n_agents, int n_worlds, const GridDevice& device) {
  const auto with_threads = [&](int of_agent) { return (of_agent * n_agents + device.threads - 1) / device.threads; };
  int blocks = device.resident / std::min(n_worlds, device.resident);
  blocks = std::max(1, std::min(with_threads(kThreadsOfAgent), blocks));
  if (blocks == 1 || blocks > device.most_clustered)
    return {std::min(n_worlds, device.resident / blocks), blocks, false};
  const int larger = static_cast<int>(std::bit_ceil(static_cast<unsigned>(blocks)));
  const bool has_room = larger <= device.most_clustered && n_worlds <= device.clusters_of(larger);
  blocks = has_room && with_threads(kLanesOfAgent) <= larger
               ? larger
               : static_cast<int>(std::bit_floor(static_cast<unsigned>(blocks)));
  while (blocks > 1 && device.clusters_of(blocks) < std::min(n_worlds, device.clusters_of(blocks / 2))) blocks /= 2;
  return {std::min(n_worlds, device.clusters_of(blocks)), blocks, blocks > 1};
}

}  // namespace giga
