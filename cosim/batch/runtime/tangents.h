/* A number with its derivatives in TANGENTS directions, and what generated equations are written with (equations.h,
 * fmu_math.h) over it: the value in the operations of one number, so with its bits, the derivatives by the chain rule
 * for each operation. For one copy what lanes.h and lane_equations.h are for several; in C++, for its operators.
 *
 * Where a comparison decides (a branch, a limit, a sign, the piece of a table), the derivative is that of the side
 * taken. Comparisons of what depends on a direction are noted, so that two runs can be compared that should take the
 * same sides. */
#ifndef TANGENTS_H
#define TANGENTS_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stddef.h>
#include <string.h>
extern "C" {
#include "equations.h"
}
#include "vectors.h"

enum { PART = 8, PARTS = TANGENTS / PART };
typedef double Part __attribute__((vector_size(8 * PART)));

struct Tangent {
    double v; /* then as many unused numbers as alignment takes */
    Part d[PARTS];
    Tangent() = default;
    Tangent(double x) : v(x) {
        for (Part &part : d) part = Part{};
    }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
typedef Tangent lanes;
typedef Tangent real;
typedef double lanes_values;
typedef int mask;
typedef int condition;

#define EACH_PART(expression) \
    _Pragma("GCC unroll 8") for (int i = 0; i < PARTS; i++) expression

/* ------------------------------------------------------------------ sides */

/* The sides taken in this step by what depends on a direction; of the component that this library is of. */
static __thread uint64_t sides;

INLINE int depends(const Tangent &x) {
    Part any = {};
    EACH_PART(any += x.d[i] * x.d[i]); /* an underflow is no dependence that anybody could measure */
    double sum = 0.0;
    for (int i = 0; i < PART; i++) sum += any[i];
    return sum != 0.0;
}

NOINLINE void take_side(uint64_t side) { sides = (sides ^ (side + 1)) * 0x9e3779b97f4a7c15u ^ sides >> 29; }

/* All sides of a run so far, those of the last step, and in how many steps they were others than in the one before. */
typedef struct {
    uint64_t all, last, changes;
} Sides;

/* At first those that values which follow from the parameters alone have taken. */
INLINE void begin_sides(Sides *of) {
    of->all = of->last = sides;
    of->changes = 0;
}

INLINE void note_sides(Sides *of) {
    of->changes += of->last && sides != of->last;
    of->last = sides;
    take_side(of->all);
    of->all = sides;
}

NOINLINE int noted(const Tangent &by, int side) {
    if (depends(by)) take_side((uint64_t)(int64_t)side);
    return side;
}

/* ------------------------------------------------------------------ operators */

/* The chain rule. Where x does not move, its part is 0, also where the slope is infinite. */
INLINE Part scaled(double slope, const Part &d) {
    if (slope - slope == 0.0) return slope * d;
    Part r;
    for (int i = 0; i < PART; i++) r[i] = d[i] == 0.0 ? 0.0 : slope * d[i];
    return r;
}
INLINE Tangent chain(double value, double slope, const Tangent &x) {
    Tangent r;
    r.v = value;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]));
    return r;
}
INLINE Tangent chain(double value, double slope, const Tangent &x, double second, const Tangent &y) {
    Tangent r;
    r.v = value;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]) + scaled(second, y.d[i]));
    return r;
}

NOINLINE Tangent operator+(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v + y.v;
    EACH_PART(r.d[i] = x.d[i] + y.d[i]);
    return r;
}
NOINLINE Tangent operator-(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v - y.v;
    EACH_PART(r.d[i] = x.d[i] - y.d[i]);
    return r;
}
NOINLINE Tangent operator*(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v * y.v;
    EACH_PART(r.d[i] = y.v * x.d[i] + x.v * y.d[i]);
    return r;
}
NOINLINE Tangent operator/(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v / y.v;
    const double slope = 1.0 / y.v, by = -r.v * slope;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]) + scaled(by, y.d[i]));
    return r;
}
NOINLINE Tangent operator-(const Tangent &x) {
    Tangent r;
    r.v = -x.v;
    EACH_PART(r.d[i] = -x.d[i]);
    return r;
}
NOINLINE Tangent moved(double value, const Tangent &x) {
    Tangent r = x;
    r.v = value;
    return r;
}
NOINLINE Tangent operator+(const Tangent &x, double y) { return moved(x.v + y, x); }
NOINLINE Tangent operator+(double x, const Tangent &y) { return moved(x + y.v, y); }
NOINLINE Tangent operator-(const Tangent &x, double y) { return moved(x.v - y, x); }
NOINLINE Tangent operator-(double x, const Tangent &y) { return chain(x - y.v, -1.0, y); }
NOINLINE Tangent operator*(const Tangent &x, double y) { return chain(x.v * y, y, x); }
NOINLINE Tangent operator*(double x, const Tangent &y) { return chain(x * y.v, x, y); }
NOINLINE Tangent operator/(const Tangent &x, double y) { return chain(x.v / y, 1.0 / y, x); }
NOINLINE Tangent operator/(double x, const Tangent &y) { return chain(x / y.v, -(x / y.v) / y.v, y); }
INLINE Tangent &operator+=(Tangent &x, const Tangent &y) { return x = x + y; }
INLINE Tangent &operator*=(Tangent &x, const Tangent &y) { return x = x * y; }

