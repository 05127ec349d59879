/* Back end OSQP, an operator-splitting solver (Stellato, Banjac, Goulart, Bemporad, Boyd 2020); its C sources lie in
 * osqp/.
 *
 * OSQP's own code generator writes a workspace of global variables for one instance. Here the same workspace is laid
 * out in the caller's scratch, so that instances share nothing but constants. The linear system of each iteration is
 * solved with constant factors of its reduced form, which is dense and small because the programs are condensed.
 * Memory: the last iterate z and its multipliers, from which the next solve starts.
 *
 * A fallback, DAQP, solves each program again: from the rows that OSQP found active, which makes the solution exact, or
 * from scratch where OSQP has reached its limit of iterations or says that there is no solution, which can be wrong. It
 * has its own part of scratch, and no warm start of its own. */

#include "qp_osqp.h"

#include <string.h>

#include "osqp/types.h"

#include "osqp/algebra_impl.h"
#include "qp.h"

typedef struct {
    LinSysSolver solver; /* first: OSQP knows this part only */
    const QpOsqpFactors *factors;
    const OSQPMatrix *A;
    double rho;
    int n, m;
} Reduced;

enum { /* vectors of the workspace with n, m and n + m elements */
    X, X_PREV, PX, ATY, ATDELTA_Y, DELTA_X, PDELTA_X, Q, SOLUTION_X, CERTIFICATE_X, START, TURNED, N_VECTORS,
};
enum { Y, Z, Z_PREV, AX, DELTA_Y, ADELTA_X, LOWER, UPPER, SOLUTION_Y, CERTIFICATE_Y, M_VECTORS };

typedef struct {
    OSQPSolver solver;
    OSQPSettings settings;
    OSQPSolution solution;
    OSQPInfo info;
    OSQPWorkspace work;
    OSQPData data;
    OSQPCscMatrix P_csc, A_csc;
    OSQPMatrix P, A;
    Reduced reduced;
    OSQPVectorf of_n[N_VECTORS], of_m[M_VECTORS], tilde, x_tilde, z_tilde;
    void *vectors;
    size_t bytes;
    double *fallback_memory;
    void *fallback_scratch;
} Scratch;

static size_t vector_bytes(const Qp *qp) {
    const size_t n = (size_t)qp->n, m = (size_t)qp->m;
    return qp_aligned((N_VECTORS * n + M_VECTORS * m + n + m) * sizeof(OSQPFloat));
}

static size_t memory_bytes(const Qp *qp) { return qp_aligned((size_t)qp->n_memory * sizeof(double)); }

static size_t scratch_size(const Qp *qp) {
    const Qp *f = qp->fallback;
    return qp_aligned(sizeof(Scratch)) + vector_bytes(qp) + (f ? memory_bytes(f) + f->backend->scratch_size(f) : 0);
}

static const char *reduced_name(LinSysSolver *self) {
    (void)self;
    return "reduced";
}

/* From (bx, bz) to x = inv(P + sigma I + rho A'A) (bx + rho A'bz) and A x. */
static OSQPInt reduced_solve(LinSysSolver *self, OSQPVectorf *b, OSQPInt iteration) {
    const Reduced *r = (const Reduced *)(const void *)self;
    const double *L = r->factors->lower, *inverse = r->factors->inverse_diagonal;
    const int n = r->n;
    double *x = b->values;
    OSQPVectorf bx = {x, r->n}, bz = {x + n, r->m};
    (void)iteration;
    OSQPMatrix_Atxpy(r->A, &bz, &bx, r->rho, 1.0);
    for (int i = 1, k = 0; i < n; i++) {
        double sum = x[i];
        for (int j = 0; j < i; j++) sum -= L[k++] * x[j];
        x[i] = sum;
    }
    for (int i = 0; i < n; i++) x[i] *= inverse[i];
    for (int i = n - 1; i > 0; i--) {
        const double *row = L + (size_t)i * (size_t)(i - 1) / 2;
        for (int j = 0; j < i; j++) x[j] -= row[j] * x[i];
    }
    OSQPMatrix_Axpy(r->A, &bx, &bz, 1.0, 0.0);
    return 0;
}

static void reduced_update(LinSysSolver *self, const OSQPSettings *settings) {
    (void)self;
    (void)settings;
}

static void reduced_start(LinSysSolver *self, const OSQPVectorf *x) {
    (void)self;
    (void)x;
}

