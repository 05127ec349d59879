/* Stability of a fixed-step solver at operating points: eigenvalues and amplification factors. */

#include "stability.h"

#include <float.h>
#include <string.h>

#include "fmu_math.h"

#define SLACK 1e-6     /* by which a factor may exceed what it must not */
#define SHORTER 1.25   /* ratio of the steps that are tried */
#define MOST_SWEEPS 60 /* of the QR iteration for one eigenvalue */

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }

static size_t n_matrices(FmuSolver method) { return method == FMU_SEMI_IMPLICIT ? 3 : 2; }

static int n_tried(FmuSolver method, int n) {
    return method == FMU_SEMI_IMPLICIT ? n : 2;
} /* states of a step that is tried */

static size_t matrices_size(FmuSolver method, int n) {
    const size_t side = (size_t)n;
    return aligned((n_matrices(method) * side + 2) * side * sizeof(double));
}

size_t stability_memory(FmuSolver method, int n) {
    return matrices_size(method, n) + integrator_memory(method, n_tried(method, n));
}

void stability_use(Stability *self, void *memory) {
    const size_t n = (size_t)self->n;
    double *at = memory;
    self->real = at;
    self->imag = at + n;
    self->matrix = at + 2 * n;
    self->scratch = self->matrix + n * n;
    self->step_matrix = n_matrices(self->method) == 3 ? self->scratch + n * n : NULL;
    self->solver =
        (Integrator){.method = self->method, .n = n_tried(self->method, self->n), .velocity_of = self->velocity_of};
    integrator_use(&self->solver, (char *)memory + matrices_size(self->method, self->n));
}

/* ------------------------------------------------------------------ eigenvalues */

#define A(i, j) a[(size_t)(j) * (size_t)n + (size_t)(i)]

static double magnitude(double re, double im) { return sqrt(re * re + im * im); }

static void exchange(double *a, int n, int k, int m) {
    if (k == m) return;
    for (int j = 0; j < n; j++) {
        const double x = A(k, j);
        A(k, j) = A(m, j);
        A(m, j) = x;
    }
    for (int i = 0; i < n; i++) {
        const double x = A(i, k);
        A(i, k) = A(i, m);
        A(i, m) = x;
    }
}

/* Order states so that those which nothing drives come last and those which drive nothing come first, as often as there
 * is one: the diagonal there is eigenvalues, exactly, however many of them are equal. Left are rows and columns low ..
 * high. */
static void isolate(double *a, int n, int *low, int *high) {
    *low = 0;
    *high = n - 1;
    for (int found = 1; found;) {
        found = 0;
        for (int k = *high; k >= *low && !found; k--) {
            int drives = 0, driven = 0;
            for (int j = *low; j <= *high; j++) {
                driven |= j != k && A(k, j) != 0.0;
                drives |= j != k && A(j, k) != 0.0;
            }
            found = !driven || !drives;
            if (found) exchange(a, n, k, driven ? (*low)++ : (*high)--);
        }
    }
}

/* Scale rows and columns by powers of two until they have similar sizes (Parlett and Reinsch 1969): units no longer
 * matter. */
static void balance(double *a, int n, int low, int high) {
    for (int done = 0; !done;) {
        done = 1;
        for (int i = low; i <= high; i++) {
            double row = 0.0, column = 0.0, f = 1.0;
            for (int j = low; j <= high; j++) {
                if (j == i) continue;
                row += fabs(A(i, j));
                column += fabs(A(j, i));
            }
            if (row == 0.0 || column == 0.0) continue;
            const double before = row + column;
            for (; column < row / 2.0; column *= 4.0) f *= 2.0;
            for (; column >= row * 2.0; column /= 4.0) f /= 2.0;
            if ((column + row) / f >= 0.95 * before) continue;
            done = 0;
            for (int j = low; j <= high; j++) A(i, j) /= f;
            for (int j = low; j <= high; j++) A(j, i) *= f;
        }
    }
}

