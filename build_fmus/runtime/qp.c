/* What does not depend on the back end: data checks, warm start, residual; and the list of programs of a component. */

#include "qp.h"

#include <string.h>

#include "fmu_math.h"
#include "fmu_model.h"
#include "qp_model.h"

#define NO_RESIDUAL 1e30 /* reported where there is none: bad data */

size_t qp_aligned(size_t bytes) { return (bytes + 15u) & ~(size_t)15u; }

static double *own_part(const Qp *qp, void *scratch, size_t *bytes) {
    const size_t n = (size_t)qp->n, m = (size_t)qp->m;
    *bytes = qp_aligned((2 * n + 3 * m + (qp->n_terms ? n * n : 0)) * sizeof(double));
    return (double *)scratch;
}

size_t qp_scratch_size(const Qp *qp) {
    size_t own;
    (void)own_part(qp, NULL, &own);
    return own + qp_aligned(qp->backend->scratch_size(qp));
}

void qp_setup(const Qp *qp, void *scratch) {
    size_t own;
    (void)own_part(qp, scratch, &own);
    qp->backend->setup(qp, (char *)scratch + own);
}

static int all_finite(const double *v, int n) {
    for (int i = 0; i < n; i++)
        if (!isfinite(v[i])) return 0;
    return 1;
}

static double larger(double a, double b) { return a > b ? a : b; }

/* Largest of primal, dual and complementarity residual, each divided by max(1, largest magnitude of its terms); ay: n
 * numbers of scratch. */
static double residual(const Qp *qp, const QpCase *data, const double *q, const double *l, const double *u,
    const double *z, const double *y, double *ay) {
    const int n = qp->n, m = qp->m;
    double primal = 0.0, primal_size = 1.0, gap = 0.0, gap_size = 1.0, dual = 0.0, dual_size = 1.0;
    (void)memset(ay, 0, (size_t)n * sizeof(double));
    for (int i = 0; i < m; i++) {
        const double *a = data->constraints + (size_t)i * (size_t)n;
        double az = 0.0;
        for (int j = 0; j < n; j++) az += a[j] * z[j];
        if (y[i] != 0.0)
            for (int j = 0; j < n; j++) ay[j] += a[j] * y[i];
        primal = larger(primal, larger(l[i] - az, az - u[i]));
        primal_size = larger(primal_size, fabs(az));
        const double bound = y[i] > 0.0 ? u[i] : l[i];
        if (fabs(bound) >= QP_INFINITY) dual = larger(dual, fabs(y[i])); /* no bound, no multiplier */
        else if (y[i] != 0.0) {
            gap = larger(gap, fabs(y[i] * (bound - az)));
            gap_size = larger(gap_size, larger(fabs(y[i] * az), fabs(y[i] * bound)));
        }
    }
    for (int j = 0; j < n; j++) {
        const double *h = data->hessian + (size_t)j * (size_t)n;
        double hz = 0.0;
        for (int k = 0; k < n; k++) hz += h[k] * z[k];
        dual = larger(dual, fabs(hz + q[j] + ay[j]));
        dual_size = larger(dual_size, larger(fabs(hz), larger(fabs(q[j]), fabs(ay[j]))));
    }
    const double r = larger(primal / primal_size, larger(dual / dual_size, gap / gap_size));
    return r < NO_RESIDUAL ? r : NO_RESIDUAL;
}

/* Bounds for the back end: absent ones exactly +-QP_INFINITY, crossings within the tolerance closed. */
static QpStatus prepare_bounds(const Qp *qp, const double *lower, const double *upper, double *l, double *u) {
    QpStatus status = QP_SOLVED;
    for (int i = 0; i < qp->m; i++) {
        if (isnan(lower[i]) || isnan(upper[i])) return QP_BAD_DATA;
        if (lower[i] >= QP_INFINITY || upper[i] <= -QP_INFINITY) return QP_BAD_DATA;
        l[i] = larger(lower[i], -QP_INFINITY);
        u[i] = upper[i] < QP_INFINITY ? upper[i] : QP_INFINITY;
        if (l[i] <= u[i]) continue;
        if (l[i] - u[i] > qp->tolerance * larger(1.0, fabs(u[i]))) status = QP_INFEASIBLE;
        l[i] = u[i] = 0.5 * (l[i] + u[i]);
    }
    return status;
}

int qp_data_size(const Qp *qp) { return qp->n + 2 * qp->m + 1 + qp->n_terms; }

