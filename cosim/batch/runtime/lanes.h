/* Vectors of LANES numbers, and what generated equations are written with (equations.h, fmu_math.h) in each lane, with
 * bit-identical values. LANES and LANES_TARGET (vectors.h) come
 * from the file that includes this first. */
#ifndef LANES_H
#define LANES_H

#include <float.h>
#include <stdint.h>
#include <stddef.h>
#include <string.h>
#include "equations.h"
#include "vectors.h"

typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
typedef int64_t mask __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
typedef lanes real, scalar, local;
typedef lanes lanes_values;
typedef mask condition;

#define CONST __attribute__((const)) /* a call whose value is not needed can go */

/* ------------------------------------------------------------------ conditions */

INLINE lanes lanes_all(double x) {
    lanes r;
    for (int i = 0; i < LANES; i++) r[i] = x;
    return r;
}

/* One bit for each lane. */
INLINE unsigned lanes_bits(mask m) {
#if LANES_TARGET == 512
    return (unsigned)_mm512_movepi64_mask((__m512i)m);
#elif LANES_TARGET == 2
    return (unsigned)_mm256_movemask_pd((__m256d)m);
#else
    unsigned bits = 0;
    for (int i = 0; i < LANES; i++) bits |= (unsigned)(m[i] != 0) << i;
    return bits;
#endif
}

INLINE int lanes_any(mask m) { return lanes_bits(m) != 0; }
INLINE int lanes_every(mask m) { return lanes_bits(m) == (1u << LANES) - 1u; }

INLINE lanes lanes_choose(mask m, lanes a, lanes b) {
#if LANES_TARGET == 512
    return (lanes)_mm512_mask_blend_pd(_mm512_movepi64_mask((__m512i)m), (__m512d)b, (__m512d)a);
#elif LANES_TARGET == 2
    return (lanes)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)m);
#else
    return (lanes)(((mask)a & m) | ((mask)b & ~m));
#endif
}

/* 1 where the condition holds, else 0. */
INLINE lanes lanes_number(mask m) { return (lanes)(m & (mask)lanes_all(1.0)); }
INLINE lanes lanes_when(mask m, lanes a) { return (lanes)((mask)a & m); }
INLINE lanes lanes_if_else(mask m, lanes a, lanes b) { return lanes_choose(m, a, b) + 0.0; }

/* ------------------------------------------------------------------ exact functions */

INLINE lanes lanes_square(lanes x) { return x * x; }
INLINE lanes lanes_fabs(lanes x) { return (lanes)((mask)x & INT64_MAX); }
INLINE lanes lanes_copysign(lanes x, lanes y) { return (lanes)(((mask)x & INT64_MAX) | ((mask)y & INT64_MIN)); }
INLINE lanes lanes_sign(lanes x) {
    return lanes_choose((mask)(x < 0.0), lanes_all(-1.0), lanes_choose((mask)(x > 0.0), lanes_all(1.0), x));
}

/* x < y ? x : y, and x > y ? x : y: y if one of them is a NaN, and of two zeros. */
INLINE lanes lanes_less(lanes x, lanes y) {
#if LANES_TARGET == 512
    return (lanes)_mm512_min_pd((__m512d)x, (__m512d)y);
#elif LANES_TARGET == 2
    return (lanes)_mm256_min_pd((__m256d)x, (__m256d)y);
#else
    return lanes_choose((mask)(x < y), x, y);
#endif
}

INLINE lanes lanes_more(lanes x, lanes y) {
#if LANES_TARGET == 512
    return (lanes)_mm512_max_pd((__m512d)x, (__m512d)y);
#elif LANES_TARGET == 2
    return (lanes)_mm256_max_pd((__m256d)x, (__m256d)y);
#else
    return lanes_choose((mask)(x > y), x, y);
#endif
}

/* Both orders agree but for zeros, of which the signs are combined, and for a NaN, which counts for nothing. */
INLINE lanes lanes_fmax(lanes x, lanes y) {
    const lanes r = (lanes)((mask)lanes_more(x, y) & (mask)lanes_more(y, x));
    return lanes_choose((mask)(x != x), y, lanes_choose((mask)(y != y), x, r));
}

INLINE lanes lanes_fmin(lanes x, lanes y) {
    const lanes r = (lanes)((mask)lanes_less(x, y) | (mask)lanes_less(y, x));
    return lanes_choose((mask)(x != x), y, lanes_choose((mask)(y != y), x, r));
}

/* The same with one number for all lanes: one instruction if it is neither NaN nor the zero that would win. */
INLINE lanes lanes_fmax_of_one(double x, lanes y) {
    if (x == x && !(x == 0.0 && signbit(x))) return lanes_more(y, lanes_all(x));
    return lanes_fmax(lanes_all(x), y);
}

INLINE lanes lanes_fmin_of_one(double x, lanes y) {
    if (x == x && !(x == 0.0 && !signbit(x))) return lanes_less(y, lanes_all(x));
    return lanes_fmin(lanes_all(x), y);
}