/* Reduce to upper Hessenberg form by eliminations with row exchanges; what is below the first subdiagonal becomes 0. */
static void to_hessenberg(double *a, int n, int low, int high) {
    for (int m = low + 1; m < high; m++) {
        int best = m;
        for (int i = m + 1; i <= high; i++)
            if (fabs(A(i, m - 1)) > fabs(A(best, m - 1))) best = i;
        exchange(a, n, m, best);
        const double pivot = A(m, m - 1);
        if (pivot == 0.0) continue;
        double *factor = &A(0, m - 1), *target = &A(0, m);
        for (int i = m + 1; i <= high; i++) factor[i] /= pivot;
        for (int j = m; j <= high; j++) {
            double *column = &A(0, j);
            const double top = column[m];
            if (top == 0.0) continue;
            for (int i = m + 1; i <= high; i++) column[i] -= factor[i] * top;
        }
        for (int i = m + 1; i <= high; i++) {
            const double *column = &A(0, i), f = factor[i];
            if (f == 0.0) continue;
            for (int j = low; j <= high; j++) target[j] += f * column[j];
        }
        for (int i = m + 1; i <= high; i++) factor[i] = 0.0;
    }
}

/* Eigenvalues of the 2 x 2 block that begins at row and column k. */
static void pair(const double *a, int n, int k, double *real, double *imag) {
    const double p = 0.5 * (A(k, k) - A(k + 1, k + 1)), bc = A(k, k + 1) * A(k + 1, k);
    const double mean = A(k + 1, k + 1) + p, square = p * p + bc, root = sqrt(fabs(square));
    real[k] = real[k + 1] = mean;
    imag[k] = imag[k + 1] = 0.0;
    if (square < 0.0) {
        imag[k] = root;
        imag[k + 1] = -root;
    } else {
        const double far = p + copysign(root, p); /* no cancellation: the other one follows from the product */
        real[k] = A(k + 1, k + 1) + far;
        real[k + 1] = far != 0.0 ? A(k + 1, k + 1) - bc / far : A(k + 1, k + 1);
    }
}

/* One implicit double-shift QR sweep (Francis 1961) over rows and columns low .. high. */
static void sweep(double *a, int n, int low, int high, int exceptional) {
    double s11 = A(high - 1, high - 1), s22 = A(high, high), s12s21 = A(high, high - 1) * A(high - 1, high);
    if (exceptional) { /* breaks cycles */
        const double s = fabs(A(high, high - 1)) + fabs(A(high - 1, high - 2));
        s11 = s22 = A(high, high) + 0.75 * s;
        s12s21 = -0.4375 * s * s;
    }
    /* The first column of (A - s1)(A - s2), begun below where two small elements allow it. */
    int first = high - 2;
    double p, q, r;
    for (;; first--) {
        const double z = A(first, first), d1 = s11 - z, d2 = s22 - z;
        p = (d1 * d2 - s12s21) / A(first + 1, first) + A(first, first + 1);
        q = A(first + 1, first + 1) - z - d1 - d2;
        r = A(first + 2, first + 1);
        const double size = fabs(p) + fabs(q) + fabs(r);
        p /= size;
        q /= size;
        r /= size;
        if (first == low) break;
        const double left = fabs(A(first, first - 1)) * (fabs(q) + fabs(r));
        if (left <= DBL_EPSILON * fabs(p) * (fabs(A(first - 1, first - 1)) + fabs(z) + fabs(A(first + 1, first + 1))))
            break;
    }
    for (int k = first; k < high; k++) { /* reflections of three rows and columns chase the bulge down */
        const int three = k < high - 1;
        double size = 1.0;
        if (k > first) {
            p = A(k, k - 1);
            q = A(k + 1, k - 1);
            r = three ? A(k + 2, k - 1) : 0.0;
            size = fabs(p) + fabs(q) + fabs(r);
            if (size == 0.0) continue;
            p /= size;
            q /= size;
            r /= size;
        }
        const double s = copysign(sqrt(p * p + q * q + r * r), p);
        if (s == 0.0) continue;
        if (k > first) {
            A(k, k - 1) = -s * size;
            A(k + 1, k - 1) = 0.0;
            if (three) A(k + 2, k - 1) = 0.0;
        } else if (first > low) {
            A(k, k - 1) = -A(k, k - 1);
        }
        p += s;
        const double x = p / s, y = q / s, z = r / s;
        q /= p;
        r /= p;
        if (three) {
            for (int j = k; j <= high; j++) {
                double *c = &A(k, j);
                const double sum = c[0] + q * c[1] + r * c[2];
                c[0] -= sum * x;
                c[1] -= sum * y;
                c[2] -= sum * z;
            }
        } else {
            for (int j = k; j <= high; j++) {
                double *c = &A(k, j);
                const double sum = c[0] + q * c[1];
                c[0] -= sum * x;
                c[1] -= sum * y;
            }
        }
        const int last = k + 3 < high ? k + 3 : high;
        double *c0 = &A(0, k), *c1 = &A(0, k + 1);
        if (three) {
            double *c2 = &A(0, k + 2);
            for (int i = low; i <= last; i++) {
                const double sum = x * c0[i] + y * c1[i] + z * c2[i];
                c0[i] -= sum;
                c1[i] -= sum * q;
                c2[i] -= sum * r;
            }
        } else {
            for (int i = low; i <= last; i++) {
                const double sum = x * c0[i] + y * c1[i];
                c0[i] -= sum;
                c1[i] -= sum * q;
            }
        }
    }
}