#define COMPARED(operator_)                                                                                     \
    NOINLINE int operator operator_(const Tangent &x, const Tangent &y) { return noted(x - y, x.v operator_ y.v); } \
    NOINLINE int operator operator_(const Tangent &x, double y) { return noted(x, x.v operator_ y); }               \
    NOINLINE int operator operator_(double x, const Tangent &y) { return noted(y, x operator_ y.v); }
COMPARED(<)
COMPARED(<=)
COMPARED(>)
COMPARED(>=)

/* Numbers that are equal by chance, and move apart, are not equal: generated code takes a short way for equal ones. */
INLINE int equal(const Tangent &by, int are) { return noted(by, are && !depends(by)); }
NOINLINE int operator==(const Tangent &x, const Tangent &y) { return equal(x - y, x.v == y.v); }
NOINLINE int operator!=(const Tangent &x, const Tangent &y) { return !equal(x - y, x.v == y.v); }
NOINLINE int operator==(const Tangent &x, double y) { return noted(x, x.v == y); }
NOINLINE int operator!=(const Tangent &x, double y) { return noted(x, x.v != y); }
NOINLINE int operator==(double x, const Tangent &y) { return noted(y, x == y.v); }
NOINLINE int operator!=(double x, const Tangent &y) { return noted(y, x != y.v); }

/* ------------------------------------------------------------------ what lanes have, for one copy */

INLINE lanes lanes_all(double x) { return Tangent(x); }
INLINE unsigned lanes_bits(mask m) { return (unsigned)m & 1u; }
INLINE double lanes_value(const lanes &x) { return x.v; }
INLINE double lanes_size(const lanes &x) { return fabs(x.v); }

/* Whether a number is not the same, beyond rounding and at all. */
INLINE mask lanes_moved(const lanes &was, const lanes &now) {
    const double *const a = (const double *)was.d, *const b = (const double *)now.d;
    int r = fabs(now.v - was.v) > 1e-12 * fmax(fabs(was.v), 1.0);
    for (int i = 0; i < TANGENTS; i++) r |= fabs(b[i] - a[i]) > 1e-12 * fmax(fabs(a[i]), 1.0);
    return r;
}
INLINE mask lanes_changed(const lanes &was, const lanes &now) { return memcmp(&was, &now, sizeof was) != 0; }

/* ------------------------------------------------------------------ what equations are written with */

NOINLINE double fmu_side(const Tangent &x, const Tangent &y) { return noted(x - y, (x.v > y.v) - (x.v < y.v)); }