INLINE lanes lanes_sqrt(lanes x) {
#if LANES_TARGET == 512
    return (lanes)_mm512_sqrt_pd((__m512d)x);
#elif LANES_TARGET == 2
    return (lanes)_mm256_sqrt_pd((__m256d)x);
#else
    lanes r;
    for (int i = 0; i < LANES; i++) r[i] = sqrt(x[i]);
    return r;
#endif
}

INLINE lanes lanes_floor(lanes x) {
#if LANES_TARGET == 512
    return (lanes)_mm512_roundscale_pd((__m512d)x, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
#elif LANES_TARGET == 2
    return (lanes)_mm256_floor_pd((__m256d)x);
#else
    lanes r;
    for (int i = 0; i < LANES; i++) r[i] = floor(x[i]);
    return r;
#endif
}

INLINE lanes lanes_ceil(lanes x) {
#if LANES_TARGET == 512
    return (lanes)_mm512_roundscale_pd((__m512d)x, _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC);
#elif LANES_TARGET == 2
    return (lanes)_mm256_ceil_pd((__m256d)x);
#else
    lanes r;
    for (int i = 0; i < LANES; i++) r[i] = ceil(x[i]);
    return r;
#endif
}

/* Values and sizes, where numbers may have more than a value (numbers.h). */
#define lanes_value(x) (x)
#define lanes_size(x) lanes_fabs(x)

/* Where numbers are not the same, beyond rounding and at all. */
INLINE mask lanes_moved(lanes was, lanes now) {
    return (mask)(lanes_fabs(now - was) > 1e-12 * lanes_more(lanes_fabs(was), lanes_all(1.0)));
}
INLINE mask lanes_changed(lanes was, lanes now) { return (mask)((mask)now != (mask)was); }

/* ------------------------------------------------------------------ arrays */

INLINE lanes lanes_look_up_table(const double *array, int n, lanes index) {
    lanes r;
    for (int i = 0; i < LANES; i++) r[i] = look_up(array, n, index[i]);
    return r;
}

INLINE lanes lanes_look_up_lanes(const lanes *array, int n, lanes index) {
    lanes r;
    for (int i = 0; i < LANES; i++) {
        const int k = index_of(index[i]);
        r[i] = k >= 0 && k < n ? ((const double *)(array + k))[i] : NAN;
    }
    return r;
}

INLINE void lanes_store(lanes *array, int n, lanes index, lanes value) {
    for (int i = 0; i < LANES; i++) {
        const int k = index_of(index[i]);
        if (k >= 0 && k < n) ((double *)(array + k))[i] = value[i];
    }
}

INLINE lanes lanes_smallest(const lanes *array, int n) {
    lanes least = lanes_all(INFINITY);
    for (int i = 0; i < n; i++) least = lanes_fmin(least, array[i]);
    return least;
}

INLINE lanes lanes_largest(const lanes *array, int n) {
    lanes most = lanes_all(-INFINITY);
    for (int i = 0; i < n; i++) most = lanes_fmax(most, array[i]);
    return most;
}

#define PRODUCTS(x_is, x_type, y_is, y_type)                                                                           \
    INLINE void lanes_add_product_##x_is##_##y_is(                                                                     \
        lanes *z, const x_type *x, const y_type *y, int rows, int inner, int columns) {                                \
        for (int i = 0; i < columns; i++)                                                                              \
            for (int k = 0; k < inner; k++)                                                                            \
                for (int j = 0; j < rows; j++) z[j + i * rows] += x[j + k * rows] * y[k + i * inner];                  \
    }                                                                                                                  \
    INLINE void lanes_product_##x_is##_##y_is(                                                                         \
        lanes *z, const x_type *x, const y_type *y, int rows, int inner, int columns) {                                \
        for (int i = 0; i < rows * columns; i++) z[i] = lanes_all(0.0);                                                \
        lanes_add_product_##x_is##_##y_is(z, x, y, rows, inner, columns);                                              \
    }
PRODUCTS(lanes, lanes, lanes, lanes)
PRODUCTS(table, double, lanes, lanes)
PRODUCTS(lanes, lanes, table, double)

/* ------------------------------------------------------------------ functions of the mathematical library */

#define IN_EACH_LANE(name)                                            \
    NOINLINE CONST lanes lanes_##name(lanes x) {                      \
        lanes r;                                                      \
        for (int i = 0; i < LANES; i++) r[i] = fmu_##name(x[i]);      \
        return r;                                                     \
    }
#define IN_EACH_LANE_OF_TWO(name)                                     \
    NOINLINE CONST lanes lanes_##name(lanes x, lanes y) {             \
        lanes r;                                                      \
        for (int i = 0; i < LANES; i++) r[i] = fmu_##name(x[i], y[i]); \
        return r;                                                     \
    }