int stability_eigenvalues(double *a, int n, double *real, double *imag) {
    double norm = 0.0;
    for (int i = 0; i < n * n; i++) norm += fabs(a[i]);
    if (!isfinite(norm)) return 0;
    int first, last, sweeps = 0;
    isolate(a, n, &first, &last);
    for (int i = 0; i < n; i++) {
        real[i] = A(i, i);
        imag[i] = 0.0;
    }
    balance(a, n, first, last);
    to_hessenberg(a, n, first, last);
    for (int high = last; high >= first;) {
        int low = high;
        for (; low > first; low--) {
            const double beside = fabs(A(low - 1, low - 1)) + fabs(A(low, low));
            if (fabs(A(low, low - 1)) <= DBL_EPSILON * (beside == 0.0 ? norm : beside)) {
                A(low, low - 1) = 0.0;
                break;
            }
        }
        if (low >= high - 1) {
            if (low == high) {
                real[high] = A(high, high);
            } else {
                pair(a, n, low, real, imag);
            }
            high = low - 1;
            sweeps = 0;
            continue;
        }
        if (++sweeps > MOST_SWEEPS) return 0;
        sweep(a, n, low, high, sweeps % 10 == 0);
    }
    return 1;
}

#undef A

/* ------------------------------------------------------------------ amplification */

typedef struct {
    double re, im;
} Complex;

