// Levels of x86-64 that this processor and its operating system have: 1 baseline, 2 with AVX2 and FMA, 3 with AVX-512.
#include "arrays.h"
#if defined(__x86_64__)
#include <cpuid.h>
#endif

extern "C" EXPORT int count_levels() {
#if defined(__x86_64__)
  unsigned eax, ebx, ecx, edx;
  if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx) || !(ecx >> 27 & 1)) return 1;  // no XGETBV: registers may not be kept
  const bool fma = ecx >> 12 & 1, f16c = ecx >> 29 & 1;
  unsigned kept, high;  // the registers that the operating system keeps when it changes tasks
  __asm__("xgetbv" : "=a"(kept), "=d"(high) : "c"(0));
  if (!__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx)) return 1;
  const unsigned avx2 = 1u << 3 | 1u << 5 | 1u << 8;                             // BMI1, AVX2, BMI2
  const unsigned avx512 = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;  // F, DQ, CD, BW, VL
  if (!fma || !f16c || (ebx & avx2) != avx2 || (kept & 0x06) != 0x06) return 1;
  return (ebx & avx512) == avx512 && (kept & 0xe6) == 0xe6 ? 3 : 2;
#else
  return 1;
#endif
}
