/* Fixed-step integrators of ordinary differential equations dx/dt = f(t, x): one step, in memory that the caller gives.
 * Over `real`: a number for one instance; several numbers side by side, or a number with its derivatives, where copies
 * include integrators.c after defining LANES. */
#ifndef INTEGRATORS_H
#define INTEGRATORS_H

#include <stddef.h>

#include "fmu_model.h"

typedef struct {
    FmuSolver method;
    int n;                                                                   /* states */
    void *system;                                                            /* whose right-hand side it is */
    void (*rhs)(void *system, double t, const real *x, real *dx);
    void (*jacobian)(void *system, double t, const real *x, real *J, real *by_time); /* ros2; J column-major */
    const double *nominals;                                                  /* ros2 */
    const int *velocity_of; /* semi_implicit: for each state the index of its derivative among the states, or -1 */
    real *stage, *k1, *k2, *k3, *k4;                                         /* n each */
    real *matrix, *by_time;                                                  /* ros2: n x n, n */
    int *pivots;                                                             /* ros2: n */
} Integrator;

#ifndef LANES
#define INTEGRATOR
/* Memory of the work arrays [bytes, a multiple of 16], and where it is given: 16-byte aligned. */
size_t integrator_memory(FmuSolver method, int n);
void integrator_use(Integrator *self, void *memory);
#else
#define INTEGRATOR INLINE
#endif

/* Advance x by h. `first`: inputs may have jumped since the step before. Returns n, or the state whose pivot is missing
 * (ros2; x is then as before). */
INTEGRATOR int integrator_step(const Integrator *self, double t, double h, int first, real *x);

#endif
