/* Back end DAQP, a dual active-set solver (Arnstroem, Bemporad, Axehill 2022); its C sources lie in daqp/.
 *
 * The program becomes a least-distance problem in the coordinates R z + v: minimise |w|^2 subject to bounds on rows of
 * M = A inv(R). M is constant, or computed at each sample where H has terms; v and the bounds follow q, l, u. Memory:
 * the number of active rows, then each as +-(1 + row), negative at its lower bound. Nothing else of a solve survives
 * it, so a restored state continues exactly.
 */

#include "qp_daqp.h"

#include <float.h>
#include <string.h>

#include "daqp/daqp.h"
#include "fmu_math.h"
#include "qp.h"

#define EQUAL 1e-11 /* bounds this close are one (DAQP's zero_tol) */

typedef struct {
    DAQPWorkspace work;
    DAQPSettings settings;
    DAQPProblem problem;
    void *vectors; /* what the workspace's arrays lie in */
    size_t bytes;
    QpDaqpFactors factors; /* of this sample, where H has terms */
    double *rinv, *rows, *scaling;
} Scratch;

static size_t take(size_t *offset, size_t bytes) {
    const size_t at = *offset;
    *offset += qp_aligned(bytes);
    return at;
}

/* Lay the arrays of the workspace out from `base`; returns the bytes they take (all that is done when base is NULL). */
static size_t lay_out(const Qp *qp, DAQPWorkspace *w, char *base) {
    const size_t n = (size_t)qp->n, m = (size_t)qp->m, real = sizeof(c_float);
    size_t offset = 0;
    const size_t lam = take(&offset, (n + 1) * real), lam_star = take(&offset, (n + 1) * real);
    const size_t D = take(&offset, (n + 1) * real), xldl = take(&offset, (n + 1) * real),
                 zldl = take(&offset, (n + 1) * real);
    const size_t L = take(&offset, (n + 1) * (n + 2) / 2 * real), u = take(&offset, n * real),
                 x = take(&offset, n * real);
    const size_t v = take(&offset, n * real), upper = take(&offset, m * real), lower = take(&offset, m * real);
    const size_t Mu = take(&offset, m * real), WS = take(&offset, (n + 1) * sizeof(int)),
                 sense = take(&offset, m * sizeof(int));
    if (base) {
        w->lam = (c_float *)(void *)(base + lam);
        w->lam_star = (c_float *)(void *)(base + lam_star);
        w->D = (c_float *)(void *)(base + D);
        w->xldl = (c_float *)(void *)(base + xldl);
        w->zldl = (c_float *)(void *)(base + zldl);
        w->L = (c_float *)(void *)(base + L);
        w->u = (c_float *)(void *)(base + u);
        w->x = w->xold = (c_float *)(void *)(base + x);
        w->v = (c_float *)(void *)(base + v);
        w->dupper = (c_float *)(void *)(base + upper);
        w->dlower = (c_float *)(void *)(base + lower);
        w->Mu = (c_float *)(void *)(base + Mu);
        w->WS = (int *)(void *)(base + WS);
        w->sense = (int *)(void *)(base + sense);
    }
    return offset;
}

/* Lay out the factors of a sample likewise. */
static size_t lay_out_factors(const Qp *qp, Scratch *s, char *base) {
    const size_t n = (size_t)qp->n, m = (size_t)qp->m, real = sizeof(double);
    size_t offset = 0;
    if (qp->n_terms == 0) return 0;
    const size_t rinv = take(&offset, n * (n + 1) / 2 * real), rows = take(&offset, m * n * real),
                 scaling = take(&offset, m * real);
    if (base) {
        s->rinv = (double *)(void *)(base + rinv);
        s->rows = (double *)(void *)(base + rows);
        s->scaling = (double *)(void *)(base + scaling);
        s->factors.rinv = s->rinv;
        s->factors.rows = s->rows;
        s->factors.scaling = s->scaling;
        s->factors.ill_conditioned = 1; /* nobody has looked: DAQP refines its solution */
    }
    return offset;
}

static size_t scratch_size(const Qp *qp) {
    return qp_aligned(sizeof(Scratch)) + lay_out(qp, NULL, NULL) + lay_out_factors(qp, NULL, NULL);
}

