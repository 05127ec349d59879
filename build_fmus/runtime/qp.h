/* Quadratic programs: minimise 1/2 z'Hz + q'z subject to l <= Az <= u, with constant H and A, solved at each sample.
 * With terms, H is the constant one plus each term times its weight, which is data.
 *
 * qp.c checks data, keeps the warm start and judges the result; a back end (qp_daqp.c, qp_osqp.c) solves. What changes
 * from sample to sample lies in the caller's memory; scratch holds nothing that outlives a call of `solve`, except what
 * `setup` wrote there. */
#ifndef QP_H
#define QP_H

#include <stddef.h>

#define QP_INFINITY 1e30 /* bounds of this size and beyond do not bind */

typedef enum { QP_SOLVED, QP_LIMIT_REACHED, QP_INFEASIBLE, QP_BAD_DATA } QpStatus;

typedef struct {
    const double *hessian;     /* n x n, symmetric */
    const double *constraints; /* m x n, row by row */
    const void *factors;       /* what the back end needs beyond these two; NULL where H has terms */
} QpCase;

typedef struct Qp Qp;

typedef struct {
    size_t (*scratch_size)(const Qp *qp); /* bytes */
    void (*setup)(const Qp *qp, void *scratch); /* once, on zeroed scratch */
    /* z comes with the start value (memory of the last solution), y with zeros, or with multipliers of rows that are
     * active in a solution found elsewhere. On QP_SOLVED and QP_LIMIT_REACHED both are results, otherwise they may hold
     * anything. `memory` is the back end's warm start; all zeros is a cold one.
     * Finite bounds lie within +-QP_INFINITY, absent ones are +-QP_INFINITY, no lower bound exceeds its upper one. */
    QpStatus (*solve)(const Qp *qp, const QpCase *data, void *scratch, double *memory, const double *q, const double *l,
                      const double *u, double *z, double *y, int *iterations);
    /* Whether `memory` may be used as a warm start; its numbers are finite. */
    int (*memory_ok)(const Qp *qp, const double *memory);
} QpBackend;

struct Qp {
    int n, m, n_cases;
    int n_memory; /* numbers that the back end keeps beside the n of the last solution */
    double tolerance; /* by which a lower bound may exceed its upper one; both become their mean */
    const QpCase *cases;
    const QpBackend *backend;
    const void *settings;
    const Qp *fallback; /* the same program for the solver that makes this one's solutions exact and takes over where it
                         * finds none; NULL for none */
    int n_terms;
    const double *terms; /* n_terms matrices n x n, symmetric */
};

/* Bytes and layout of scratch: the bounds as the back end gets them, the trial solution, then the back end's own. */
size_t qp_scratch_size(const Qp *qp);
void qp_setup(const Qp *qp, void *scratch);

/* Numbers of `data`. */
int qp_data_size(const Qp *qp);

/* Solve one program. `data` holds q, l, u, the case and the weights of terms; `solution` receives z, the multipliers,
 * status, iterations, residual. `memory` (n + n_memory numbers) carries the last solution and the warm start. */
void qp_solve(const Qp *qp, void *scratch, double *memory, const double *data, double *solution);

/* The case that a number means: the nearest one; the first for NaN. */
const QpCase *qp_case(const Qp *qp, double choice);

/* Whether `memory` can be what qp_solve left there. */
int qp_memory_ok(const Qp *qp, const double *memory);

size_t qp_aligned(size_t bytes);

extern const QpBackend qp_daqp, qp_osqp;

#endif
