// The little of the standard library that the step needs, for the compiler of the CUDA runtime (NVRTC), which has none.
// It stands for <bit>, <cmath>, <concepts> and so on (step_compiler.cpp); no other compiler sees it.
#pragma once

#define INT_MAX 2147483647

using int8_t = signed char;
using uint8_t = unsigned char;
using int16_t = short;
using uint16_t = unsigned short;
using int32_t = int;
using uint32_t = unsigned int;
using int64_t = long;
using uint64_t = unsigned long;
using uintptr_t = unsigned long;
static_assert(sizeof(int64_t) == 8);

namespace std {

using ::size_t;

// <type_traits>
template <class T, T kValue>
struct integral_constant {
  static constexpr T value = kValue;
  using value_type = T;
  constexpr operator T() const { return kValue; }
};
template <bool kFirst, class A, class B>
struct conditional {
  using type = A;
};
template <class A, class B>
struct conditional<false, A, B> {
  using type = B;
};
template <bool kFirst, class A, class B>
using conditional_t = typename conditional<kFirst, A, B>::type;
template <class T>
using remove_reference_t = __remove_reference(T);
template <class T>
using remove_cvref_t = __remove_cv(__remove_reference(T));

// <utility>
template <class T>
T&& declval() noexcept;
template <class T, T... kAll>
struct integer_sequence {};
template <class T, T... kAll>
constexpr integer_sequence<T, kAll..., sizeof...(kAll)> one_more(integer_sequence<T, kAll...>);
template <class T, int kCount>
struct counted {
  using type = decltype(one_more(typename counted<T, kCount - 1>::type{}));
};
template <class T>
struct counted<T, 0> {
  using type = integer_sequence<T>;
};
template <class T, T kCount>
using make_integer_sequence = typename counted<T, static_cast<int>(kCount)>::type;
template <size_t... kAll>
using index_sequence = integer_sequence<size_t, kAll...>;
template <size_t kCount>
using make_index_sequence = make_integer_sequence<size_t, kCount>;

// <concepts>
template <class T, class Base>
concept derived_from = __is_base_of(Base, T) && __is_convertible_to(const volatile T*, const volatile Base*);

// <bit>
template <class To, class From>
constexpr To bit_cast(const From& from) {
  return __builtin_bit_cast(To, from);
}
constexpr unsigned bit_ceil(unsigned x) {
  unsigned power = 1;
  while (power < x) power *= 2;
  return power;
}

// <cmath>: correctly rounded, as everywhere (-prec-sqrt=true)
inline __device__ float sqrt(float x) { return ::sqrtf(x); }
inline __device__ float rint(float x) { return ::rintf(x); }

}  // namespace std