static Complex times(Complex a, Complex b) { return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
static double size_of(Complex a) { return magnitude(a.re, a.im); }

static Complex root_of(Complex a) {
    const double m = size_of(a), half = sqrt(0.5 * (m + fabs(a.re)));
    if (half == 0.0) return (Complex){0.0, 0.0};
    const double other = 0.5 * a.im / half;
    return a.re >= 0.0 ? (Complex){half, other} : (Complex){fabs(other), copysign(half, a.im)};
}

/* dx/dt = lambda x for a complex x of two real states. */
static void one_mode(void *lambda, double t, const double *x, double *dx) {
    const Complex l = *(const Complex *)lambda;
    (void)t;
    dx[0] = l.re * x[0] - l.im * x[1];
    dx[1] = l.im * x[0] + l.re * x[1];
}

static void one_mode_jacobian(void *lambda, double t, const double *x, double *J, double *by_time) {
    const Complex l = *(const Complex *)lambda;
    (void)t;
    (void)x;
    J[0] = J[3] = l.re;
    J[1] = l.im;
    J[2] = -l.im;
    by_time[0] = by_time[1] = 0.0;
}

/* What one step of the solver makes of x; not finite where it has none. */
static Complex stepped(Integrator *solver, double h, int first, double start) {
    double x[2] = {start, 0.0};
    return integrator_step(solver, 0.0, h, first, x) == 2 ? (Complex){x[0], x[1]} : (Complex){HUGE_VAL, 0.0};
}

/* Largest modulus of the solver's amplification factors for one step: what it makes of x = 1. */
static double amplification(Integrator *solver, double h, Complex lambda) {
    static const double units[2] = {1.0, 1.0};
    solver->system = &lambda;
    solver->rhs = one_mode;
    solver->jacobian = one_mode_jacobian;
    solver->nominals = units;
    const double first = size_of(stepped(solver, h, 1, 1.0));
    if (solver->method != FMU_AM2) return first;
    /* Later steps of am2 make b x + c x_before of two states in a row: from x = 0 after 1, and from x = 1 after 0. */
    const Complex c = stepped(solver, h, 0, 0.0), b = stepped(solver, h, 0, 1.0);
    const Complex half = {0.5 * b.re, 0.5 * b.im}, square = times(half, half); /* r^2 = b r + c */
    const Complex root = root_of((Complex){square.re + c.re, square.im + c.im});
    const double one = magnitude(half.re + root.re, half.im + root.im),
                 other = magnitude(half.re - root.re, half.im - root.im);
    return fmax(first, fmax(one, other));
}

/* dx/dt = A x with the matrix at hand. */
static void all_modes(void *system, double t, const double *x, double *dx) {
    const Stability *self = system;
    const double *column = self->matrix;
    (void)t;
    for (int i = 0; i < self->n; i++) dx[i] = 0.0;
    for (int j = 0; j < self->n; j++, column += self->n) {
        if (x[j] == 0.0) continue;
        for (int i = 0; i < self->n; i++) dx[i] += column[i] * x[j];
    }
}

/* One step of semi_implicit as a matrix, column by column: it has no factor for each mode. */
static void fill_step_matrix(Stability *self, double h) {
    self->solver.system = self;
    self->solver.rhs = all_modes;
    for (int j = 0; j < self->n; j++) {
        double *column = self->step_matrix + (size_t)j * (size_t)self->n;
        for (int i = 0; i < self->n; i++) column[i] = i == j ? 1.0 : 0.0;
        integrator_step(&self->solver, 0.0, h, 1, column);
    }
}

/* Eigenvalues of the matrix at hand; whether the solver follows all of them with this step, and else the largest that
 * it cannot follow (semi_implicit, which has no factor for each: the largest of all). Returns -1 when there are none.
 */
static int suits(Stability *self, double h, Instability *wrong) {
    const int n = self->n;
    const size_t bytes = (size_t)n * (size_t)n * sizeof(double);
    memcpy(self->scratch, self->matrix, bytes);
    if (!stability_eigenvalues(self->scratch, n, self->real, self->imag)) return -1;
    double largest = -1.0, growth = 0.0;
    for (int i = 0; i < n; i++) {
        const double re = self->real[i], im = self->imag[i], size = magnitude(re, im);
        growth = fmax(growth, re);
        if (self->method != FMU_SEMI_IMPLICIT) {
            /* ros2 grows a little faster than the truth where the truth grows. */
            const double truth = re > 0.0 ? exp((self->method == FMU_ROS2 ? 1.1 : 1.0) * re * h) : 1.0;
            if (amplification(&self->solver, h, (Complex){re, im}) <= truth + SLACK) continue;
        }
        if (size <= largest) continue;
        largest = size;
        wrong->real = re;
        wrong->imag = fabs(im);
    }
    if (self->method != FMU_SEMI_IMPLICIT) return largest < 0.0;
    fill_step_matrix(self, h);
    if (!stability_eigenvalues(self->step_matrix, n, self->real, self->imag)) return -1;
    double radius = 0.0;
    for (int i = 0; i < n; i++) radius = fmax(radius, magnitude(self->real[i], self->imag[i]));
    return radius <= exp(growth * h) + SLACK;
}

/* Whether all points are stable, and else the worst. */
static int all_suit(Stability *self, double h, Instability *wrong) {
    int good = 1;
    for (int point = 0; point < self->n_points; point++) {
        Instability here = {point, 1, 0.0, 0.0, 0.0};
        if (!self->linearize(self->system, point, self->matrix)) continue;
        const int verdict = suits(self, h, &here);
        if (verdict > 0) continue;
        here.found = verdict == 0;
        if (good || !here.found ||
            (wrong->found && magnitude(here.real, here.imag) > magnitude(wrong->real, wrong->imag)))
            *wrong = here;
        good = 0;
    }
    return good;
}

int stability_check(Stability *self, double step, double shortest, Instability *wrong) {
    if (all_suit(self, step, wrong)) return 1;
    Instability other;
    if (wrong->found)
        for (double h = step / SHORTER; h >= shortest; h /= SHORTER)
            if (all_suit(self, h, &other)) {
                wrong->step = h;
                return 0;
            }
    return 0;
}
