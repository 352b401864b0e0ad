// Arrays and numbers as Python passes them, and how kernels are declared.
#pragma once
#include <stdint.h>

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
// Begins the function that `compiled` of fpsboost/kernels/binding.py calls, once for each level of processors.
#define KERNEL(type, name, Arguments) extern "C" EXPORT type AT_LEVEL(name, LEVEL)(const Arguments &a)

typedef int64_t Int;
enum Kind : Int { UINT8, UINT16, FLOAT32, INT32, INT64, FLOAT64, BOOL };  // KINDS of binding.py

constexpr int MAX_AXES = 5;

struct Array {  // ArrayRecord of binding.py; steps are in elements
  void *data;
  Kind kind;
  Int shape[MAX_AXES], steps[MAX_AXES];
};

// Everything below is compiled at each level by itself: nothing may be shared between them, or the linker would keep the
// code of one level for all.
namespace {

// An array of some type that fills its memory in C order; view(i, j) is an element, view.at(i) the address of a row.
template <typename T, int N> struct View {
  T *data;
  Int shape[N];

  View() = default;
  explicit View(const Array &array) : data((T *)array.data) {
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
