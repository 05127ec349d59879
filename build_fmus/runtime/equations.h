/* What generated equations are written with, beside the operators of C and the functions of fmu_math.h. */
#ifndef EQUATIONS_H
#define EQUATIONS_H

/* Generated code computes no value twice: a compiler that looks for partial redundancies takes a quarter longer and
 * finds none. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-tree-pre", "no-code-hoisting")
#endif

#include "fmu_math.h"

/* A function that is called once in a run. Optimized it takes GCC as long to compile as all the others together. Clang
 * would fuse multiplications and additions in it (optnone, on ARM), which changes bits. */
#if defined(__GNUC__) && !defined(__clang__)
#define CALLED_ONCE __attribute__((optimize("O0")))
#else
#define CALLED_ONCE
#endif

static inline double square(double x) { return x * x; }

/* x where it is 0 or NaN */
static inline double sign(double x) { return x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x; }

/* a where the condition holds, else 0 */
static inline double when(int holds, double a) { return holds ? a : 0.0; }

/* a where the condition holds, else b; a -0 becomes 0, as in the sum of both values that it stands for */
static inline double if_else(int holds, double a, double b) { return (holds ? a : b) + 0.0; }

/* The index that a number means; one that is no index of any array for NaN and numbers beyond all integers, which C
 * leaves undefined. */
static inline int index_of(double x) { return x >= -1.0 && x <= 2147483646.0 ? (int)x : x > 0.0 ? 2147483646 : -1; }

/* Element of an array of n, NaN where there is none. */
static inline double look_up(const double *array, int n, double index) {
    const int i = index_of(index);
    return i >= 0 && i < n ? array[i] : NAN;
}

/* Set an element of an array of n; nothing where there is none. */
static inline void store(double *array, int n, double index, double value) {
    const int i = index_of(index);
    if (i >= 0 && i < n) array[i] = value;
}

static inline double smallest(const double *array, int n) {
    double least = INFINITY;
    for (int i = 0; i < n; i++) least = fmin(least, array[i]);
    return least;
}

static inline double largest(const double *array, int n) {
    double most = -INFINITY;
    for (int i = 0; i < n; i++) most = fmax(most, array[i]);
    return most;
}

/* z += x y: matrices column by column, z rows x columns, x rows x inner, y inner x columns. */
static inline void add_product(double *z, const double *x, const double *y, int rows, int inner, int columns) {
    for (int i = 0; i < columns; i++)
        for (int k = 0; k < inner; k++)
            for (int j = 0; j < rows; j++) z[j + i * rows] += x[j + k * rows] * y[k + i * inner];
}

/* z = x y */
static inline void product(double *z, const double *x, const double *y, int rows, int inner, int columns) {
    for (int i = 0; i < rows * columns; i++) z[i] = 0.0;
    add_product(z, x, y, rows, inner, columns);
}

/* x = inv(a) b: matrices column by column, a n x n, b and x n x columns; elimination with row exchanges in `lu`, n x n.
 * Numbers that are not finite where a is singular. */
static inline void solve_linear(double *x, double *lu, const double *a, const double *b, int n, int columns) {
    for (int i = 0; i < n * n; i++) lu[i] = a[i];
    for (int i = 0; i < n * columns; i++) x[i] = b[i];
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(lu[i + k * n]) > fabs(lu[best + k * n])) best = i;
        for (int j = k; j < n + columns; j++) {
            double *const of = j < n ? lu + j * n : x + (j - n) * n;
            const double top = of[best];
            of[best] = of[k];
            of[k] = top;
            for (int i = k + 1; i < n; i++) {
                if (j == k) of[i] = of[i] / top;
                else of[i] -= lu[i + k * n] * top;
            }
        }
    }
    for (int j = 0; j < columns; j++)
        for (int k = n - 1; k >= 0; k--) {
            x[k + j * n] /= lu[k + k * n];
            for (int i = 0; i < k; i++) x[i + j * n] -= lu[i + k * n] * x[k + j * n];
        }
}

/* Types of equations, `real` (fmu_model.h) and `condition`, are vectors for copies side by side; for one copy: */
#ifndef LANES
typedef int condition;
#define all(x) (x)    /* a number, for all copies */
#define any(c) (c)    /* whether a condition holds in one of the copies */
#define number(c) ((double)(c)) /* 1 where the condition holds, else 0 */
#endif

#endif
