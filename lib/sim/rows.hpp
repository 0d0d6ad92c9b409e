// TeamRows: where the rows of a team's agents lie; copy_rows puts staged numbers there.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "sim/params.hpp"

namespace giga {

/// The rows of the agents of a team in one world; none where nobody wants them.
struct TeamRows {
  float* first = nullptr;  // of the team's agent 0
  int stride = 0;          // numbers from one row to the next
  int room = 0;            // numbers that may be written, those behind the observation as zeros

  GIGA_HD explicit operator bool() const { return first != nullptr; }
  GIGA_HD float* row(int slot) const { return first + static_cast<int64_t>(slot) * stride; }
  GIGA_HD bool aligned(size_t bytes) const {
    return reinterpret_cast<uintptr_t>(first) % bytes == 0 && stride * sizeof(float) % bytes == 0;
  }
};

/// Four numbers that are copied together.
struct alignas(16) FourNumbers {
  float v[4];
};

/// The columns of the rows that copy_rows writes.
struct RowPart {
  int first, count;
};

/// Copies numbers [N, part.count] from `stage` [N, kStride] to that part of both teams' rows, as T.
template <class T, int kStride, class Lanes>
GIGA_HD void copy_rows_as(const Lanes& lanes, const Parameters auto& p, bool active, const float* stage,
                          const TeamRows (&to)[kNTeams], RowPart part) {
  constexpr int kWidth = sizeof(T) / sizeof(float);
  static_assert(kStride % kWidth == 0);
  struct Row {
    const T* from;
    T* to;
    GIGA_HD explicit operator bool() const { return to != nullptr; }
  };
  const T* from = reinterpret_cast<const T*>(stage);
  lanes.each_cell(
      active ? p.n_agents : 0, part.count / kWidth,
      [&](int a) {
        const TeamRows& rows = p.team_of(a) == 0 ? to[0] : to[1];
        float* row = rows ? rows.row(p.slot_of(a)) + part.first : nullptr;
        return Row{from + a * (kStride / kWidth), reinterpret_cast<T*>(row)};
      },
      [](const Row& row, int k) { row.to[k] = row.from[k]; });
}
/// The same, four numbers at a time where all lies so that it can be.
template <int kStride, class Lanes>
GIGA_HD void copy_rows(const Lanes& lanes, const Parameters auto& p, bool active, const float* stage,
                       const TeamRows (&to)[kNTeams], RowPart part) {
  const size_t bytes = sizeof(FourNumbers);
  const bool fours = to[0].aligned(bytes) && to[1].aligned(bytes) && part.first % 4 == 0;
  const int done = fours ? part.count / 4 * 4 : 0;
  if (done > 0) copy_rows_as<FourNumbers, kStride>(lanes, p, active, stage, to, {part.first, done});
  if (done < part.count)
    copy_rows_as<float, kStride>(lanes, p, active, stage + done, to, {part.first + done, part.count - done});
}

}  // namespace giga
