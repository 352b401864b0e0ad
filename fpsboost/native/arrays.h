// Arrays as Python passes them, and how kernels are defined. The build makes constants.h and records.h of the
// descriptions in fpsboost/kernels.
#pragma once
#include "constants.h"

#define INLINE_LAMBDA __attribute__((always_inline))
#define FORCE_INLINE inline INLINE_LAMBDA
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#ifndef LEVEL
#define LEVEL baseline
#endif
#define JOINED(name, level) name##_##level
#define AT_LEVEL(name, level) JOINED(name, level)
// Begins the function that `compiled` of fpsboost/kernels/binding.py calls, once for each level of processors. It is
// declared in records.h, under a name that ends with a checksum of its description.
#define KERNEL(type, name, parameter) extern "C" EXPORT type ENTRY_##name(parameter)

struct Float {  // number that is rounded to float32
  double value;

  FORCE_INLINE operator float() const { return float(value); }
};

struct Any {};  // one of several types: that of the array's kind

template <typename T, int AXES> struct ArrayOf {  // as `array_field` of binding.py packs it; steps are in elements
  T *data;
  Kind kind;
  Int shape[MAX_AXES], steps[MAX_AXES];
};

// Everything below is compiled at each level by itself: nothing may be shared between them, or the linker would keep
// the code of one level for all.
namespace {

// Calls use(T()) with the type of pixels that a kind stands for.
template <typename Use> FORCE_INLINE auto with_pixel_type(Kind kind, const Use &use) {
  switch (kind) {
    case UINT8: return use(uint8_t());
    case UINT16: return use(uint16_t());
    default: return use(float());
  }
}

// The same bytes as another type: of pointers, and of vectors.
template <typename To, typename From> FORCE_INLINE To as(From value) { return reinterpret_cast<To>(value); }

template <typename T, typename Described> constexpr bool may_view = false;
template <typename T> constexpr bool may_view<T, T> = true;
template <typename T> constexpr bool may_view<T, const Any> = true;

// An array of some type that fills its memory in C order; view(i, j) is an element, view.ptr(i) the address of a row.
template <typename T, int N> struct View {
  T *data;
  Int shape[N];

  View() = default;
  template <typename Described> explicit View(const ArrayOf<Described, N> &array) : data(as<T *>(array.data)) {
    static_assert(may_view<const T, const Described>, "the type of elements that the array is described with");
    for (int n = 0; n < N; n++) shape[n] = array.shape[n];
  }
  template <typename... Indices> T *ptr(Indices... indices) const {
    const Int given[] = {Int(indices)...};
    Int place = 0;
    for (int n = 0; n < N; n++) place = place * shape[n] + (n < int(sizeof...(Indices)) ? given[n] : 0);
    return data + place;
  }
  template <typename... Indices> T &operator()(Indices... indices) const {
    static_assert(sizeof...(Indices) == N, "one index for each axis");
    return *ptr(indices...);
  }
  View<T, N - 1> operator[](Int index) const {
    View<T, N - 1> part;
    part.data = ptr(index);
    for (int n = 1; n < N; n++) part.shape[n - 1] = shape[n];
    return part;
  }
};

template <typename T> FORCE_INLINE T min(T a, T b) { return a < b ? a : b; }
template <typename T> FORCE_INLINE T max(T a, T b) { return a > b ? a : b; }
template <typename T> FORCE_INLINE T clamp(T value, T low, T high) { return min(max(value, low), high); }
struct Vector {  // of motion, pixels
  float dx, dy;
};

FORCE_INLINE float absolute(float value) { return __builtin_fabsf(value); }

}  // namespace
