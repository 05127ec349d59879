/* Quadratic programs of a component with derivatives (qp.h): values as qp.c finds them, derivatives of a solution from
 * its optimality conditions at the rows that are active there, those with a multiplier and those whose bounds are one:
 *     H dz + A' dy = -dq - dH z,   A dz = db,   dy = 0 for all other rows.
 * Where active rows depend on each other, and where the solver has stopped at its limit of iterations, there is no
 * derivative: it is NaN. Which rows are active is a side taken (numbers.h). */
#include "qp_model.h"

INLINE double size_of(double x) { return x < 0.0 ? -x : x; } /* fabs is that of lanes here */

/* What is kept of a program from one solution to the next: its case, from 1 on, number of active rows, weights of
 * terms, these rows, and the inverse of their system, for as long as they are the same. */
static size_t kept_numbers(const Qp *qp) {
    const size_t n = (size_t)qp->n, m = (size_t)qp->m, most = n + (n < m ? n : m);
    return 2 + (size_t)qp->n_terms + m + (2 * most + 1) * most;
}

static size_t programs_bytes(void) {
    size_t numbers = 0;
    for (int k = 0; k < qp_count; k++) numbers += kept_numbers(&qp_list[k]);
    return qp_aligned(fmu_qp_functions.scratch_size()) + numbers * sizeof(double);
}

/* Rows of n numbers, and behind each as many of the unit matrix, which become the inverse: elimination with row
 * exchanges. Returns whether there is one: a pivot that is only rounding of its column counts as zero. `largest`:
 * memory for n numbers. */
static int invert(double *a, size_t n, double *largest) {
    const size_t width = 2 * n;
    for (size_t k = 0; k < n; k++) {
        largest[k] = 0.0;
        for (size_t i = 0; i < n; i++)
            if (size_of(a[i * width + k]) > largest[k]) largest[k] = size_of(a[i * width + k]);
    }
    for (size_t k = 0; k < n; k++) {
        double *const top = a + k * width, *best = top;
        for (size_t i = k + 1; i < n; i++)
            if (size_of(a[i * width + k]) > size_of(best[k])) best = a + i * width;
        if (!(size_of(best[k]) > 16.0 * (double)n * DBL_EPSILON * largest[k])) return 0;
        for (size_t j = k; best != top && j < width; j++) {
            const double other = top[j];
            top[j] = best[j];
            best[j] = other;
        }
        for (size_t i = 0; i < n; i++) {
            double *const row = a + i * width;
            const double factor = row[k] / top[k];
            for (size_t j = k; i != k && factor != 0.0 && j < width; j++) row[j] -= factor * top[j];
        }
    }
    for (size_t k = 0; k < n; k++)
        for (size_t j = n; j < width; j++) a[k * width + j] /= a[k * width + k];
    return 1;
}

/* Row j of a term of H. */
INLINE const double *term(const Qp *qp, int k, size_t j) {
    return qp->terms + ((size_t)k * (size_t)qp->n + j) * (size_t)qp->n;
}

/* Element j of the diagonal of H. */
static double curvature(const Qp *qp, const QpCase *c, const lanes *weights, size_t j) {
    double h = c->hessian[j * (size_t)qp->n + j];
    for (int k = 0; k < qp->n_terms; k++) h += weights[k].v * term(qp, k, j)[j];
    return h;
}

/* By row, which bound holds the solution: the upper one (1), the lower one (-1), both, which are one (2), or none. A
 * multiplier y pulls Az to the bound by about y a inv(H) a'. It holds nothing where that is less than Az is away from
 * there, or where y is rounding in units that make the diagonal of H and the length of the row 1: OSQP leaves as much
 * at rows that were active in an earlier sample. A row of zeros holds nothing either. Returns how many rows hold. */
static int find_sides(const Qp *qp, const QpCase *c, const lanes *data, const lanes *solution, int *side) {
    const int n = qp->n, m = qp->m;
    const lanes *const lower = data + n, *const upper = lower + m, *const weights = upper + m + 1;
    int active = 0;
    for (int i = 0; i < m; i++) {
        const double *const a = c->constraints + (size_t)i * (size_t)n, y = solution[n + i].v;
        const int equal = lower[i].v == upper[i].v;
        double az = 0.0, pull = 0.0;
        side[i] = 0;
        for (int j = 0; j < n && (equal || y != 0.0); j++) {
            az += a[j] * solution[j].v;
            if (a[j] != 0.0) pull += a[j] * a[j] / curvature(qp, c, weights, (size_t)j);
        }
        const double away = size_of((y > 0.0 ? upper : lower)[i].v - az);
        if (equal) side[i] = pull > 0.0 ? 2 : 0;
        else if (away < size_of(y) * pull && size_of(y) * __builtin_sqrt(pull) > 1e-12) side[i] = y > 0.0 ? 1 : -1;
        active += side[i] != 0;
    }
    return active;
}