static void setup(const Qp *qp, void *scratch) {
    const QpOsqpSettings *chosen = (const QpOsqpSettings *)qp->settings;
    const int n = qp->n, m = qp->m;
    Scratch *s = (Scratch *)scratch;
    double *at = (double *)(void *)((char *)scratch + qp_aligned(sizeof *s));
    s->vectors = at;
    s->bytes = vector_bytes(qp);
    if (qp->fallback) {
        char *theirs = (char *)scratch + qp_aligned(sizeof *s) + s->bytes;
        s->fallback_memory = (double *)(void *)theirs;
        s->fallback_scratch = theirs + memory_bytes(qp->fallback);
        qp->fallback->backend->setup(qp->fallback, s->fallback_scratch);
    }
    for (int i = 0; i < N_VECTORS; i++, at += n) s->of_n[i] = (OSQPVectorf){at, n};
    for (int i = 0; i < M_VECTORS; i++, at += m) s->of_m[i] = (OSQPVectorf){at, m};
    s->tilde = (OSQPVectorf){at, n + m};
    s->x_tilde = (OSQPVectorf){at, n};
    s->z_tilde = (OSQPVectorf){at + n, m};

    s->settings.linsys_solver = OSQP_DIRECT_SOLVER;
    s->settings.allocate_solution = 1;
    s->settings.warm_starting = 1;
    s->settings.rho = chosen->rho;
    s->settings.sigma = chosen->sigma;
    s->settings.alpha = chosen->alpha;
    s->settings.max_iter = chosen->max_iterations;
    s->settings.eps_abs = s->settings.eps_rel = chosen->tolerance;
    s->settings.eps_prim_inf = s->settings.eps_dual_inf = chosen->infeasibility_tolerance;
    s->settings.check_termination = chosen->check_interval;
    s->settings.check_dualgap = 1;
    s->settings.time_limit = OSQP_INFTY;

    s->solution.x = s->of_n[SOLUTION_X].values;
    s->solution.y = s->of_m[SOLUTION_Y].values;
    s->solution.dual_inf_cert = s->of_n[CERTIFICATE_X].values;
    s->solution.prim_inf_cert = s->of_m[CERTIFICATE_Y].values;
    s->solver.settings = &s->settings;
    s->solver.solution = &s->solution;
    s->solver.info = &s->info;
    s->solver.work = &s->work;
    s->P.csc = &s->P_csc;
    s->P.symmetry = TRIU;
    s->A.csc = &s->A_csc;
    s->A.symmetry = NONE;
    s->reduced.solver.type = OSQP_DIRECT_SOLVER;
    s->reduced.solver.name = reduced_name;
    s->reduced.solver.solve = reduced_solve;
    s->reduced.solver.update_settings = reduced_update;
    s->reduced.solver.warm_start = reduced_start;
    s->reduced.solver.nthreads = 1;
    s->reduced.A = &s->A;
    s->reduced.rho = chosen->rho;
    s->reduced.n = n;
    s->reduced.m = m;
}

/* OSQP exchanges pointers to vectors while it runs: put them back, so that a solve depends on its arguments alone. */
static void connect(const Qp *qp, Scratch *s) {
    OSQPWorkspace *w = &s->work;
    (void)memset(s->vectors, 0, s->bytes);
    (void)memset(w, 0, sizeof *w);
    (void)memset(&s->info, 0, sizeof s->info);
    s->data.n = qp->n;
    s->data.m = qp->m;
    s->data.P = &s->P;
    s->data.A = &s->A;
    s->data.q = &s->of_n[Q];
    s->data.l = &s->of_m[LOWER];
    s->data.u = &s->of_m[UPPER];
    w->data = &s->data;
    w->linsys_solver = &s->reduced.solver;
    w->x = &s->of_n[X];
    w->y = &s->of_m[Y];
    w->z = &s->of_m[Z];
    w->xz_tilde = &s->tilde;
    w->xtilde_view = &s->x_tilde;
    w->ztilde_view = &s->z_tilde;
    w->x_prev = &s->of_n[X_PREV];
    w->z_prev = &s->of_m[Z_PREV];
    w->Ax = &s->of_m[AX];
    w->Px = &s->of_n[PX];
    w->Aty = &s->of_n[ATY];
    w->delta_y = &s->of_m[DELTA_Y];
    w->Atdelta_y = &s->of_n[ATDELTA_Y];
    w->delta_x = &s->of_n[DELTA_X];
    w->Pdelta_x = &s->of_n[PDELTA_X];
    w->Adelta_x = &s->of_m[ADELTA_X];
    w->rho_inv = 1.0 / s->settings.rho;
    w->last_rel_kkt = OSQP_INFTY;
}

static OSQPCscMatrix by_columns(int rows, int columns, const int *p, const int *i, const double *x) {
    /* OSQP only reads them */
    return (OSQPCscMatrix){.m = rows, .n = columns, .p = (OSQPInt *)p, .i = (OSQPInt *)i, .x = (OSQPFloat *)x,
                           .nzmax = p[columns], .nz = -1};
}

/* to = T from, or T'from */
static void multiply(const double *T, int transposed, int n, const double *from, double *to) {
    for (int i = 0; i < n; i++) {
        to[i] = 0.0;
        for (int j = 0; j < n; j++) to[i] += T[transposed ? j * n + i : i * n + j] * from[j];
    }
}

/* Keep the multipliers of the rows that hold the solution, those where it is closer to a bound than the multiplier; row
 * and curvature are about 1 in these units. OSQP leaves others at rows that were active once. */
