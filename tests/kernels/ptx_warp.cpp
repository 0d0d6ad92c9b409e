// What the threads of a warp or a block do together: barriers, shuffles, loads of matrices, products of tiles.
#include "kernels/ptx_words.hpp"

namespace giga::test {
namespace {

constexpr uint32_t kAllLanes = 0xFFFFFFFF;

// PTX ISA, 9.7.14: which numbers of the tiles a lane holds.
void multiply_tiles(PtxThread* lanes) {
  float a[16][16], b[16][8];
  for (int l = 0; l < 32; ++l) {
    const int group = l / 4, pair = l % 4 * 2;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 2; ++i) {
        const float x = from_half(part(lanes[l].in[k], i));
        if (k < 4)
          a[group + k % 2 * 8][pair + k / 2 * 8 + i] = x;
        else
          b[pair + (k - 4) * 8 + i][group] = x;
      }
  }
  for (int l = 0; l < 32; ++l)
    for (int k = 0; k < 4; ++k) {
      double sum = static_cast<double>(lanes[l].sum[k]);
      for (int i = 0; i < 16; ++i)
        sum += static_cast<double>(a[l / 4 + k / 2 * 8][i]) * static_cast<double>(b[i][l % 4 * 2 + k % 2]);
      lanes[l].sum[k] = static_cast<float>(sum);
    }
}

// PTX ISA, 9.7.14.5.15: lane 8 k + r has the address of row r of matrix k.
void load_matrices(PtxThread* lanes) {
  for (int k = 0; k < lanes[0].n_matrices; ++k) {
    uint16_t matrix[8][8];
    for (int r = 0; r < 8; ++r) {
      const PtxThread& lane = lanes[k * 8 + r];
      std::memcpy(matrix[r], lane.in_shared(lane.in[0], sizeof matrix[r]), sizeof matrix[r]);
    }
    for (int l = 0; l < 32; ++l) {
      const int r = l / 4, c = l % 4 * 2;
      lanes[l].out[k] =
          lanes[l].transposed ? pair_of(matrix[c][r], matrix[c + 1][r]) : pair_of(matrix[r][c], matrix[r][c + 1]);
    }
  }
}

}  // namespace

bool is_warp_work(const std::string& name) {
  return name == "bar" || name == "shfl" || name == "mma" || name == "ldmatrix";
}

// The results are taken by a second operation, behind the first (PtxModule adds it).
Operation ptx_warp_work(const Words& w, const Operands& o) {
  if (w[0] == "bar") {
    expect_operands(w, o, 1);
    if (w == Words{"bar", "warp", "sync"})
      return [all = o[0].at()](PtxThread& t) {
        GIGA_CHECK(t.get<uint32_t>(all) == kAllLanes, "a barrier of some lanes");
        t.wait_for_warp(WarpWork::barrier);
      };
    if (w != Words{"bar", "sync"}) refuse(w);
    return [number = o[0].at()](PtxThread& t) {
      GIGA_CHECK(t.get<uint32_t>(number) == 0, "another barrier than 0");
      t.state = PtxThread::State::at_barrier;
    };
  }
  if (w[0] == "shfl") {
    expect_operands(w, o, 5);
    allow(w, {"sync", "bfly", "idx"});
    return
        [=, by_xor = has(w, "bfly"), a = o[1].at(), by = o[2].at(), width = o[3].at(), all = o[4].at()](PtxThread& t) {
          GIGA_CHECK(t.get<uint32_t>(all) == kAllLanes && t.get<uint32_t>(width) == 31 && t.get<uint32_t>(by) < 32,
                     "a shuffle within a part of the warp");
          t.in[0] = t.get<uint32_t>(a);
          t.in[1] = t.get<uint32_t>(by);
          t.wait_for_warp(by_xor ? WarpWork::shuffle_xor : WarpWork::shuffle_index);
        };
  }
  if (w[0] == "ldmatrix") {
    expect_operands(w, o, 2);
    allow(w, {"sync", "aligned", "m8n8", "x1", "x2", "x4", "trans", "shared"});
    const bool transposed = has(w, "trans");
    return [=, n = static_cast<int>(o[0].registers.size()), at = o[1]](PtxThread& t) {
      t.in[0] = static_cast<uint32_t>(t.get<uint32_t>(at.at()) + at.offset);
      t.n_matrices = n;
      t.transposed = transposed;
      t.wait_for_warp(WarpWork::load_matrices);
    };
  }
  if (w != Words{"mma", "sync", "aligned", "m16n8k16", "row", "col", "f32", "f16", "f16", "f32"}) refuse(w);
  return [a = o[1].registers, b = o[2].registers, c = o[3].registers](PtxThread& t) {
    for (size_t k = 0; k < 4; ++k) t.in[k] = t.get<uint32_t>(a[k]);
    for (size_t k = 0; k < 2; ++k) t.in[4 + k] = t.get<uint32_t>(b[k]);
    for (size_t k = 0; k < 4; ++k) t.sum[k] = t.get<float>(c[k]);
    t.wait_for_warp(WarpWork::multiply_tiles);
  };
}

Operation ptx_result(const Words& w, const Operands& o) {
  const std::vector<int> to = o.empty() ? std::vector<int>() : o[0].registers;
  if (w[0] == "shfl")
    return [to](PtxThread& t) {
      t.set<uint32_t>(to[0], t.out[0]);
      if (to.size() > 1) t.set<bool>(to[1], true);
    };
  if (w[0] == "ldmatrix")
    return [to](PtxThread& t) {
      for (size_t k = 0; k < to.size(); ++k) t.set<uint32_t>(to[k], t.out[k]);
    };
  if (w[0] == "mma")
    return [to](PtxThread& t) {
      for (size_t k = 0; k < to.size(); ++k) t.set<float>(to[k], t.sum[k]);
    };
  return {};
}

void do_warp_work(PtxThread* lanes) {
  const WarpWork work = lanes[0].work;
  for (int l = 1; l < 32; ++l)
    GIGA_CHECK(lanes[l].state == PtxThread::State::at_warp && lanes[l].next == lanes[0].next, "lanes 0 and ", l,
               " of a warp want different things");
  if (work == WarpWork::shuffle_xor)
    for (int l = 0; l < 32; ++l) lanes[l].out[0] = lanes[l ^ static_cast<int>(lanes[l].in[1])].in[0];
  if (work == WarpWork::shuffle_index)
    for (int l = 0; l < 32; ++l) lanes[l].out[0] = lanes[lanes[l].in[1] % 32].in[0];
  if (work == WarpWork::multiply_tiles) multiply_tiles(lanes);
  if (work == WarpWork::load_matrices) load_matrices(lanes);
}

}  // namespace giga::test
