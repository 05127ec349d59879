/* Vector instructions of the code behind it: LANES_TARGET (0 for what every processor has, 2 for AVX2, 512 for AVX-512)
 * comes from the file that includes this first. */
#ifndef VECTORS_H
#define VECTORS_H

#if LANES_TARGET
#include <immintrin.h>
#endif

#if LANES_TARGET == 512 && defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,avx512dq,avx512vl,avx2"))), apply_to = function)
#elif LANES_TARGET == 2 && defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#elif LANES_TARGET == 512
#pragma GCC target("avx512f,avx512dq,avx512vl,avx2")
#elif LANES_TARGET == 2
#pragma GCC target("avx2,fma")
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wpsabi"
#endif

#define INLINE static inline __attribute__((always_inline, unused))
#define NOINLINE static __attribute__((noinline, unused))
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#endif
