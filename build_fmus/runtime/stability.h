/* Whether the fixed step of a solver suits the linear dynamics dx/dt = A x at named points: the criterion of the build
 * (build_fmus/stability.py), for parameters that were set later. */
#ifndef STABILITY_H
#define STABILITY_H

#include <stddef.h>

#include "fmu_model.h"
#include "integrators.h"

typedef struct {
    FmuSolver method;
    int n;                  /* states */
    const int *velocity_of; /* semi_implicit: for each state the index of its derivative among the states, or -1 */
    int n_points;
    void *system;
    /* Write A (n x n, column-major) at a point. Returns 0 where the point is one that was looked at before. */
    int (*linearize)(void *system, int point, double *A);
    double *matrix, *scratch, *step_matrix; /* n x n; the last for semi_implicit */
    double *real, *imag;                    /* n each */
    Integrator solver;                      /* applied to linear dynamics */
} Stability;

typedef struct {
    int point;         /* where it is worst: the eigenvalue of largest modulus that the solver cannot follow */
    int found;         /* 0: the dynamics there are not finite, or their eigenvalues cannot be found */
    double real, imag; /* the eigenvalue [1/s] */
    double step;       /* the longest step that would do at all points; 0: none that is at least `shortest` */
} Instability;

/* Memory of the work arrays [bytes, a multiple of 16], and where it is given: 16-byte aligned. */
size_t stability_memory(FmuSolver method, int n);
void stability_use(Stability *self, void *memory);

/* Returns 1 when every point is stable with this step [s], else 0 and what is wrong. Longest step: of those that are
 * shorter by a power of 1.25. */
int stability_check(Stability *self, double step, double shortest, Instability *wrong);

/* Eigenvalues of the column-major n x n matrix a, which is destroyed. Returns 0 when a is not finite or there is no
 * convergence. */
int stability_eigenvalues(double *a, int n, double *real, double *imag);

#endif
