/* Numbers with derivatives, and what generated equations are written with (equations.h, fmu_math.h) over them: the
 * value in the operations of one number, so with its bits, the derivatives by the chain rule for each operation. For
 * one copy what lanes.h and lane_equations.h are for several; in C++, for its operators.
 *
 * The operators come from expressions.h, the type from tangents.h or adjoints.h, with
 *     moved(value, x)  a number that moves as x does;
 *     chain(value, n, slopes, of)  one that depends on n others;
 *     depends(x), depends(x, y)   whether x depends on a direction; whether x and y move apart;
 *     meet(x, y, within)          whether a short way along a direction makes these equal;
 *     note_moves(x, n)            where derivatives were written from elsewhere;
 *     lanes_moved, lanes_changed  whether a number is not the same, beyond rounding and at all.
 *
 * Where a comparison decides (a branch, a limit, a sign, the piece of a table), the derivative is that of the side
 * taken. Comparisons of what depends on a direction are noted, so that two runs can be compared that should take the
 * same sides; so are ties. */
#ifndef NUMBERS_H
#define NUMBERS_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stddef.h>
#include <string.h>
#include "vectors.h" /* before all code: calls of code for other processors wait for their vector registers */
extern "C" {
#include "batch.h"
#include "equations.h"
}

#ifdef ADJOINTS
#include "adjoints.h"
#else
#include "tangents.h"
#endif

/* A number that depends on x, and on y. */
INLINE Number chain(double value, double slope, const Number &x) { return OfOne<Number>(value, slope, x); }
INLINE Number chain(double value, double slope, const Number &x, double second, const Number &y) {
    return OfTwo<Number, Number>(value, slope, x, second, y);
}
/* An operand of a statement, by what follows from it; it lives as long as the statement. */
typedef OfOne<Number> Operand;
static Number nothing; /* 0, which does not move */
template <class E, IS_EXPRESSION(E)> MEMBER Number &operator+=(Number &x, const E &e) { return x = x + e; }
template <class E, IS_EXPRESSION(E)> MEMBER Number &operator*=(Number &x, const E &e) { return x = x * e; }

/* A number that is no element of an array has a name: a statement that reads it twice has it as one operand. */
template <int NAME> struct Scalar : Number {
    typedef Names<NAME> Read;
    Scalar() = default;
    MEMBER Scalar(double x) : Number(x) {}
    template <class E, IS_EXPRESSION(E)> MEMBER Scalar(const E &e) : Number(e) {}
    template <class E, IS_EXPRESSION(E)> MEMBER Scalar &operator=(const E &e) {
        Number::operator=(e);
        return *this;
    }
};

#define HAS_SIDES 1
typedef Number lanes;
typedef Number real;
typedef double lanes_values;
typedef int mask;
typedef int condition;

/* ------------------------------------------------------------------ sides */

/* The sides taken in this step by what depends on a direction, and whether there was a tie: a move of TIE along a
 * direction changes a side, so that the derivative is that of one side only. Directions are as long as the parameters
 * are large (gradient.py). Of the component that this library is of; together, so that they are looked up once. */
struct Taken {
    uint64_t sides;
    int tied;
};
static __thread Taken taken;
#define TIE 1e-8

INLINE void add_side(uint64_t *to, uint64_t side) {
    *to = (*to ^ (side + 1)) * 0x9e3779b97f4a7c15u ^ *to >> 29;
}
NOINLINE void take_side(uint64_t side) { add_side(&taken.sides, side); }

/* At first those that values which follow from the parameters alone have taken. */
INLINE void begin_sides(Sides *of) {
    of->all = of->last = taken.sides;
    of->changes = of->first = of->ties = of->plain = 0;
}

INLINE void note_tie(Sides *of, double t) {
    if (taken.tied && !of->ties++) of->tie = t;
}