IN_EACH_LANE(acos) IN_EACH_LANE(acosh) IN_EACH_LANE(asin) IN_EACH_LANE(asinh) IN_EACH_LANE(atan) IN_EACH_LANE(atanh)
IN_EACH_LANE(cosh) IN_EACH_LANE(erf) IN_EACH_LANE(erfc) IN_EACH_LANE(exp) IN_EACH_LANE(expm1) IN_EACH_LANE(log)
IN_EACH_LANE(log1p) IN_EACH_LANE(sinh) IN_EACH_LANE(tan) IN_EACH_LANE(tanh)
IN_EACH_LANE_OF_TWO(atan2) IN_EACH_LANE_OF_TWO(fmod) IN_EACH_LANE_OF_TWO(hypot) IN_EACH_LANE_OF_TWO(pow)
IN_EACH_LANE_OF_TWO(remainder)

/* Sine and cosine in the operations of musl's __sin.c, __cos.c and __rem_pio2.c, for lanes that all take the same way
 * there: |x| <= pi/4, or |x| from 9 pi/4 to a million with one round of reduction. */

INLINE lanes kernel_sin(lanes x) {
    const lanes z = x * x, w = z * z, v = z * x;
    const lanes r = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06) +
                    z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10);
    return x + v * (-1.66666666666666324348e-01 + z * r);
}

INLINE lanes kernel_sin_of_two(lanes x, lanes y) {
    const lanes z = x * x, w = z * z, v = z * x;
    const lanes r = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06) +
                    z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10);
    return x - ((z * (0.5 * y - v * r) - y) - v * -1.66666666666666324348e-01);
}

INLINE lanes kernel_cos(lanes x) {
    const lanes z = x * x, ww = z * z;
    const lanes r =
        z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05)) +
        ww * ww * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    const lanes hz = 0.5 * z, w = 1.0 - hz;
    return w + (((1.0 - w) - hz) + z * r);
}

INLINE lanes kernel_cos_of_two(lanes x, lanes y) {
    const lanes z = x * x, ww = z * z;
    const lanes r =
        z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05)) +
        ww * ww * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    const lanes hz = 0.5 * z, w = 1.0 - hz;
    return w + (((1.0 - w) - hz) + (z * r - x * y));
}

INLINE mask high_word(lanes x) { return ((mask)x & INT64_MAX) >> 32; }

#define BEYOND 0x3fe921fb /* high word of the last number <= pi/4 */

/* n and both parts of x - n pi/2; returns 0 where a lane needs another way. */
INLINE int reduced(lanes x, mask *n, lanes *y0, lanes *y1) {
    const mask ix = high_word(x);
    if (!lanes_every((mask)(ix > 0x401c463b) & (mask)(ix < 0x413921fb))) return 0;
    const double toint = 1.5 / DBL_EPSILON;
    const lanes shifted = x * 6.36619772367581382433e-01 + toint, fn = shifted - toint;
    const lanes r = x - fn * 1.57079632673412561417e+00, w = fn * 6.07710050650619224932e-11, y = r - w;
    const mask ey = ((mask)y >> 52) & 0x7ff, ex = ix >> 20;
    if (lanes_any((mask)(ex - ey > 16) | (mask)(lanes_fabs(y) > 0x1.921fb54442d18p-1))) return 0;
    *n = (mask)shifted & 3; /* its last bits are those of the integer */
    *y0 = y;
    *y1 = (r - y) - w;
    return 1;
}

NOINLINE CONST lanes sin_apart(lanes x) {
    mask n;
    lanes y0, y1, r;
    if (reduced(x, &n, &y0, &y1)) {
        r = lanes_choose((mask)((n & 1) != 0), kernel_cos_of_two(y0, y1), kernel_sin_of_two(y0, y1));
        return lanes_choose((mask)((n & 2) != 0), -r, r);
    }
    for (int i = 0; i < LANES; i++) r[i] = sin(x[i]);
    return r;
}

NOINLINE CONST lanes cos_apart(lanes x) {
    mask n;
    lanes y0, y1, r;
    if (reduced(x, &n, &y0, &y1)) {
        r = lanes_choose((mask)((n & 1) != 0), kernel_sin_of_two(y0, y1), kernel_cos_of_two(y0, y1));
        return lanes_choose((mask)(((n + 1) & 2) != 0), -r, r);
    }
    for (int i = 0; i < LANES; i++) r[i] = cos(x[i]);
    return r;
}

INLINE lanes lanes_sin(lanes x) {
    const mask ix = high_word(x);
    if (!lanes_every((mask)(ix <= BEYOND))) return sin_apart(x);
    return lanes_choose((mask)(ix < 0x3e500000), x, kernel_sin(x));
}

INLINE lanes lanes_cos(lanes x) {
    const mask ix = high_word(x);
    if (!lanes_every((mask)(ix <= BEYOND))) return cos_apart(x);
    return lanes_choose((mask)(ix < 0x3e46a09e), lanes_all(1.0), kernel_cos(x));
}

#endif