static void keep_active(const Scratch *s, double *y) {
    const double *z = s->work.z->values, *of = s->solution.y, *l = s->data.l->values, *u = s->data.u->values;
    for (int i = 0; i < (int)s->data.m; i++)
        if (!(z[i] - l[i] < -of[i] || u[i] - z[i] < of[i])) y[i] = 0.0;
}

/* Solve by the fallback, from what OSQP has `found`, or from scratch. OSQP continues from its own iterate in memory,
 * since other multipliers can make it slower where they are not unique; only where it has found none it starts from the
 * fallback's solution. */
static QpStatus solve_again(const Qp *qp, const QpCase *data, Scratch *s, int found, double *memory, const double *q,
    const double *l, const double *u, double *z, double *y, int *iterations) {
    const Qp *f = qp->fallback;
    const size_t n = (size_t)qp->n, m = (size_t)qp->m;
    int more = 0;
    (void)memset(s->fallback_memory, 0, memory_bytes(f));
    if (found) keep_active(s, y);
    else (void)memset(y, 0, m * sizeof(double));
    const QpStatus status = f->backend->solve(
        f, f->cases + (data - qp->cases), s->fallback_scratch, s->fallback_memory, q, l, u, z, y, &more);
    *iterations += more;
    if (found && status != QP_SOLVED) {
        (void)memcpy(z, memory, n * sizeof(double));
        (void)memcpy(y, memory + n, m * sizeof(double));
    } else if (!found && status == QP_SOLVED) {
        (void)memcpy(memory, z, n * sizeof(double));
        (void)memcpy(memory + n, y, m * sizeof(double));
    }
    return found ? QP_SOLVED : status;
}

static QpStatus solve(const Qp *qp, const QpCase *data, void *scratch, double *memory, const double *q, const double *l,
                      const double *u, double *z, double *y, int *iterations) {
    const QpOsqpFactors *f = (const QpOsqpFactors *)data->factors;
    const int n = qp->n, m = qp->m;
    Scratch *s = (Scratch *)scratch;
    connect(qp, s);
    s->P_csc = by_columns(n, n, f->p_columns, f->p_rows, f->p_values);
    s->A_csc = by_columns(m, n, f->a_columns, f->a_rows, f->a_values);
    s->reduced.factors = f;

    const double *e = f->row_scale, *multipliers = memory + n;
    double *turned = s->of_n[TURNED].values, *start = s->of_n[START].values;
    double *lower = s->of_m[SOLUTION_Y].values,
           *upper = s->of_m[CERTIFICATE_Y].values; /* free until the end of the solve */
    multiply(f->transform, 1, n, q, turned);
    for (int i = 0; i < m; i++) {
        lower[i] = l[i] <= -QP_INFINITY ? -OSQP_INFTY : e[i] * l[i];
        upper[i] = u[i] >= QP_INFINITY ? OSQP_INFTY : e[i] * u[i];
    }
    if (osqp_update_data_vec(&s->solver, turned, lower, upper) != 0) return QP_BAD_DATA;
    multiply(f->inverse, 0, n, memory, start);
    for (int i = 0; i < m; i++) lower[i] = multipliers[i] / e[i];
    (void)osqp_warm_start(&s->solver, start, lower);
    (void)osqp_solve(&s->solver);

    *iterations = (int)s->info.iter;
    switch (s->info.status_val) {
        case OSQP_SOLVED:
        case OSQP_SOLVED_INACCURATE:
        case OSQP_MAX_ITER_REACHED: break;
        case OSQP_PRIMAL_INFEASIBLE:
        case OSQP_PRIMAL_INFEASIBLE_INACCURATE: /* which can be wrong; the start stays */
            return qp->fallback ? solve_again(qp, data, s, 0, memory, q, l, u, z, y, iterations) : QP_INFEASIBLE;
        default: /* no solution in the workspace: the start value */
            (void)memset(memory, 0, (size_t)(n + m) * sizeof(double));
            return qp->fallback ? solve_again(qp, data, s, 0, memory, q, l, u, z, y, iterations) : QP_LIMIT_REACHED;
    }
    multiply(f->transform, 0, n, s->solution.x, z);
    for (int i = 0; i < m; i++) y[i] = e[i] * s->solution.y[i];
    (void)memcpy(memory, z, (size_t)n * sizeof(double));
    (void)memcpy(memory + n, y, (size_t)m * sizeof(double));
    const int found = s->info.status_val == OSQP_SOLVED;
    if (qp->fallback) return solve_again(qp, data, s, found, memory, q, l, u, z, y, iterations);
    return found ? QP_SOLVED : QP_LIMIT_REACHED;
}

/* An iterate and multipliers: any finite numbers are a start. */
static int memory_ok(const Qp *qp, const double *memory) {
    (void)qp, (void)memory;
    return 1;
}

const QpBackend qp_osqp = {scratch_size, setup, solve, memory_ok};