INLINE void note_sides(Sides *of, double t) {
    note_tie(of, t);
    if (!of->all) of->first = taken.sides;
    of->changes += of->last && taken.sides != of->last;
    of->last = taken.sides;
    take_side(of->all);
    of->all = taken.sides;
}

INLINE int noted(int moving, int side) {
    if (moving) take_side((uint64_t)(int64_t)side);
    return side;
}
/* The side of a comparison of x and y. */
INLINE int compared(const Number &x, const Number &y, int side) {
    if (!depends(x, y)) return side;
    Taken *now = &taken;
    __asm__("" : "+r"(now)); /* looked up once */
    if (!now->tied) now->tied = meet(x, y, TIE);
    add_side(&now->sides, (uint64_t)(int64_t)side);
    return side;
}

/* ------------------------------------------------------------------ comparisons */

#define COMPARED(is)                                                                                             \
    OPERATION int operator is(const Number &x, const Number &y) { return compared(x, y, x.v is y.v); }           \
    OPERATION int operator is(const Number &x, double y) { return depends(x) ? x is Number(y) : x.v is y; }      \
    OPERATION int operator is(double x, const Number &y) { return depends(y) ? Number(x) is y : x is y.v; }
COMPARED(<)
COMPARED(<=)
COMPARED(>)
COMPARED(>=)

/* Numbers that are equal by chance, and move apart, are not equal: generated code takes a short way for equal ones. */
INLINE int equal(int apart, int are) { return noted(apart, are && !apart); }
OPERATION int operator==(const Number &x, const Number &y) { return equal(depends(x, y), x.v == y.v); }
OPERATION int operator!=(const Number &x, const Number &y) { return !equal(depends(x, y), x.v == y.v); }
OPERATION int operator==(const Number &x, double y) { return noted(depends(x), x.v == y); }
OPERATION int operator!=(const Number &x, double y) { return noted(depends(x), x.v != y); }
OPERATION int operator==(double x, const Number &y) { return noted(depends(y), x == y.v); }
OPERATION int operator!=(double x, const Number &y) { return noted(depends(y), x != y.v); }

/* ------------------------------------------------------------------ what lanes have, for one copy */

INLINE lanes lanes_all(double x) { return Number(x); }
INLINE unsigned lanes_bits(mask m) { return (unsigned)m & 1u; }
INLINE double lanes_value(const lanes &x) { return x.v; }
INLINE double lanes_size(const lanes &x) { return fabs(x.v); }

/* ------------------------------------------------------------------ what equations are written with */

OPERATION double fmu_side(const Number &x, const Number &y) {
    return compared(x, y, (x.v > y.v) - (x.v < y.v));
}

INLINE double number_square(double x) { return square(x); }
template <class X, IS_EXPRESSION(X)> MEMBER OfOne<X> number_square(const X &x) {
    return OfOne<X>(x.v * x.v, 2.0 * x.v, x);
}
OPERATION Number number_sign(const Number &x) {
    fmu_side(x, nothing);
    return Number(sign(x.v));
}
INLINE Operand number_if_else(int holds, const Number &a, const Number &b) {
    const Number &x = holds ? a : b;
    return Operand(x.v + 0.0, 1.0, x);
}
INLINE const Number &number_when(int holds, const Number &a) { return holds ? a : nothing; }
OPERATION Operand number_fabs(const Number &x) {
    return Operand(fabs(x.v), fmu_side(x, nothing), x);
}
OPERATION Operand number_copysign(const Number &x, const Number &y) {
    const double r = copysign(x.v, y.v);
    noted(depends(x), x.v < 0.0);
    noted(depends(y), signbit(y.v) != 0);
    return Operand(r, signbit(r) == signbit(x.v) ? 1.0 : -1.0, x);
}
/* One of both, as fmu_fmax and fmu_fmin choose: of zeros the one with the sign. Tables and limits call these two often,
 * which would take minutes to compile in place. */
