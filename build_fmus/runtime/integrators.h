/* Fixed-step integrators of ordinary differential equations dx/dt = f(t, x): one step, in memory that the caller gives.
 */
#ifndef INTEGRATORS_H
#define INTEGRATORS_H

#include <stddef.h>

#include "fmu_model.h"

typedef struct {
    FmuSolver method;
    int n;                                                                   /* states */
    void *system;                                                            /* whose right-hand side it is */
    void (*rhs)(void *system, double t, const double *x, double *dx);
    void (*jacobian)(void *system, double t, const double *x, double *J, double *by_time); /* ros2; J column-major */
    const double *nominals;                                                  /* ros2 */
    const int *velocity_of; /* semi_implicit: for each state the index of its derivative among the states, or -1 */
    double *stage, *k1, *k2, *k3, *k4;                                       /* n each */
    double *matrix, *by_time;                                                /* ros2: n x n, n */
    int *pivots;                                                             /* ros2: n */
} Integrator;

/* Memory of the work arrays [bytes, a multiple of 16], and where it is given: 16-byte aligned. */
size_t integrator_memory(FmuSolver method, int n);
void integrator_use(Integrator *self, void *memory);

/* Advance x by h. `first`: inputs may have jumped since the step before. Returns n, or the state whose pivot is missing
 * (ros2; x is then as before). */
int integrator_step(Integrator *self, double t, double h, int first, double *x);

#endif
