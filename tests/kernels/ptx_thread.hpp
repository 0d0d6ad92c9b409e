// A thread of a kernel that runs as PTX: its registers, and what it asks its warp for.
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

#include "core/error.hpp"

namespace giga::test {

/// What the lanes of a warp do together.
enum class WarpWork : uint8_t { none, barrier, shuffle_xor, shuffle_index, multiply_tiles, load_matrices };

struct PtxThread {
  enum class State : uint8_t { runs, at_barrier, at_warp, done };

  std::vector<uint64_t> registers;
  std::vector<char> local;
  const char* parameter = nullptr;
  char* shared = nullptr;
  size_t shared_bytes = 0;
  size_t next = 0;  // instruction
  State state = State::runs;

  // What it hands in and gets back.
  WarpWork work = WarpWork::none;
  uint32_t in[6];  // of a product of tiles: 4 of the left factor, 2 of the right; else a number and by how much
  float sum[4];    // of a product of tiles, before and after
  uint32_t out[4];
  int n_matrices = 0;  // that are loaded
  bool transposed = false;

  // Copies to shared memory that are on their way: `some` of the bytes, zeros behind them. On a GPU they come at any
  // time until they are waited for; here at once, or at the last moment.
  struct Copy {
    uint32_t to;
    int bytes, some;
    const char* from;
  };
  std::vector<Copy> copies;
  bool copies_at_once = false;

  template <class T>
  T get(int at) const {
    T x;
    std::memcpy(&x, &registers[static_cast<size_t>(at)], sizeof x);
    return x;
  }
  template <class T>
  void set(int at, T x) {
    uint64_t bits = 0;
    std::memcpy(&bits, &x, sizeof x);
    registers[static_cast<size_t>(at)] = bits;
  }
  /// `bytes` of shared memory from an address on.
  char* in_shared(uint64_t address, size_t bytes) const {
    GIGA_CHECK(address % bytes == 0 && address + bytes <= shared_bytes, "address ", address, " of ", shared_bytes,
               " bytes of shared memory");
    return shared + address;
  }
  void wait_for_warp(WarpWork what) {
    work = what;
    state = State::at_warp;
  }
  void deliver_copies() {
    for (const Copy& copy : copies) {
      char* to = in_shared(copy.to, static_cast<size_t>(copy.bytes));
      std::memset(to, 0, static_cast<size_t>(copy.bytes));
      std::memcpy(to, copy.from, static_cast<size_t>(copy.some));
    }
    copies.clear();
  }
};

}  // namespace giga::test