NOINLINE const Number &number_fmax(const Number &x, const Number &y) {
    return fmu_side(x, y) < 0.0 || x.v != x.v || (x.v == y.v && signbit(x.v) > signbit(y.v)) ? y : x;
}
NOINLINE const Number &number_fmin(const Number &x, const Number &y) {
    return fmu_side(x, y) > 0.0 || x.v != x.v || (x.v == y.v && signbit(x.v) < signbit(y.v)) ? y : x;
}
OPERATION Number number_floor(const Number &x) {
    const double r = fmu_floor(x.v);
    compared(x, Number(fmu_floor(x.v + 0.5)), index_of(r));
    return Number(r);
}
OPERATION Number number_ceil(const Number &x) {
    const double r = fmu_ceil(x.v);
    compared(x, Number(fmu_floor(x.v + 0.5)), index_of(r));
    return Number(r);
}

/* Before a call of code that is compiled for every processor, which would wait for the vector registers otherwise. */
#if LANES_TARGET
#define LEAVE_VECTORS() _mm256_zeroupper()
#else
#define LEAVE_VECTORS() (void)0
#endif

/* An expression as the argument is a number of its own: a slope that is infinite, or 0, multiplies no slopes inside. */
#define OF_ONE(name, derivative)                                                             \
    OPERATION Operand number_##name(const Number &x) {                                       \
        LEAVE_VECTORS();                                                                     \
        const double v = x.v, r = fmu_##name(v);                                             \
        (void)v;                                                                             \
        if (!depends(x)) return Operand(r, 0.0, nothing);                                    \
        return Operand(r, derivative, x);                                                    \
    }                                                                                        \
    template <int NAME> MEMBER OfOne<Scalar<NAME>> number_##name(const Scalar<NAME> &x) {    \
        const Operand r = number_##name(static_cast<const Number &>(x));                     \
        return OfOne<Scalar<NAME>>(r.v, r.slope, x);                                         \
    }
INLINE double fmu_sqrt(double x) { return sqrt(x); }
OF_ONE(sqrt, 0.5 / r)
OF_ONE(acos, -1.0 / sqrt(1.0 - v * v))
OF_ONE(acosh, 1.0 / sqrt(v * v - 1.0))
OF_ONE(asin, 1.0 / sqrt(1.0 - v * v))
OF_ONE(asinh, 1.0 / sqrt(v * v + 1.0))
OF_ONE(atan, 1.0 / (1.0 + v * v))
OF_ONE(atanh, 1.0 / (1.0 - v * v))
OF_ONE(cos, -fmu_sin(v))
OF_ONE(cosh, fmu_sinh(v))
OF_ONE(erf, 1.1283791670955126 * fmu_exp(-v * v)) /* 2 / sqrt(pi) */
OF_ONE(erfc, -1.1283791670955126 * fmu_exp(-v * v))
OF_ONE(exp, r)
OF_ONE(expm1, r + 1.0)
OF_ONE(log, 1.0 / v)
OF_ONE(log1p, 1.0 / (1.0 + v))
OF_ONE(sin, fmu_cos(v))
OF_ONE(sinh, fmu_cosh(v))
OF_ONE(tan, 1.0 + r * r)
OF_ONE(tanh, 1.0 - r * r)

OPERATION Number number_atan2(const Number &y, const Number &x) {
    const double square_of_both = x.v * x.v + y.v * y.v;
    return chain(fmu_atan2(y.v, x.v), x.v / square_of_both, y, -y.v / square_of_both, x);
}
OPERATION Number number_hypot(const Number &x, const Number &y) {
    const double r = fmu_hypot(x.v, y.v);
    return chain(r, x.v / r, x, y.v / r, y);
}
OPERATION Number number_pow(const Number &x, const Number &y) {
    const double r = fmu_pow(x.v, y.v);
    return chain(r, y.v * fmu_pow(x.v, y.v - 1.0), x, depends(y) ? r * fmu_log(x.v) : 0.0, y);
}
#define OF_TURNS(name)                                                  \
    OPERATION Number number_##name(const Number &x, const Number &y) {  \
        const double r = fmu_##name(x.v, y.v), turns = (x.v - r) / y.v; \
        noted(depends(x), index_of(fabs(turns)));                       \
        return chain(r, 1.0, x, -turns, y);                             \
    }