/* Derivatives of the solution of one program that its `active` rows hold. `known`: what is kept of it. */
static void differentiate(
    const Qp *qp, const lanes *data, lanes *solution, const int *side, int active, double *known) {
    const int n = qp->n, m = qp->m;
    const lanes *const q = data, *const lower = q + n, *const upper = lower + m;
    const lanes *const weights = upper + m + 1;
    const QpCase *const c = qp_case(qp, data[n + 2 * m].v);
    double *const weighed = known + 2, *const rows = weighed + qp->n_terms, *const a = rows + m;
    const double which = (double)(c - qp->cases) + 1.0;
    int same = known[0] == which && known[1] == (double)active;
    for (int i = 0, k = 0; i < m; i++)
        if (side[i]) {
            same &= rows[k] == (double)i;
            rows[k++] = (double)i;
        }
    for (int k = 0; k < qp->n_terms; k++) {
        same &= weighed[k] == weights[k].v;
        weighed[k] = weights[k].v;
    }
    const size_t size = (size_t)(n + active), width = 2 * size;
    int solved = solution[n + m].v == QP_SOLVED && active <= n;
    if (solved && !same) {
        memset(a, 0, size * width * sizeof *a);
        for (size_t j = 0; j < size; j++) a[j * width + size + j] = j < (size_t)n ? -1.0 : 1.0;
        for (size_t j = 0; j < (size_t)n; j++)
            for (size_t i = 0; i < (size_t)n; i++) {
                double *const h = a + j * width + i;
                *h = c->hessian[j * (size_t)n + i];
                for (int k = 0; k < qp->n_terms; k++) *h += weighed[k] * term(qp, k, j)[i];
            }
        for (size_t r = (size_t)n; r < size; r++)
            for (size_t j = 0; j < (size_t)n; j++)
                a[r * width + j] = a[j * width + r] = c->constraints[(size_t)rows[r - (size_t)n] * (size_t)n + j];
        solved = invert(a, size, a + size * width);
    }
    known[0] = solved ? which : 0.0;
    known[1] = (double)active;
#ifdef ADJOINTS
    static_assert((int)N_QP_SOLUTION <= (int)TAPE_SPARE, "a solution depends on more than the tape has space for");
#endif
    const lanes *of[N_QP_SOLUTION];
    lanes moving[N_QP_SOLUTION]; /* q, moved by dH z */
    const lanes *from[N_QP_DATA];
    double by[N_QP_DATA];
    for (int j = 0; j < n && qp->n_terms; j++) {
        by[0] = 1.0;
        from[0] = &q[j];
        for (int k = 0; k < qp->n_terms; k++) {
            from[1 + k] = &weights[k];
            by[1 + k] = 0.0;
            for (int i = 0; i < n; i++) by[1 + k] += term(qp, k, (size_t)j)[i] * solution[i].v;
        }
        moving[j] = chain(q[j].v, 1 + qp->n_terms, by, from);
    }
    const lanes *const linear = qp->n_terms ? moving : q;
    int column[N_QP_SOLUTION], count = 0;
    for (int k = 0; k < n + active; k++) {
        const int row = k < n ? 0 : (int)rows[k - n];
        of[count] = k < n ? &linear[k] : solution[n + row].v > 0.0 ? &upper[row] : &lower[row];
        column[count] = k;
        count += depends(*of[count]);
    }
    for (int k = 0; k < n + active; k++) {
        lanes *const result = &solution[k < n ? k : n + (int)rows[k - n]];
        double slopes[N_QP_SOLUTION];
        for (int j = 0; j < count; j++) slopes[j] = solved ? a[(size_t)k * width + size + (size_t)column[j]] : NAN;
        *result = chain(result->v, count, slopes, of);
    }
}

/* Values and derivatives of all programs. `memory`: their warm starts, which receive the next ones; `kept`: the last
 * solutions that were found, as a program without one gives them again; `trial`: nothing is kept. */
static void solve_programs(
    lanes *data, lanes *solution, double *memory, lanes *kept, int trial, char *scratch) {
    double values[N_QP_DATA], found[N_QP_SOLUTION];
    double *known = (double *)(void *)(scratch + qp_aligned(fmu_qp_functions.scratch_size()));
    for (int i = 0; i < N_QP_DATA; i++) values[i] = data[i].v;
    fmu_qp_functions.solve(scratch, memory, values, found);
    for (int i = 0; i < N_QP_SOLUTION; i++) solution[i] = lanes_all(found[i]);
    for (int k = 0; k < qp_count; k++) {
        const Qp *const qp = &qp_list[k];
        const int size = qp_data_size(qp), results = qp->n + qp->m + 3;
        const double status = solution[qp->n + qp->m].v;
        int moves = 0;
        for (int i = 0; i < size && !moves; i++) moves = depends(data[i]);
        if (status == QP_SOLVED || status == QP_LIMIT_REACHED) {
            if (moves) {
                int side[N_QP_SOLUTION];
                const int active = find_sides(qp, qp_case(qp, data[qp->n + 2 * qp->m].v), data, solution, side);
                for (int i = 0; i < qp->m; i++) take_side((uint64_t)(side[i] + 1));
                differentiate(qp, data, solution, side, active, known);
            }
            if (status == QP_SOLVED && !trial) memcpy(kept, solution, (size_t)qp->n * sizeof *kept);
        } else {
            for (int i = 0; i < qp->n; i++) solution[i] = moved(solution[i].v, kept[i]);
        }
        data += size;
        known += kept_numbers(qp);
        solution += results;
        kept += results;
    }
}
