/* What the files of musl in this folder take from musl's own libm.h, for any C99 compiler and the same bits from all of them.
 *
 * Derived from src/internal/libm.h of musl 1.2.5 (MIT, see COPYRIGHT). Changed: without byte order, long double and the
 * headers of one architecture; every function gets the prefix fmu_ (fmu_math.h), so that no other library is called or
 * replaced; no fused multiply-add even where the processor has it. The other files here are those of musl 1.2.5,
 * src/math, with nothing changed but the names of headers that they include and an alias that remainder.c also defines.
 */
#ifndef FMU_MUSL_LIBM_H
#define FMU_MUSL_LIBM_H

#include <float.h>
#include <math.h>
#include <stdint.h>

#include "../fmu_math.h"

/* 16: half precision is there too and stays what it is; double is evaluated as double, as with 0. */
#if FLT_EVAL_METHOD == 16
#undef FLT_EVAL_METHOD
#define FLT_EVAL_METHOD 0
#endif
#if FLT_EVAL_METHOD != 0
#error double arithmetic must be that of IEEE 754: compile for a processor with SSE2 (-mfpmath=sse), ARM or WebAssembly
#endif

#undef __FP_FAST_FMA
#define TOINT_INTRINSICS 0
#define WANT_ROUNDING 1
#define issignaling_inline(x) 0
#define hidden FMU_HIDDEN

#ifdef __GNUC__
#define predict_true(x) __builtin_expect(!!(x), 1)
#define predict_false(x) __builtin_expect(x, 0)
#else
#define predict_true(x) (x)
#define predict_false(x) (x)
#endif

static inline double eval_as_double(double x)
{
	double y = x;
	return y;
}

/* fp_barrier returns its input, but limits code transformations
   as if it had a side-effect (e.g. observable io) and returned
   an arbitrary value.  */
static inline double fp_barrier(double x)
{
	volatile double y = x;
	return y;
}

/* fp_force_eval ensures that the input value is computed when that's
   otherwise unused.  */
static inline void fp_force_eval(double x)
{
	volatile double y;
	y = x;
	(void)y;
}

#define FORCE_EVAL(x) fp_force_eval(x)

#define asuint(f) ((union{float _f; uint32_t _i;}){f})._i
#define asuint64(f) ((union{double _f; uint64_t _i;}){f})._i
#define asdouble(i) ((union{uint64_t _i; double _f;}){i})._f

#define EXTRACT_WORDS(hi,lo,d)                    \
do {                                              \
  uint64_t __u = asuint64(d);                     \
  (hi) = __u >> 32;                               \
  (lo) = (uint32_t)__u;                           \
} while (0)

#define GET_HIGH_WORD(hi,d)                       \
do {                                              \
  (hi) = asuint64(d) >> 32;                       \
} while (0)

#define GET_LOW_WORD(lo,d)                        \
do {                                              \
  (lo) = (uint32_t)asuint64(d);                   \
} while (0)

#define INSERT_WORDS(d,hi,lo)                     \
do {                                              \
  (d) = asdouble(((uint64_t)(hi)<<32) | (uint32_t)(lo)); \
} while (0)

#define SET_HIGH_WORD(d,hi)                       \
  INSERT_WORDS(d, hi, (uint32_t)asuint64(d))

#define SET_LOW_WORD(d,lo)                        \
  INSERT_WORDS(d, asuint64(d)>>32, lo)

#define __rem_pio2_large(x, y, e0, nx, prec) fmu_rem_pio2_large(x, y, e0, nx, prec)
#define __rem_pio2(x, y) fmu_rem_pio2(x, y)
#define __sin(x, y, iy) fmu_kernel_sin(x, y, iy)
#define __cos(x, y) fmu_kernel_cos(x, y)
#define __tan(x, y, odd) fmu_kernel_tan(x, y, odd)
#define __expo2(x, sign) fmu_expo2(x, sign)
#define __math_xflow(sign, y) fmu_math_xflow(sign, y)
#define __math_uflow(sign) fmu_math_uflow(sign)
#define __math_oflow(sign) fmu_math_oflow(sign)
#define __math_divzero(sign) fmu_math_divzero(sign)
#define __math_invalid(x) fmu_math_invalid(x)
#define __exp_data fmu_exp_data
#define __log_data fmu_log_data
#define __pow_log_data fmu_pow_log_data

hidden int    __rem_pio2_large(double*,double*,int,int,int);

hidden int    __rem_pio2(double,double*);
hidden double __sin(double,double,int);
hidden double __cos(double,double);
hidden double __tan(double,double,int);
hidden double __expo2(double,double);

hidden double __math_xflow(uint32_t, double);
hidden double __math_uflow(uint32_t);
hidden double __math_oflow(uint32_t);
hidden double __math_divzero(uint32_t);
hidden double __math_invalid(double);

#endif