OF_TURNS(fmod)
OF_TURNS(remainder)

OPERATION Number number_look_up(const double *array, int n, const Number &index) {
    noted(depends(index), index_of(index.v));
    return Number(look_up(array, n, index.v));
}
OPERATION Number number_look_up(const Number *array, int n, const Number &index) {
    const int i = noted(depends(index), index_of(index.v));
    return i >= 0 && i < n ? array[i] : Number(NAN);
}
OPERATION void number_store(Number *array, int n, const Number &index, const Number &value) {
    const int i = noted(depends(index), index_of(index.v));
    if (i >= 0 && i < n) array[i] = value;
}
OPERATION Number number_smallest(const Number *array, int n) {
    Number least(INFINITY);
    for (int i = 0; i < n; i++) least = number_fmin(least, array[i]);
    return least;
}
OPERATION Number number_largest(const Number *array, int n) {
    Number most(-INFINITY);
    for (int i = 0; i < n; i++) most = number_fmax(most, array[i]);
    return most;
}
template <class X, class Y>
static inline void number_add_product(Number *z, const X *x, const Y *y, int rows, int inner, int columns) {
    for (int i = 0; i < columns; i++)
        for (int k = 0; k < inner; k++)
            for (int j = 0; j < rows; j++) z[j + i * rows] += x[j + k * rows] * y[k + i * inner];
}
template <class X, class Y>
static inline void number_product(Number *z, const X *x, const Y *y, int rows, int inner, int columns) {
    for (int i = 0; i < rows * columns; i++) z[i] = Number(0.0);
    number_add_product(z, x, y, rows, inner, columns);
}

/* Derivatives of x = inv(a) b: inv(a) (db - da x). */
INLINE double plain(double x) { return x; }
INLINE double plain(const Number &x) { return x.v; }
INLINE const Number *moving(const double *, Number *none) { return none; }
INLINE const Number *moving(const Number *x, Number *) { return x; }
template <class A, class B>
NOINLINE void number_solve_linear(Number *x, Number *lu, const A *a, const B *b, int n, int columns) {
    const int square = n * n, size = n * columns;
    double *const found = (double *)__builtin_alloca(sizeof(double) * (size_t)(4 * square + 2 * size + n + 1));
    double *const right = found + size, *const left = right + size, *const inverse = left + square;
    double *const one = inverse + square, *const work = one + square, *const slopes = work + square;
    const Number **const of = (const Number **)__builtin_alloca(sizeof(Number *) * (size_t)(n + 1));
    for (int i = 0; i < square; i++) left[i] = plain(a[i]), one[i] = i % (n + 1) == 0;
    for (int i = 0; i < size; i++) right[i] = plain(b[i]);
    solve_linear(found, work, left, right, n, columns);
    solve_linear(inverse, work, left, one, n, n);
    Number none(0.0);
    for (int j = 0; j < columns; j++) {
        for (int i = 0; i < n; i++) {
            slopes[n] = 1.0;
            of[n] = moving(&b[i + j * n], &none);
            for (int k = 0; k < n; k++) {
                slopes[k] = -found[k + j * n];
                of[k] = moving(&a[i + k * n], &none);
            }
            lu[i] = chain(0.0, n + 1, slopes, of);
        }
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < n; k++) {
                slopes[k] = inverse[i + k * n];
                of[k] = &lu[k];
            }
            x[i + j * n] = chain(found[i + j * n], n, slopes, of);
        }
    }
}

#endif
