/* Fixed-step integrators of ordinary differential equations. */

#include "integrators.h"

#include <float.h>
#include <string.h>

#include "fmu_math.h"

#ifndef LANES
#define STEP static
#define magnitude(x) fabs(x)

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }

static size_t matrix_side(FmuSolver method, int n) { return method == FMU_ROS2 ? (size_t)n : 0; }

size_t integrator_memory(FmuSolver method, int n) {
    const size_t side = matrix_side(method, n);
    return aligned((5 * (size_t)n + (side + 1) * side) * sizeof(double)) + aligned(side * sizeof(int));
}

void integrator_use(Integrator *self, void *memory) {
    const size_t n = (size_t)self->n, side = matrix_side(self->method, self->n);
    double *at = memory;
    self->stage = at;
    self->k1 = at + n;
    self->k2 = at + 2 * n;
    self->k3 = at + 3 * n;
    self->k4 = at + 4 * n;
    self->matrix = at + 5 * n;
    self->by_time = self->matrix + side * side;
    self->pivots = (void *)((char *)memory + aligned((5 * n + (side + 1) * side) * sizeof(double)));
}
#else
#define STEP INLINE
#define magnitude(x) lanes_size(x)
#endif

/* Classic fourth-order Runge-Kutta. */
STEP void step_rk4(const Integrator *self, double t, double h, real *x) {
    const int n = self->n;
    real *s = self->stage, *k1 = self->k1, *k2 = self->k2, *k3 = self->k3, *k4 = self->k4;
    self->rhs(self->system, t, x, k1);
    for (int i = 0; i < n; i++) s[i] = x[i] + 0.5 * h * k1[i];
    self->rhs(self->system, t + 0.5 * h, s, k2);
    for (int i = 0; i < n; i++) s[i] = x[i] + 0.5 * h * k2[i];
    self->rhs(self->system, t + 0.5 * h, s, k3);
    for (int i = 0; i < n; i++) s[i] = x[i] + h * k3[i];
    self->rhs(self->system, t + h, s, k4);
    for (int i = 0; i < n; i++) x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

/* Adams-Bashforth-2 predictor, Adams-Moulton-2 (trapezoidal) corrector. k2 holds the derivative of the previous step;
 * the first step after an exchange predicts with Euler, because inputs may have jumped there. */
STEP void step_am2(const Integrator *self, double t, double h, int first, real *x) {
    const int n = self->n;
    real *s = self->stage, *now = self->k1, *before = self->k2, *ahead = self->k3;
    self->rhs(self->system, t, x, now);
    if (first) /* in loops of their own: each state is one statement where numbers have derivatives */
        for (int i = 0; i < n; i++) s[i] = x[i] + h * now[i];
    else
        for (int i = 0; i < n; i++) s[i] = x[i] + h * (1.5 * now[i] - 0.5 * before[i]);
    self->rhs(self->system, t + h, s, ahead);
    for (int i = 0; i < n; i++) x[i] += 0.5 * h * (now[i] + ahead[i]);
    memcpy(before, now, (size_t)n * sizeof *now);
}

/* Stoermer-Verlet (drift, kick, drift): positions move half a step with the old velocities, everything else a whole
 * step by the explicit midpoint rule at these positions, then positions the other half with the new velocities. Order
 * 2; an undamped vibration keeps its energy where explicit methods feed it. */
STEP void step_semi_implicit(const Integrator *self, double t, double h, real *x) {
    const int n = self->n, *v = self->velocity_of;
    real *s = self->stage, *k1 = self->k1, *k2 = self->k2;
    for (int i = 0; i < n; i++) {
        if (v[i] >= 0) x[i] += 0.5 * h * x[v[i]];
    }
    self->rhs(self->system, t + 0.5 * h, x, k1);
    for (int i = 0; i < n; i++) s[i] = v[i] >= 0 ? x[i] : x[i] + 0.5 * h * k1[i];
    self->rhs(self->system, t + 0.5 * h, s, k2);
    for (int i = 0; i < n; i++)
        if (v[i] < 0) x[i] += h * k2[i];
    for (int i = 0; i < n; i++)
        if (v[i] >= 0) x[i] += 0.5 * h * x[v[i]];
}

#if !defined(LANES) || LANES == 1 /* copies side by side would choose pivots, each its own */
/* Replace the column-major n x n matrix a by its LU factors with row exchanges. `scale` holds for each column the size
 * that its elements had before they were added up: a pivot that is only rounding of it counts as zero. Returns the
 * column without a pivot, or n. */
static int factorize(real *a, int n, const real *scale, int *pivots) {
    for (int k = 0; k < n; k++) {
        real *ak = a + (size_t)k * (size_t)n;
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (magnitude(ak[i]) > magnitude(ak[best])) best = i;
        pivots[k] = best;
        if (!(magnitude(ak[best]) > 8.0 * DBL_EPSILON * magnitude(scale[k])) || isinf(magnitude(ak[best]))) return k;
        const real pivot = ak[best];
        ak[best] = ak[k];
        ak[k] = pivot;
        for (int i = k + 1; i < n; i++) ak[i] = ak[i] / pivot;
        for (int j = k + 1; j < n; j++) {
            real *aj = a + (size_t)j * (size_t)n;
            const real top = aj[best];
            aj[best] = aj[k];
            aj[k] = top;
            for (int i = k + 1; i < n; i++) aj[i] = aj[i] - ak[i] * top;
        }
    }
    return n;
}

/* Solve with the factors of factorize(): b becomes the solution. */
static void solve(const real *a, int n, const int *pivots, real *b) {
    for (int k = 0; k < n; k++) {
        const real top = b[pivots[k]];
        b[pivots[k]] = b[k];
        b[k] = top;
        for (int i = k + 1; i < n; i++) b[i] = b[i] - a[(size_t)k * (size_t)n + (size_t)i] * top;
    }
    for (int k = n - 1; k >= 0; k--) {
        b[k] = b[k] / a[(size_t)k * (size_t)n + (size_t)k];
        for (int i = 0; i < k; i++) b[i] = b[i] - a[(size_t)k * (size_t)n + (size_t)i] * b[k];
    }
}

/* ROS2, a linearly implicit method of order 2 (Verwer, Spee, Blom, Hundsdorfer 1999), L-stable with this gamma:
 *     (I - gamma h J) k1 = f(t, x) + gamma h df/dt
 *     (I - gamma h J) k2 = f(t + h, x + h k1) - 2 k1 - gamma h df/dt
 *     x += h (3 k1 + k2) / 2
 * States count in units of their nominal values, so that pivots do not depend on the choice of units. */
STEP int step_ros2(const Integrator *self, double t, double h, real *x) {
    const double gh = 0.29289321881345254 * h; /* gamma = 1 - 1/sqrt(2) */
    const int n = self->n;
    real *s = self->stage, *k1 = self->k1, *k2 = self->k2, *scale = self->k3;
    const double *nominal = self->nominals;
    self->jacobian(self->system, t, x, self->matrix, self->by_time);
    for (int j = 0; j < n; j++) {
        double most = 1.0;
        for (int i = 0; i < n; i++) {
            real *a = self->matrix + (size_t)j * (size_t)n + (size_t)i;
            *a = *a * (-gh * (nominal[j] / nominal[i]));
            most = most > magnitude(*a) ? most : magnitude(*a);
            if (i == j) *a = *a + 1.0;
        }
        scale[j] = most;
    }
    const int column = factorize(self->matrix, n, scale, self->pivots);
    if (column < n) return column;
    self->rhs(self->system, t, x, k1);
    for (int i = 0; i < n; i++) k1[i] = (k1[i] + gh * self->by_time[i]) / nominal[i];
    solve(self->matrix, n, self->pivots, k1);
    for (int i = 0; i < n; i++) s[i] = x[i] + h * nominal[i] * k1[i];
    self->rhs(self->system, t + h, s, k2);
    for (int i = 0; i < n; i++) k2[i] = (k2[i] - gh * self->by_time[i]) / nominal[i] - 2.0 * k1[i];
    solve(self->matrix, n, self->pivots, k2);
    for (int i = 0; i < n; i++) x[i] += 0.5 * h * nominal[i] * (3.0 * k1[i] + k2[i]);
    return n;
}
#else
STEP int step_ros2(const Integrator *self, double t, double h, real *x) { return (void)t, (void)h, (void)x, self->n; }
#endif

INTEGRATOR int integrator_step(const Integrator *self, double t, double h, int first, real *x) {
    switch (self->method) {
        case FMU_ROS2: return step_ros2(self, t, h, x);
        case FMU_SEMI_IMPLICIT: step_semi_implicit(self, t, h, x); break;
        case FMU_AM2: step_am2(self, t, h, first, x); break;
        case FMU_RK4: step_rk4(self, t, h, x); break;
    }
    return self->n;
}