static void setup(const Qp *qp, void *scratch) {
    const QpDaqpSettings *chosen = (const QpDaqpSettings *)qp->settings;
    Scratch *s = (Scratch *)scratch;
    s->vectors = (char *)scratch + qp_aligned(sizeof *s);
    s->bytes = lay_out(qp, &s->work, (char *)s->vectors);
    (void)lay_out_factors(qp, s, (char *)s->vectors + s->bytes);
    s->settings.primal_tol = chosen->tolerance;
    s->settings.iter_limit = chosen->max_iterations;
    s->settings.dual_tol = DAQP_DEFAULT_DUAL_TOL;
    s->settings.zero_tol = DAQP_DEFAULT_ZERO_TOL;
    s->settings.pivot_tol = DAQP_DEFAULT_PIVOT_TOL;
    s->settings.progress_tol = DAQP_DEFAULT_PROG_TOL;
    s->settings.cycle_tol = DAQP_DEFAULT_CYCLE_TOL;
    s->settings.fval_bound = DAQP_INF;
    s->settings.eps_prox = DAQP_DEFAULT_EPS_PROX;
    s->settings.eta_prox = DAQP_DEFAULT_ETA;
    s->settings.rho_soft = DAQP_DEFAULT_RHO_SOFT;
    s->settings.w_soft = DAQP_DEFAULT_W_SOFT;
    s->settings.sing_tol = DAQP_DEFAULT_SING_TOL;
    s->settings.refactor_tol = DAQP_DEFAULT_REFACTOR_TOL;
    s->problem.n = s->work.n = qp->n;
    s->problem.m = s->work.m = qp->m;
    s->work.settings = &s->settings;
    s->work.qp = &s->problem;
}

/* The factors of H: R by Cholesky, with which rows of `rinv` begin, then its inverse and the rows of A. Returns whether
 * H is positive definite to working precision. */
static int factorize(const Qp *qp, const QpCase *data, const Scratch *s) {
    const int n = qp->n;
    double *const r = s->rinv;
    for (int i = 0, at = 0; i < n; at += n - i, i++) { /* row i of R is r[at ...], from its diagonal on */
        double *const row = r + at;
        for (int j = i; j < n; j++) row[j - i] = data->hessian[(size_t)i * (size_t)n + (size_t)j];
        for (int k = 0, above = 0; k < i; above += n - k, k++)
            for (int j = i; j < n; j++) row[j - i] -= r[above + i - k] * r[above + j - k];
        if (!(row[0] > (double)n * DBL_EPSILON * data->hessian[(size_t)i * (size_t)n + (size_t)i])) return 0;
        const double root = sqrt(row[0]);
        for (int j = i; j < n; j++) row[j - i] /= root;
    }
    for (int i = n - 1, at = n * (n + 1) / 2 - 1; i >= 0; i--, at -= n - i) { /* from the last row up, in place */
        double *const row = r + at;
        const double inverse = 1.0 / row[0];
        for (int j = n - 1; j > i; j--) {
            double sum = 0.0;
            for (int k = i + 1, below = at + n - i; k <= j; below += n - k, k++) sum += row[k - i] * r[below + j - k];
            row[j - i] = -inverse * sum;
        }
        row[0] = inverse;
    }
    for (int i = 0; i < qp->m; i++) {
        const double *const a = data->constraints + (size_t)i * (size_t)n;
        double *const row = s->rows + (size_t)i * (size_t)n, square = 0.0;
        (void)memset(row, 0, (size_t)n * sizeof *row);
        for (int k = 0, at = 0; k < n; at += n - k, k++)
            for (int j = k; a[k] != 0.0 && j < n; j++) row[j] += a[k] * r[at + j - k];
        for (int j = 0; j < n; j++) square += row[j] * row[j];
        s->scaling[i] = square > 0.0 ? 1.0 / sqrt(square) : 1.0;
        for (int j = 0; j < n; j++) row[j] *= s->scaling[i];
    }
    return 1;
}

/* v = inv(R)'q, and the bounds of the normalized rows, moved by M v. */
static void transform(DAQPWorkspace *w, const double *q, const double *l, const double *u) {
    const int n = w->n;
    const double *r = w->Rinv;
    for (int j = 0; j < n; j++) w->v[j] = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++) w->v[j] += *r++ * q[i];
    for (int i = 0; i < w->m; i++) {
        const double *row = w->M + (size_t)i * (size_t)n;
        double shift = 0.0;
        for (int j = 0; j < n; j++) shift += row[j] * w->v[j];
        w->dlower[i] = l[i] <= -QP_INFINITY ? -QP_INFINITY : l[i] * w->scaling[i] + shift;
        w->dupper[i] = u[i] >= QP_INFINITY ? QP_INFINITY : u[i] * w->scaling[i] + shift;
    }
}

