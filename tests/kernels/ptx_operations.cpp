// Moves, conversions, memory, and which file knows the other instructions.
#include "kernels/ptx_operations.hpp"

#include <cmath>

#include "kernels/ptx_words.hpp"

namespace giga::test {
namespace {

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
  allow(w, {"global", "shared", "local", "param", "nc", "cg", "v2", "v4"});
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

}  // namespace

Operation ptx_operation(const Words& w, const Operands& o) {
  const std::string& name = w[0];
  if (name == "mov") return move(w, o);
  if (name == "cvt") return conversion(w, o);
  if (name == "ld" || name == "st") return memory(w, o);
  if (name == "cp") return asynchronous_copy(w, o);
  if (is_warp_work(name)) return ptx_warp_work(w, o);
  if (name == "cvta") {  // of global and local memory addresses are generic ones
    expect_operands(w, o, 2);
    if (has(w, "shared") && !has(w, "to"))
      return [d = o[0].at(), a = o[1].at()](PtxThread& t) { t.set<char*>(d, t.shared + t.get<uint64_t>(a)); };
    if (!has(w, "global") && !has(w, "local")) refuse(w);
    return move({"mov", "u64"}, o);
  }
  if (name == "membar" || name == "fence" || name == "prefetch") return [](PtxThread&) {};
  if (name == "griddepcontrol") {  // no kernel runs beside another here
    allow(w, {"wait", "launch_dependents"});
    return [](PtxThread&) {};
  }
  return ptx_arithmetic(w, o);
}

}  // namespace giga::test