/* H with its terms, if it has any, in `sum`. */
static const double *with_terms(const Qp *qp, const double *hessian, const double *weights, double *sum) {
    const size_t size = (size_t)qp->n * (size_t)qp->n;
    if (qp->n_terms == 0) return hessian;
    (void)memcpy(sum, hessian, size * sizeof *sum);
    for (int k = 0; k < qp->n_terms; k++)
        for (size_t i = 0; i < size; i++) sum[i] += weights[k] * qp->terms[(size_t)k * size + i];
    return sum;
}

const QpCase *qp_case(const Qp *qp, double choice) {
    const double last = (double)(qp->n_cases - 1), rounded = floor(choice + 0.5);
    return qp->cases + (int)(!(rounded > 0.0) ? 0.0 : rounded > last ? last : rounded);
}

void qp_solve(const Qp *qp, void *scratch, double *memory, const double *data, double *solution) {
    const int n = qp->n, m = qp->m;
    size_t own;
    double *l = own_part(qp, scratch, &own), *u = l + m, *y = u + m, *z = y + m, *ay = z + n;
    const double *q = data, choice = data[n + 2 * m], *const weights = data + n + 2 * m + 1;
    double *result = solution, *multipliers = solution + n, *report = solution + n + m;
    const QpCase *const constant = qp_case(qp, choice);
    const QpCase sum = {with_terms(qp, constant->hessian, weights, ay + n), constant->constraints, NULL};
    const QpCase *const c = qp->n_terms ? &sum : constant;
    int iterations = 0;

    (void)memcpy(z, memory, (size_t)n * sizeof(double));
    (void)memset(y, 0, (size_t)m * sizeof(double));
    QpStatus status = prepare_bounds(qp, data + n, data + n + m, l, u);
    if (!all_finite(q, n) || !isfinite(choice) || !all_finite(weights, qp->n_terms)) status = QP_BAD_DATA;
    if (status == QP_SOLVED)
        status = qp->backend->solve(qp, c, (char *)scratch + own, memory + n, q, l, u, z, y, &iterations);
    const int usable = status == QP_SOLVED || status == QP_LIMIT_REACHED;
    const int finite = all_finite(z, n) && all_finite(y, m) && all_finite(memory + n, qp->n_memory);
    if (usable && !finite) status = QP_LIMIT_REACHED;
    if (!usable || !finite) { /* the last solution, and a cold start next time */
        (void)memcpy(z, memory, (size_t)n * sizeof(double));
        (void)memset(y, 0, (size_t)m * sizeof(double));
        (void)memset(memory + n, 0, (size_t)qp->n_memory * sizeof(double));
    } else if (status == QP_SOLVED) (void)memcpy(memory, z, (size_t)n * sizeof(double));
    (void)memcpy(result, z, (size_t)n * sizeof(double));
    (void)memcpy(multipliers, y, (size_t)m * sizeof(double));
    report[0] = (double)status;
    report[1] = (double)iterations;
    report[2] = status == QP_BAD_DATA ? NO_RESIDUAL : residual(qp, c, q, l, u, z, y, ay);
}

int qp_memory_ok(const Qp *qp, const double *memory) {
    return all_finite(memory, qp->n + qp->n_memory) && qp->backend->memory_ok(qp, memory + qp->n);
}

/* ------------------------------------------------------------------ the programs of a component */

static size_t all_scratch(void) {
    size_t bytes = 0;
    for (int k = 0; k < qp_count; k++) bytes += qp_scratch_size(&qp_list[k]);
    return bytes;
}

static void setup_all(void *scratch) {
    for (int k = 0; k < qp_count; k++) {
        qp_setup(&qp_list[k], scratch);
        scratch = (char *)scratch + qp_scratch_size(&qp_list[k]);
    }
}

static void solve_all(void *scratch, double *memory, const double *data, double *solution) {
    for (int k = 0; k < qp_count; k++) {
        const Qp *qp = &qp_list[k];
        qp_solve(qp, scratch, memory, data, solution);
        scratch = (char *)scratch + qp_scratch_size(qp);
        memory += qp->n + qp->n_memory;
        data += qp_data_size(qp);
        solution += qp->n + qp->m + 3;
    }
}

static int all_memory_ok(const double *memory) {
    for (int k = 0; k < qp_count; k++) {
        if (!qp_memory_ok(&qp_list[k], memory)) return 0;
        memory += qp_list[k].n + qp_list[k].n_memory;
    }
    return 1;
}

const FmuQpFunctions fmu_qp_functions = {all_scratch, setup_all, solve_all, all_memory_ok};