NOINLINE Tangent tangent_square(const Tangent &x) { return chain(x.v * x.v, 2.0 * x.v, x); }
NOINLINE Tangent tangent_sign(const Tangent &x) {
    noted(x, (x.v > 0.0) - (x.v < 0.0));
    return Tangent(sign(x.v));
}
NOINLINE Tangent tangent_when(int holds, const Tangent &a) { return holds ? a : Tangent(0.0); }
NOINLINE Tangent tangent_if_else(int holds, const Tangent &a, const Tangent &b) { return (holds ? a : b) + 0.0; }
NOINLINE Tangent tangent_fabs(const Tangent &x) {
    const int side = noted(x, (x.v > 0.0) - (x.v < 0.0));
    return chain(fabs(x.v), side, x);
}
NOINLINE Tangent tangent_copysign(const Tangent &x, const Tangent &y) {
    const double r = copysign(x.v, y.v);
    noted(x, x.v < 0.0);
    noted(y, signbit(y.v) != 0);
    return chain(r, signbit(r) == signbit(x.v) ? 1.0 : -1.0, x);
}
NOINLINE Tangent tangent_fmax(const Tangent &x, const Tangent &y) {
    const double r = fmu_fmax(x.v, y.v);
    return moved(r, fmu_side(x, y) < 0.0 || x.v != x.v ? y : x);
}
NOINLINE Tangent tangent_fmin(const Tangent &x, const Tangent &y) {
    const double r = fmu_fmin(x.v, y.v);
    return moved(r, fmu_side(x, y) > 0.0 || x.v != x.v ? y : x);
}
NOINLINE Tangent tangent_floor(const Tangent &x) {
    const double r = fmu_floor(x.v);
    noted(x, index_of(r));
    return Tangent(r);
}
NOINLINE Tangent tangent_ceil(const Tangent &x) {
    const double r = fmu_ceil(x.v);
    noted(x, index_of(r));
    return Tangent(r);
}

#define OF_ONE(name, slope)                                  \
    NOINLINE Tangent tangent_##name(const Tangent &x) {      \
        const double v = x.v, r = fmu_##name(v);             \
        (void)v;                                             \
        return depends(x) ? chain(r, slope, x) : Tangent(r); \
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

NOINLINE Tangent tangent_atan2(const Tangent &y, const Tangent &x) {
    const double square_of_both = x.v * x.v + y.v * y.v;
    return chain(fmu_atan2(y.v, x.v), x.v / square_of_both, y, -y.v / square_of_both, x);
}
NOINLINE Tangent tangent_hypot(const Tangent &x, const Tangent &y) {
    const double r = fmu_hypot(x.v, y.v);
    return chain(r, x.v / r, x, y.v / r, y);
}
NOINLINE Tangent tangent_pow(const Tangent &x, const Tangent &y) {
    const double r = fmu_pow(x.v, y.v);
    return chain(r, y.v * fmu_pow(x.v, y.v - 1.0), x, depends(y) ? r * fmu_log(x.v) : 0.0, y);
}
#define OF_TURNS(name)                                                     \
    NOINLINE Tangent tangent_##name(const Tangent &x, const Tangent &y) {  \
        const double r = fmu_##name(x.v, y.v), turns = (x.v - r) / y.v;    \
        noted(x, index_of(fabs(turns)));                                   \
        return chain(r, 1.0, x, -turns, y);                                \
    }
OF_TURNS(fmod)
OF_TURNS(remainder)

NOINLINE Tangent tangent_look_up(const double *array, int n, const Tangent &index) {
    noted(index, index_of(index.v));
    return Tangent(look_up(array, n, index.v));
}
NOINLINE Tangent tangent_look_up(const Tangent *array, int n, const Tangent &index) {
    const int i = noted(index, index_of(index.v));
    return i >= 0 && i < n ? array[i] : Tangent(NAN);
}
NOINLINE void tangent_store(Tangent *array, int n, const Tangent &index, const Tangent &value) {
    const int i = noted(index, index_of(index.v));
    if (i >= 0 && i < n) array[i] = value;
}
NOINLINE Tangent tangent_smallest(const Tangent *array, int n) {
    Tangent least(INFINITY);
    for (int i = 0; i < n; i++) least = tangent_fmin(least, array[i]);
    return least;
}
NOINLINE Tangent tangent_largest(const Tangent *array, int n) {
    Tangent most(-INFINITY);
    for (int i = 0; i < n; i++) most = tangent_fmax(most, array[i]);
    return most;
}
template <class X, class Y>
static inline void tangent_add_product(Tangent *z, const X *x, const Y *y, int rows, int inner, int columns) {
    for (int i = 0; i < columns; i++)
        for (int k = 0; k < inner; k++)
            for (int j = 0; j < rows; j++) z[j + i * rows] += x[j + k * rows] * y[k + i * inner];
}
template <class X, class Y>
static inline void tangent_product(Tangent *z, const X *x, const Y *y, int rows, int inner, int columns) {
    for (int i = 0; i < rows * columns; i++) z[i] = Tangent(0.0);
    tangent_add_product(z, x, y, rows, inner, columns);
}

#endif