static int is_zero(const double *row, int n) {
    for (int j = 0; j < n; j++)
        if (row[j] != 0.0) return 0;
    return 1;
}

/* Start with row i active at a bound that it has. */
static void activate(DAQPWorkspace *w, int i, int lower, const double *l, const double *u) {
    if (w->sense[i] || (lower ? l[i] <= -QP_INFINITY : u[i] >= QP_INFINITY)) return;
    w->sense[i] = DAQP_ACTIVE | (lower ? DAQP_LOWER : 0);
}

/* Equations, rows of zeros, and the active rows of the last solution and of the multipliers y. */
static QpStatus mark_rows(
    const Qp *qp, DAQPWorkspace *w, const double *memory, const double *l, const double *u, const double *y) {
    for (int i = 0; i < w->m; i++) {
        if (is_zero(w->M + (size_t)i * (size_t)w->n, w->n)) {
            if (l[i] > qp->tolerance || u[i] < -qp->tolerance) return QP_INFEASIBLE;
            w->sense[i] = DAQP_IMMUTABLE; /* ignored */
        } else if (u[i] - l[i] < EQUAL) w->sense[i] = DAQP_ACTIVE | DAQP_IMMUTABLE;
        if (y[i] != 0.0) activate(w, i, y[i] < 0.0, l, u);
    }
    const int count = (int)memory[0];
    for (int k = 0; k < count; k++) activate(w, (int)fabs(memory[1 + k]) - 1, memory[1 + k] < 0.0, l, u);
    return QP_SOLVED;
}

/* At most n + 1 active rows, each a row of the program. */
static int memory_ok(const Qp *qp, const double *memory) {
    if (!(memory[0] >= 0.0 && memory[0] <= (double)(qp->n + 1)) || memory[0] != floor(memory[0])) return 0;
    for (int k = 0; k < (int)memory[0]; k++) {
        const double row = fabs(memory[1 + k]);
        if (!(row >= 1.0 && row <= (double)qp->m) || row != floor(row)) return 0;
    }
    return 1;
}

static QpStatus solve(const Qp *qp, const QpCase *data, void *scratch, double *memory, const double *q, const double *l,
                      const double *u, double *z, double *y, int *iterations) {
    Scratch *s = (Scratch *)scratch;
    DAQPWorkspace *w = &s->work;
    const QpDaqpFactors *const f = qp->n_terms ? &s->factors : (const QpDaqpFactors *)data->factors;
    if (qp->n_terms && !factorize(qp, data, s)) return QP_BAD_DATA;
    (void)memset(s->vectors, 0, s->bytes);
    (void)lay_out(qp, w, (char *)s->vectors); /* DAQP exchanges pointers */
    w->Rinv = (c_float *)f->rinv;     /* DAQP only reads these */
    w->M = (c_float *)f->rows;
    w->scaling = (c_float *)f->scaling;
    w->state = f->ill_conditioned ? DAQP_STATE_ILL_CONDITIONED : 0;
    s->problem.A = (c_float *)data->constraints;
    s->problem.bupper = (c_float *)u;
    s->problem.blower = (c_float *)l;
    transform(w, q, l, u);
    if (mark_rows(qp, w, memory, l, u, y) != QP_SOLVED) return QP_INFEASIBLE;
    (void)memset(y, 0, (size_t)qp->m * sizeof(double));

    reset_daqp_workspace(w);
    if (daqp_activate_constraints(w) < 0) return QP_INFEASIBLE; /* equations that contradict each other */
    const int flag = daqp_ldp(w);
    *iterations = w->iterations;
    if (flag == DAQP_EXIT_INFEASIBLE) return QP_INFEASIBLE;
    ldp2qp_solution(w);
    if (flag > 0) daqp_refine_primal(w);
    (void)memcpy(z, w->x, (size_t)qp->n * sizeof(double));
    for (int k = 0; k < w->n_active; k++) y[w->WS[k]] = w->lam_star[k];
    memory[0] = (double)w->n_active;
    for (int k = 0; k < w->n_active; k++)
        memory[1 + k] = (w->sense[w->WS[k]] & DAQP_LOWER ? -1.0 : 1.0) * (1.0 + (double)w->WS[k]);
    return flag > 0 ? QP_SOLVED : QP_LIMIT_REACHED;
}

const QpBackend qp_daqp = {scratch_size, setup, solve, memory_ok};
