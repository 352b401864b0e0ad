// Arrays as Python passes them, and how kernels are defined. The build makes constants.h and records.h of the
// descriptions in fpsboost/kernels.
#pragma once
#include "constants.h"

#define INLINE static inline __attribute__((always_inline))
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
#define KERNEL(type, name, Arguments) extern "C" EXPORT type ENTRY_##name(const Arguments &a)

struct Array {  // as `array_field` of binding.py packs it; steps are in elements
  void *data;
  Kind kind;
  Int shape[MAX_AXES], steps[MAX_AXES];
};

struct Any {};  // one of several types: that of the array's kind

template <typename T, int AXES> struct ArrayOf : Array {};

// Everything below is compiled at each level by itself: nothing may be shared between them, or the linker would keep
// the code of one level for all.
namespace {

template <typename T, typename Described> constexpr bool may_view = false;
template <typename T> constexpr bool may_view<T, T> = true;
template <typename T> constexpr bool may_view<const T, T> = true;
template <typename T> constexpr bool may_view<T, Any> = true;

// An array of some type that fills its memory in C order; view(i, j) is an element, view.at(i) the address of a row.
template <typename T, int N> struct View {
  T *data;
  Int shape[N];

  View() = default;
  template <typename Described> explicit View(const ArrayOf<Described, N> &array) : data((T *)array.data) {
    static_assert(may_view<T, Described>, "the type of elements that the array is described with");
    for (int n = 0; n < N; n++) shape[n] = array.shape[n];
  }
  template <typename... Indices> T *at(Indices... indices) const {
    const Int given[] = {Int(indices)...};
    Int place = 0;
    for (int n = 0; n < N; n++) place = place * shape[n] + (n < int(sizeof...(Indices)) ? given[n] : 0);
    return data + place;
  }
  template <typename... Indices> T &operator()(Indices... indices) const {
    static_assert(sizeof...(Indices) == N, "one index for each axis");
    return *at(indices...);
  }
  View<T, N - 1> operator[](Int index) const {
    View<T, N - 1> part;
    part.data = at(index);
    for (int n = 1; n < N; n++) part.shape[n - 1] = shape[n];
    return part;
  }
};

template <typename T> INLINE T least(T a, T b) { return a < b ? a : b; }
template <typename T> INLINE T most(T a, T b) { return a > b ? a : b; }
template <typename T> INLINE T within(T value, T low, T high) { return least(most(value, low), high); }
INLINE float absolute(float value) { return __builtin_fabsf(value); }

}  // namespace
