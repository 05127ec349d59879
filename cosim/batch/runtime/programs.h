/* Quadratic programs of a component with derivatives (qp.h): values as qp.c finds them, derivatives of a solution from
 * its optimality conditions at the rows that are active there, those with a multiplier:
 *     H dz + A' dy = -dq,   A dz = db,   dy = 0 for all other rows.
 * Where active rows depend on each other, and where the solver has stopped at its limit of iterations, there is no
 * derivative: it is NaN. Which rows are active is a side taken (tangents.h). */
#include "qp_model.h"

INLINE double size_of(double x) { return x < 0.0 ? -x : x; } /* fabs is that of lanes here */
INLINE double *directions(lanes *x) { return (double *)x->d; }

/* Rows of the largest system. */
static int most_unknowns(void) {
    int most = 0;
    for (int k = 0; k < qp_count; k++) {
        const int size = qp_list[k].n + (qp_list[k].n < qp_list[k].m ? qp_list[k].n : qp_list[k].m);
        most = size > most ? size : most;
    }
    return most;
}

static size_t programs_bytes(void) {
    const size_t n = (size_t)most_unknowns();
    return qp_aligned(fmu_qp_functions.scratch_size()) + n * (n + TANGENTS) * sizeof(double);
}

/* Solve a x = b for all right sides by elimination with row exchanges; rows of n + TANGENTS numbers. Returns whether
 * there is a solution. */
static int eliminate(double *a, int n) {
    const size_t width = (size_t)n + TANGENTS;
    for (int k = 0; k < n; k++) {
        double *const top = a + (size_t)k * width;
        double *best = top;
        for (int i = k + 1; i < n; i++) {
            double *const row = a + (size_t)i * width;
            if (size_of(row[k]) > size_of(best[k])) best = row;
        }
        if (!(size_of(best[k]) > 0.0)) return 0;
        for (size_t j = (size_t)k; best != top && j < width; j++) {
            const double other = top[j];
            top[j] = best[j];
            best[j] = other;
        }
        for (int i = k + 1; i < n; i++) {
            double *const row = a + (size_t)i * width;
            const double factor = row[k] / top[k];
            for (size_t j = (size_t)k; factor != 0.0 && j < width; j++) row[j] -= factor * top[j];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        double *const row = a + (size_t)k * width;
        for (int i = k + 1; i < n; i++)
            for (size_t j = 0; row[i] != 0.0 && j < TANGENTS; j++)
                row[(size_t)n + j] -= row[i] * a[(size_t)i * width + (size_t)n + j];
        for (size_t j = 0; j < TANGENTS; j++) row[(size_t)n + j] /= row[k];
    }
    return 1;
}

/* Derivatives of the solution of one program. `a`: memory for the system. */
static void differentiate(const Qp *qp, lanes *data, lanes *solution, double *a) {
    const int n = qp->n, m = qp->m;
    lanes *const q = data, *const lower = q + n, *const upper = lower + m, *const z = solution, *const y = z + n;
    const QpCase *const c = qp_case(qp, data[n + 2 * m].v);
    int active = 0;
    for (int i = 0; i < m; i++) active += y[i].v != 0.0;
    const int size = n + active;
    const size_t width = (size_t)size + TANGENTS;
    int solved = solution[n + m].v == QP_SOLVED && active <= n;
    if (solved) {
        memset(a, 0, (size_t)size * width * sizeof *a);
        for (int j = 0; j < n; j++) {
            double *const row = a + (size_t)j * width;
            memcpy(row, c->hessian + (size_t)j * (size_t)n, (size_t)n * sizeof *row);
            for (int k = 0; k < TANGENTS; k++) row[size + k] = -directions(&q[j])[k];
        }
        for (int i = 0, r = n; i < m; i++) {
            if (y[i].v == 0.0) continue;
            double *const row = a + (size_t)r * width;
            lanes *const bound = y[i].v > 0.0 ? &upper[i] : &lower[i];
            for (int j = 0; j < n; j++)
                row[j] = a[(size_t)j * width + (size_t)r] = c->constraints[(size_t)i * (size_t)n + (size_t)j];
            for (int k = 0; k < TANGENTS; k++) row[size + k] = directions(bound)[k];
            r++;
        }
        solved = eliminate(a, size);
    }
    for (int j = 0, r = n; j < n + m; j++) {
        const int there = j < n || y[j - n].v != 0.0;
        const double *const row = a + (size_t)(j < n ? j : r) * width + size;
        for (int k = 0; k < TANGENTS; k++) directions(&solution[j])[k] = !there ? 0.0 : solved ? row[k] : NAN;
        r += j >= n && there;
    }
}

/* Values and derivatives of all programs. `memory`: their warm starts, which receive the next ones; `kept`: the last
 * solutions that were found, as a program without one gives them again; `trial`: nothing is kept. */
static void solve_programs(
    lanes *data, lanes *solution, double *memory, lanes *kept, int trial, char *scratch) {
    double values[N_QP_DATA], found[N_QP_SOLUTION], *const a = (double *)(void *)(scratch + qp_aligned(
        fmu_qp_functions.scratch_size()));
    for (int i = 0; i < N_QP_DATA; i++) values[i] = data[i].v;
    fmu_qp_functions.solve(scratch, memory, values, found);
    for (int i = 0; i < N_QP_SOLUTION; i++) solution[i] = lanes_all(found[i]);
    for (int k = 0; k < qp_count; k++) {
        const Qp *const qp = &qp_list[k];
        const int size = qp->n + 2 * qp->m + 1, results = qp->n + qp->m + 3;
        const double status = solution[qp->n + qp->m].v;
        int moves = 0;
        for (int i = 0; i < size && !moves; i++) moves = depends(data[i]);
        if (status == QP_SOLVED || status == QP_LIMIT_REACHED) {
            if (moves) {
                for (int i = 0; i < qp->m; i++) {
                    const double y = solution[qp->n + i].v;
                    take_side((uint64_t)((y > 0.0) - (y < 0.0) + 1));
                }
                differentiate(qp, data, solution, a);
            }
            if (status == QP_SOLVED && !trial) memcpy(kept, solution, (size_t)qp->n * sizeof *kept);
        } else {
            memcpy(solution, kept, (size_t)qp->n * sizeof *kept);
        }
        data += size;
        solution += results;
        kept += results;
    }
}
