/* The mathematical library inside every FMU: functions of musl under names of their own.
 *
 * Mathematical libraries differ in the last digits, and compilers compute functions of constants with one of theirs.
 * With these names code that includes this header gives bit-identical results on all platforms and compilers.
 * Functions that are not here (sqrt, fabs, copysign) are exact operations of the processor, with GCC and Clang also in
 * functions that are not optimized.
 */
#ifndef FMU_MATH_H
#define FMU_MATH_H

#include <math.h>

/* No multiplication and addition in one rounding, even if whoever compiles this does not give -ffp-contract=off. */
#if defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract(off)
#elif defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off")
#endif

#if defined(__GNUC__) && !defined(_WIN32)
#define FMU_HIDDEN __attribute__((visibility("hidden")))
#else
#define FMU_HIDDEN
#endif

/* Of its arguments alone: a call whose value nothing needs can go. */
#ifdef __GNUC__
#define FMU_FUNCTION FMU_HIDDEN __attribute__((const))
#else
#define FMU_FUNCTION FMU_HIDDEN
#endif

#ifdef __GNUC__
#define copysign(x, y) __builtin_copysign(x, y)
#define fabs(x) __builtin_fabs(x)
#define sqrt(x) __builtin_sqrt(x)
#endif

/* Whether the compiler knows the number. */
#ifdef __GNUC__
#define FMU_IS_CONSTANT(x) __builtin_constant_p(x)
#else
#define FMU_IS_CONSTANT(x) 0
#endif

#define FMU_MATH(name) fmu_##name
#define acos(x) FMU_MATH(acos)(x)
#define acosh(x) FMU_MATH(acosh)(x)
#define asin(x) FMU_MATH(asin)(x)
#define asinh(x) FMU_MATH(asinh)(x)
#define atan(x) FMU_MATH(atan)(x)
#define atan2(y, x) FMU_MATH(atan2)(y, x)
#define atanh(x) FMU_MATH(atanh)(x)
#define ceil(x) FMU_MATH(ceil)(x)
#define cos(x) FMU_MATH(cos)(x)
#define cosh(x) FMU_MATH(cosh)(x)
#define erf(x) FMU_MATH(erf)(x)
#define erfc(x) FMU_MATH(erfc)(x)
#define exp(x) FMU_MATH(exp)(x)
#define expm1(x) FMU_MATH(expm1)(x)
#define floor(x) FMU_MATH(floor)(x)
#define fmax(x, y) FMU_MATH(fmax)(x, y)
#define fmin(x, y) FMU_MATH(fmin)(x, y)
#define fmod(x, y) FMU_MATH(fmod)(x, y)
#define hypot(x, y) FMU_MATH(hypot)(x, y)
#define log(x) FMU_MATH(log)(x)
#define log1p(x) FMU_MATH(log1p)(x)
#define pow(x, y) FMU_MATH(pow)(x, y)
#define remainder(x, y) FMU_MATH(remainder)(x, y)
#define remquo(x, y, quotient) FMU_MATH(remquo)(x, y, quotient)
#define scalbn(x, n) FMU_MATH(scalbn)(x, n)
#define sin(x) FMU_MATH(sin)(x)
#define sinh(x) FMU_MATH(sinh)(x)
#define tan(x) FMU_MATH(tan)(x)
#define tanh(x) FMU_MATH(tanh)(x)

FMU_FUNCTION double fmu_acos(double x);
FMU_FUNCTION double fmu_acosh(double x);
FMU_FUNCTION double fmu_asin(double x);
FMU_FUNCTION double fmu_asinh(double x);
FMU_FUNCTION double fmu_atan(double x);
FMU_FUNCTION double fmu_atan2(double y, double x);
FMU_FUNCTION double fmu_atanh(double x);
FMU_FUNCTION double fmu_ceil(double x);
FMU_FUNCTION double fmu_cos(double x);
FMU_FUNCTION double fmu_cosh(double x);
FMU_FUNCTION double fmu_erf(double x);
FMU_FUNCTION double fmu_erfc(double x);
FMU_FUNCTION double fmu_exp(double x);
FMU_FUNCTION double fmu_expm1(double x);
FMU_FUNCTION double fmu_floor(double x);
FMU_FUNCTION double fmu_fmod(double x, double y);
FMU_FUNCTION double fmu_hypot(double x, double y);
FMU_FUNCTION double fmu_log(double x);
FMU_FUNCTION double fmu_log1p(double x);
FMU_FUNCTION double fmu_pow(double x, double y);
FMU_FUNCTION double fmu_remainder(double x, double y);
FMU_HIDDEN double fmu_remquo(double x, double y, int *quotient);
FMU_FUNCTION double fmu_scalbn(double x, int n);
FMU_FUNCTION double fmu_sin(double x);
FMU_FUNCTION double fmu_sinh(double x);
FMU_FUNCTION double fmu_tan(double x);
FMU_FUNCTION double fmu_tanh(double x);

/* The larger one; +0 is larger than -0, and a NaN counts for nothing. Inlined: some components have thousands of calls.
 */
static inline double fmu_fmax(double x, double y) {
    if (FMU_IS_CONSTANT(x) && x == x && !(x == 0.0 && signbit(x))) return y > x ? y : x; /* one instruction */
    if (x > y) return x;
    if (x < y) return y;
    if (x == y) return signbit(x) ? y : x;
    return x == x ? x : y;
}

static inline double fmu_fmin(double x, double y) {
    if (FMU_IS_CONSTANT(x) && x == x && !(x == 0.0 && !signbit(x))) return y < x ? y : x;
    if (x < y) return x;
    if (x > y) return y;
    if (x == y) return signbit(x) ? x : y;
    return x == x ? x : y;
}

#endif
