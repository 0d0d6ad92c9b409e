// Arithmetic, comparisons and selections of PTX.
#include <cfenv>
#include <cmath>
#include <limits>

#include "kernels/ptx_words.hpp"

namespace giga::test {
namespace {

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

/// Four of the eight bytes of a (0 to 3) and b (4 to 7), as the four numbers of four bits each in c say; with a
/// number's fourth bit, eight times the byte's sign instead.
Operation permutation(const Words& w, const Operands& o) {
  allow(w, {});
  return compute<uint32_t>(w, o, [](uint32_t a, uint32_t b, uint32_t c) {
    const uint64_t bytes = a | static_cast<uint64_t>(b) << 32;
    uint32_t all = 0;
    for (int k = 0; k < 4; ++k) {
      const uint32_t which = c >> (4 * k) & 15;
      auto byte = static_cast<uint8_t>(bytes >> (8 * (which & 7)));
      if (which & 8) byte = byte & 0x80 ? 0xff : 0;
      all |= static_cast<uint32_t>(byte) << (8 * k);
    }
    return all;
  });
}

}  // namespace

Operation ptx_arithmetic(const Words& w, const Operands& o) {
  if (w[0] == "setp") return comparison(w, o);
  if (w[0] == "selp") return selection(w, o);
  if (w[0] == "prmt") return permutation(w, o);
  return arithmetic(w, o);
}

}  // namespace giga::test
