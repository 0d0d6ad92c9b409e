// CopyPieces: several stretches of memory copied in one go. On a GPU each copy by itself would cost a launch.
#pragma once

#include <cstdint>

#include "core/error.hpp"
#include "core/host_device.hpp"

namespace giga {

/// Row = four bytes of a piece, or what is left of it; all pieces have n_rows() together.
struct CopyPieces {
  static constexpr int kMost = 40;
  struct Piece {
    const uint8_t* from;
    uint8_t* to;
    int64_t bytes;
    int64_t end;  ///< row behind its last
  };
  Piece piece[kMost];
  int count = 0;

  int64_t n_rows() const { return count > 0 ? piece[count - 1].end : 0; }
  void add(const void* from, void* to, int64_t bytes) {
    GIGA_CHECK(from && to && count < kMost, "piece ", count, " of at most ", kMost);
    piece[count] = {static_cast<const uint8_t*>(from), static_cast<uint8_t*>(to), bytes, n_rows() + (bytes + 3) / 4};
    ++count;
  }

  GIGA_HD void operator()(int64_t row) const {
    int k = 0;  // of the first whose end lies behind the row
    for (int end = count - 1; k < end;) {
      const int middle = (k + end) / 2;
      if (row >= piece[middle].end)
        k = middle + 1;
      else
        end = middle;
    }
    const Piece& p = piece[k];
    const int64_t at = (row - (k > 0 ? piece[k - 1].end : 0)) * 4, end = at + 4 < p.bytes ? at + 4 : p.bytes;
    const uint8_t* from = p.from + at;
    uint8_t* to = p.to + at;
    const bool whole = (reinterpret_cast<uintptr_t>(from) | reinterpret_cast<uintptr_t>(to)) % 4 == 0 && end - at == 4;
    if (whole)
      *reinterpret_cast<uint32_t*>(to) = *reinterpret_cast<const uint32_t*>(from);
    else
      for (int64_t byte = 0; byte < end - at; ++byte) to[byte] = from[byte];
  }
};

}  // namespace giga
