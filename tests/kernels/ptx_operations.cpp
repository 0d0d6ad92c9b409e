#include "kernels/ptx_operations.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cfenv>
#include <cmath>
#include <initializer_list>
#include <limits>

namespace giga::test {
namespace {

using Words = std::vector<std::string>;
using Operands = std::vector<PtxOperand>;
using Operation = std::function<void(PtxThread&)>;

constexpr uint32_t kAllLanes = 0xFFFFFFFF;

bool has(const Words& words, const char* word) { return std::find(words.begin(), words.end(), word) != words.end(); }

[[noreturn]] void refuse(const Words& words) {
  std::string name;
  for (const std::string& word : words) name += (name.empty() ? "" : ".") + word;
  throw Error("no PTX instruction that is known here: " + name);
}

float from_half(uint16_t bits) { return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(bits)); }
uint16_t to_half(float x) { return Eigen::numext::bit_cast<uint16_t>(static_cast<Eigen::half>(x)); }
/// What is too large becomes the largest.
uint16_t to_half_held(float x) {
  const uint16_t bits = to_half(x);
  return (bits & 0x7FFF) == 0x7C00 ? static_cast<uint16_t>((bits & 0x8000) | 0x7BFF) : bits;
}
uint16_t part(uint32_t pair, int which) { return static_cast<uint16_t>(pair >> (16 * which)); }
uint32_t pair_of(uint16_t low, uint16_t high) { return low | static_cast<uint32_t>(high) << 16; }

/// Refuses what has another part of its name than the first, these and types.
void allow(const Words& words, std::initializer_list<const char*> known) {
  constexpr const char* kTypes[] = {"f32", "f64", "f16", "f16x2", "s8",  "u8",  "b8",  "s16", "u16",
                                    "b16", "s32", "u32", "b32",   "s64", "u64", "b64", "pred"};
  for (size_t k = 1; k < words.size(); ++k) {
    const auto is = [&](const char* word) { return words[k] == word; };
    if (std::none_of(std::begin(kTypes), std::end(kTypes), is) && std::none_of(known.begin(), known.end(), is))
      refuse(words);
  }
}
/// Refuses another number of operands.
void expect_operands(const Words& words, const Operands& operands, size_t count) {
  if (operands.size() != count) refuse(words);
}

/// f<T>() for the type that a word names.
template <class F>
Operation with_type(const Words& words, const std::string& name, F&& f) {
  if (name == "f32") return f.template operator()<float>();
  if (name == "f64") return f.template operator()<double>();
  if (name == "s32") return f.template operator()<int32_t>();
  if (name == "u32" || name == "b32") return f.template operator()<uint32_t>();
  if (name == "s64") return f.template operator()<int64_t>();
  if (name == "u64" || name == "b64") return f.template operator()<uint64_t>();
  if (name == "s16") return f.template operator()<int16_t>();
  if (name == "u16" || name == "b16") return f.template operator()<uint16_t>();
  if (name == "u8" || name == "b8") return f.template operator()<uint8_t>();
  if (name == "pred") return f.template operator()<bool>();
  refuse(words);
}

/// Numbers below the smallest normal one are 0 where the instruction says so.
template <class T>
T flushed(T x, bool flush) {
  if constexpr (std::is_same_v<T, float>)
    if (flush && std::fabs(x) < std::numeric_limits<float>::min()) return std::copysign(0.0f, x);
  return x;
}

/// d = f(a, ...), of one type.
template <class T, class F>
Operation compute(const Words& words, const Operands& o, F f) {
  constexpr size_t kCount = std::is_invocable_v<F, T> ? 1 : std::is_invocable_v<F, T, T> ? 2 : 3;
  expect_operands(words, o, 1 + kCount);
  const bool flush = has(words, "ftz");
  const int d = o[0].at(), a = o[1].at(), b = o[std::min<size_t>(2, kCount)].at(), c = o[kCount].at();
  return [=](PtxThread& t) {
    const auto x = [&](int at) { return flushed(t.get<T>(at), flush); };
    if constexpr (kCount == 1)
      t.set<T>(d, flushed(static_cast<T>(f(x(a))), flush));
    else if constexpr (kCount == 2)
      t.set<T>(d, flushed(static_cast<T>(f(x(a), x(b))), flush));
    else
      t.set<T>(d, flushed(static_cast<T>(f(x(a), x(b), x(c))), flush));
  };
}

/// Of integers without overflow.
template <class T>
auto modular(T x) {
  if constexpr (std::is_integral_v<T>)
    return static_cast<uint64_t>(static_cast<int64_t>(x));
  else
    return x;
}

/// f(numbers) with another rounding of its last step.
template <class F, class... T>
auto rounded(int how, F&& f, T... numbers) {
  const int before = std::fegetround();
  std::fesetround(how);
  const auto late = [](const volatile auto& x) { return x; };  // which no compiler computes with before
  const volatile auto x = f(late(numbers)...);
  std::fesetround(before);
  return static_cast<decltype(f(numbers...))>(x);
}

Operation arithmetic(const Words& w, const Operands& o) {
  const std::string& name = w[0];
  // Other roundings than to the nearest: of one instruction each.
  allow(w, {"lo", "hi", "wide", "rn", "approx", "ftz", name == "fma" ? "rm" : "rn", name == "add" ? "rz" : "rn"});
  if (w.back() == "f16x2" && name == "mul" && w.size() == 2)
    return compute<uint32_t>(w, o, [](uint32_t a, uint32_t b) {
      const auto product = [&](int k) { return to_half(from_half(part(a, k)) * from_half(part(b, k))); };
      return pair_of(product(0), product(1));
    });
  return with_type(w, w.back(), [&]<class T>() -> Operation {
    constexpr bool kFloat = std::is_floating_point_v<T>;
    if constexpr (!std::is_same_v<T, bool>) {
      if (name == "add" && has(w, "rz"))
        return compute<T>(w, o, [](T a, T b) {
          return rounded(
              FE_TOWARDZERO, [](T x, T y) { return x + y; }, a, b);
        });
      if (name == "add") return compute<T>(w, o, [](T a, T b) { return modular(a) + modular(b); });
      if (name == "sub") return compute<T>(w, o, [](T a, T b) { return modular(a) - modular(b); });
      if (name == "neg") return compute<T>(w, o, [](T a) { return -modular(a); });
      if ((name == "mul" || name == "mad") && (kFloat || w[1] == "lo"))
        return name == "mul" ? compute<T>(w, o, [](T a, T b) { return modular(a) * modular(b); })
                             : compute<T>(w, o, [](T a, T b, T c) { return modular(a) * modular(b) + modular(c); });
      if (name == "div") return compute<T>(w, o, [](T a, T b) { return kFloat || b != 0 ? a / b : T(-1); });
      if (name == "abs") return compute<T>(w, o, [](T a) { return a < 0 ? -modular(a) : modular(a); });
      // The number, where the other is none.
      if (name == "min") return compute<T>(w, o, [](T a, T b) { return a != a || b < a ? b : a; });
      if (name == "max") return compute<T>(w, o, [](T a, T b) { return a != a || b > a ? b : a; });
    }
    if constexpr (kFloat) {
      if (name == "fma" && has(w, "rm"))
        return compute<T>(w, o, [](T a, T b, T c) {
          return rounded(
              FE_DOWNWARD, [](T x, T y, T z) { return std::fma(x, y, z); }, a, b, c);
        });
      if (name == "fma") return compute<T>(w, o, [](T a, T b, T c) { return std::fma(a, b, c); });
      if (name == "rcp") return compute<T>(w, o, [](T a) { return 1 / a; });
      if (name == "sqrt") return compute<T>(w, o, [](T a) { return std::sqrt(a); });
      if (name == "ex2") return compute<T>(w, o, [](T a) { return std::exp2(a); });
      if (name == "lg2") return compute<T>(w, o, [](T a) { return std::log2(a); });
      if (name == "tanh") return compute<T>(w, o, [](T a) { return std::tanh(a); });
      if (name == "copysign") return compute<T>(w, o, [](T sign, T a) { return std::copysign(a, sign); });
    } else {
      if (name == "and") return compute<T>(w, o, [](T a, T b) { return a & b; });
      if (name == "or") return compute<T>(w, o, [](T a, T b) { return a | b; });
      if (name == "xor") return compute<T>(w, o, [](T a, T b) { return a ^ b; });
      if (name == "not")
        return compute<T>(w, o, [](T a) {
          if constexpr (std::is_same_v<T, bool>)
            return !a;
          else
            return ~a;
        });
    }
    if constexpr (std::is_integral_v<T> && !std::is_same_v<T, bool>) {
      if (name == "rem") return compute<T>(w, o, [](T a, T b) { return b != 0 ? a % b : a; });
      if (name == "shl" || name == "shr") {
        expect_operands(w, o, 3);
        return [left = name == "shl", d = o[0].at(), a = o[1].at(), by = o[2].at()](PtxThread& t) {
          constexpr uint32_t kBits = 8 * sizeof(T);
          const auto n = t.get<uint32_t>(by);
          const T x = t.get<T>(a);
          if (n >= kBits)
            t.set<T>(d, !left && x < 0 ? T(-1) : T(0));
          else
            t.set<T>(d, static_cast<T>(left ? modular(x) << n : static_cast<uint64_t>(x >> n)));
        };
      }
    }
    if constexpr (std::is_same_v<T, uint64_t>) {
      if (name == "bfi") {  // bits of a into b: as many as o[4] says, from o[3] on
        expect_operands(w, o, 5);
        const int d = o[0].at(), a = o[1].at(), b = o[2].at(), first = o[3].at(), count = o[4].at();
        return [=](PtxThread& t) {
          const uint32_t n = t.get<uint32_t>(count), at = t.get<uint32_t>(first);
          const uint64_t mask = (n < 64 ? (uint64_t{1} << n) - 1 : ~uint64_t{0}) << at;
          t.set<T>(d, (t.get<T>(b) & ~mask) | ((t.get<T>(a) << at) & mask));
        };
      }
    }
    if constexpr (std::is_same_v<T, int32_t> || std::is_same_v<T, uint32_t>) {
      using Wide = std::conditional_t<std::is_signed_v<T>, int64_t, uint64_t>;
      if (w[1] == "hi" && name == "mul")
        return compute<T>(w, o, [](T a, T b) { return (static_cast<Wide>(a) * static_cast<Wide>(b)) >> 32; });
      if (w[1] == "wide" && (name == "mul" || name == "mad")) {
        const bool adds = name == "mad";
        expect_operands(w, o, adds ? 4 : 3);
        return [=, d = o[0].at(), a = o[1].at(), b = o[2].at(), c = o.back().at()](PtxThread& t) {
          const Wide product = static_cast<Wide>(t.get<T>(a)) * static_cast<Wide>(t.get<T>(b));
          t.set<Wide>(d, product + (adds ? t.get<Wide>(c) : 0));
        };
      }
    }
    refuse(w);
  });
}

Operation comparison(const Words& w, const Operands& o) {
  expect_operands(w, o, 3);
  allow(w, {w[1].c_str(), "ftz"});
  const std::string& how = w[1];
  const int d = o[0].at(), a = o[1].at(), b = o[2].at();
  return with_type(w, w.back(), [&]<class T>() -> Operation {
    const auto by = [&](auto f) -> Operation {
      const bool flush = has(w, "ftz");
      return [=](PtxThread& t) { t.set<bool>(d, f(flushed(t.get<T>(a), flush), flushed(t.get<T>(b), flush))); };
    };
    // Comparisons with a NaN are false, but true where their name ends in u; of integers that means nothing.
    const auto nan = [](T x, T y) { return x != x || y != y; };
    if (how == "eq") return by([](T x, T y) { return x == y; });
    if (how == "ne") return by([=](T x, T y) { return !nan(x, y) && x != y; });
    if (how == "lt") return by([](T x, T y) { return x < y; });
    if (how == "le") return by([](T x, T y) { return x <= y; });
    if (how == "gt") return by([](T x, T y) { return x > y; });
    if (how == "ge") return by([](T x, T y) { return x >= y; });
    if (how == "equ") return by([=](T x, T y) { return nan(x, y) || x == y; });
    if (how == "neu") return by([](T x, T y) { return x != y; });
    if (how == "ltu") return by([](T x, T y) { return !(x >= y); });
    if (how == "leu") return by([](T x, T y) { return !(x > y); });
    if (how == "gtu") return by([](T x, T y) { return !(x <= y); });
    if (how == "geu") return by([](T x, T y) { return !(x < y); });
    refuse(w);
  });
}

Operation selection(const Words& w, const Operands& o) {
  expect_operands(w, o, 4);
  allow(w, {});
  const int d = o[0].at(), a = o[1].at(), b = o[2].at(), p = o[3].at();
  return with_type(w, w.back(), [&]<class T>() -> Operation {
    return [=](PtxThread& t) { t.set<T>(d, t.get<T>(t.get<bool>(p) ? a : b)); };
  });
}

/// Also of registers that are the parts of one.
Operation move(const Words& w, const Operands& o) {
  expect_operands(w, o, 2);
  allow(w, {});
  const PtxOperand to = o[0], from = o[1];
  if (to.registers.size() > 2 || from.registers.size() > 2 ||
      (w.back() != "b32" && w.back() != "b64" && to.registers.size() + from.registers.size() > 2))
    refuse(w);
  const bool halves = w.back() == "b32";
  if (to.registers.size() == 2)
    return [=](PtxThread& t) {
      const auto x = t.get<uint64_t>(from.at());
      for (int k = 0; k < 2; ++k) {
        const int d = to.registers[static_cast<size_t>(k)];
        halves ? t.set<uint16_t>(d, part(static_cast<uint32_t>(x), k))
               : t.set<uint32_t>(d, static_cast<uint32_t>(x >> (32 * k)));
      }
    };
  if (from.registers.size() == 2)
    return [=](PtxThread& t) {
      const auto low = t.get<uint32_t>(from.registers[0]), high = t.get<uint32_t>(from.registers[1]);
      halves ? t.set<uint32_t>(to.at(), pair_of(static_cast<uint16_t>(low), static_cast<uint16_t>(high)))
             : t.set<uint64_t>(to.at(), low | static_cast<uint64_t>(high) << 32);
    };
  return with_type(w, w.back(), [&]<class T>() -> Operation {
    return [d = to.at(), a = from.at()](PtxThread& t) { t.set<T>(d, t.get<T>(a)); };
  });
}

Operation conversion(const Words& w, const Operands& o) {
  expect_operands(w, o, has(w, "f16x2") ? 3 : 2);
  allow(w, {"rn", "rni", "ftz", has(w, "f16x2") ? "satfinite" : "sat"});
  const int d = o[0].at(), a = o[1].at();
  const std::string &to = w[w.size() - 2], &from = w.back();
  if (to == "f16x2" && has(w, "satfinite"))
    return [=, low = o[2].at()](PtxThread& t) {
      t.set<uint32_t>(d, pair_of(to_half_held(t.get<float>(low)), to_half_held(t.get<float>(a))));
    };
  if (from == "f16") {
    if (to != "f32") refuse(w);
    return [=](PtxThread& t) { t.set<float>(d, from_half(t.get<uint16_t>(a))); };
  }
  return with_type(w, from, [&]<class From>() -> Operation {
    if (to == "f16") return [=](PtxThread& t) { t.set<uint16_t>(d, to_half(static_cast<float>(t.get<From>(a)))); };
    return with_type(w, to, [&]<class To>() -> Operation {
      if constexpr (std::is_floating_point_v<From>) {
        if (has(w, "rni")) return [=](PtxThread& t) { t.set<To>(d, static_cast<To>(std::nearbyint(t.get<From>(a)))); };
        if (!std::is_floating_point_v<To>) refuse(w);
        if (has(w, "sat"))  // into 0 to 1; a NaN becomes 0
          return [=](PtxThread& t) { t.set<To>(d, static_cast<To>(std::fmin(std::fmax(t.get<From>(a), 0), 1))); };
      }
      return [=](PtxThread& t) { t.set<To>(d, static_cast<To>(t.get<From>(a))); };
    });
  });
}

Operation memory(const Words& w, const Operands& o) {
  expect_operands(w, o, 2);
  allow(w, {"global", "shared", "local", "param", "nc", "v2", "v4"});
  const bool load = w[0] == "ld", shared = has(w, "shared");
  const PtxOperand numbers = o[load ? 0 : 1], address = o[load ? 1 : 0];
  return with_type(w, w.back(), [&]<class T>() -> Operation {
    return [=](PtxThread& t) {
      const size_t n = numbers.registers.size(), bytes = n * sizeof(T);
      char* at = nullptr;
      if (shared)
        at = t.in_shared(static_cast<uint32_t>(t.get<uint32_t>(address.at()) + address.offset), bytes);
      else
        at = reinterpret_cast<char*>(t.get<uint64_t>(address.at()) + static_cast<uint64_t>(address.offset));
      GIGA_CHECK(reinterpret_cast<uintptr_t>(at) % bytes == 0, "an address of ", bytes, " bytes");
      for (size_t k = 0; k < n; ++k) {
        T x = t.get<T>(numbers.registers[k]);
        load ? std::memcpy(&x, at + k * sizeof(T), sizeof(T)) : std::memcpy(at + k * sizeof(T), &x, sizeof(T));
        if (!load) continue;
        if constexpr (std::is_integral_v<T> && std::is_signed_v<T>)  // the register may be wider
          t.set<int64_t>(numbers.registers[k], x);
        else
          t.set<T>(numbers.registers[k], x);
      }
    };
  });
}

Operation asynchronous_copy(const Words& w, const Operands& o) {
  if (has(w, "wait_all")) return [](PtxThread& t) { t.deliver_copies(); };
  if (!has(w, "shared") || !has(w, "global") || o.size() < 3) refuse(w);
  allow(w, {"async", "ca", "cg", "shared", "global"});
  const PtxOperand to = o[0], from = o[1];
  const int bytes = o[2].at(), some = o.size() > 3 ? o[3].at() : bytes;
  return [=](PtxThread& t) {
    t.copies.push_back(
        {static_cast<uint32_t>(t.get<uint32_t>(to.at()) + to.offset), static_cast<int>(t.get<uint32_t>(bytes)),
         static_cast<int>(t.get<uint32_t>(some)),
         reinterpret_cast<const char*>(t.get<uint64_t>(from.at()) + static_cast<uint64_t>(from.offset))});
    if (t.copies_at_once) t.deliver_copies();
  };
}

// The results of a warp's work are taken by a second operation, behind the first (PtxModule adds it).
Operation hand_in(const Words& w, const Operands& o) {
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

std::function<void(PtxThread&)> ptx_operation(const Words& w, const Operands& o) {
  const std::string& name = w[0];
  if (name == "mov") return move(w, o);
  if (name == "cvt") return conversion(w, o);
  if (name == "setp") return comparison(w, o);
  if (name == "selp") return selection(w, o);
  if (name == "ld" || name == "st") return memory(w, o);
  if (name == "cp") return asynchronous_copy(w, o);
  if (name == "bar" || name == "shfl" || name == "mma" || name == "ldmatrix") return hand_in(w, o);
  if (name == "cvta") {  // of global and local memory addresses are generic ones
    expect_operands(w, o, 2);
    if (has(w, "shared") && !has(w, "to"))
      return [d = o[0].at(), a = o[1].at()](PtxThread& t) { t.set<char*>(d, t.shared + t.get<uint64_t>(a)); };
    if (!has(w, "global") && !has(w, "local")) refuse(w);
    return move({"mov", "u64"}, o);
  }
  if (name == "membar" || name == "fence" || name == "prefetch") return [](PtxThread&) {};
  return arithmetic(w, o);
}

std::function<void(PtxThread&)> ptx_result(const Words& w, const Operands& o) {
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
