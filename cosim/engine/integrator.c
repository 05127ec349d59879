/* Integrates a Model Exchange FMU: see integrator.h. */
#include "integrator.h"

#include "environment.h"

#include <float.h>
#include <stdio.h>
#include <string.h>

#if defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract(off)
#elif defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off")
#endif

enum { OK, WARNING, DISCARD, ERROR }; /* statuses of FMI */
enum { /* limits */
    UPDATES = 1000,
    EVENTS = 10000,
    STEPS = 1000000,
    STIFF = 15,
    NOT_STIFF = 6,
    ROOTS = 200,
    LARGEST_AUTO = 2000,
    LARGEST_IMPLICIT = 5000
};

static double size_of(double a) { return a < 0.0 ? -a : a; }
static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }
static bool finite_number(double a) { return a - a == 0.0; }

/* Times that are closer are the same: they differ by rounding. */
static double resolution(double t, double h) { return 4.0 * DBL_EPSILON * larger(size_of(t), size_of(h)); }

/* ------------------------------------------------------------------ calls of the FMU */

static uint32_t failed(Integrator *s, IntegratorEnd end, uint32_t index, double t, uint32_t status) {
    s->report.end = end;
    s->report.index = index;
    s->report.status = status;
    s->report.time = t;
    return status > WARNING ? status : ERROR;
}

#define CALL(number, parameters, ...) ((uint32_t (*) parameters)s->call[number])(s->instance, __VA_ARGS__)
#define TRY(number, expression)                                                                     \
    do {                                                                                            \
        const uint32_t status_ = (expression);                                                      \
        if (status_ > WARNING) return failed(s, INTEGRATOR_CALL_FAILED, number, s->memory.time, status_); \
    } while (0)
#define PASS(expression)                      \
    do {                                      \
        const uint32_t passed_ = (expression); \
        if (passed_ > WARNING) return passed_; \
    } while (0)

/* Before arithmetic that follows calls. */
static void called(Integrator *s) {
    if (s->setup.foreign) environment_after_call(s->environment);
}

static uint32_t array(Integrator *s, IntegratorFunction number, double *values, uint32_t n) {
    if (n) TRY(number, CALL(number, (void *, double *, size_t), values, n));
    return OK;
}

static uint32_t plain(Integrator *s, IntegratorFunction number) {
    TRY(number, ((uint32_t(*)(void *))s->call[number])(s->instance));
    return OK;
}

/* Time and states. A call follows, or `called`. */
static uint32_t place(Integrator *s, double t, double *x) {
    TRY(INTEGRATOR_SET_TIME, CALL(INTEGRATOR_SET_TIME, (void *, double), t));
    return array(s, INTEGRATOR_SET_STATES, x, s->setup.n);
}

/* Derivatives at a point. Discard if they do not exist there: a shorter step may avoid it. */
static uint32_t derivatives(Integrator *s, double t, double *x, double *f) {
    PASS(place(s, t, x));
    PASS(array(s, INTEGRATOR_GET_DERIVATIVES, f, s->setup.n));
    called(s);
    s->report.evaluations++;
    for (uint32_t i = 0; i < s->setup.n; i++)
        if (!finite_number(f[i])) return failed(s, INTEGRATOR_BAD_DERIVATIVE, i, t, DISCARD);
    return OK;
}

static uint32_t indicators(Integrator *s, double t, double *z) {
    PASS(array(s, INTEGRATOR_GET_INDICATORS, z, s->setup.n_indicators));
    called(s); /* also after the calls of `place`, where the FMU has no indicators */
    for (uint32_t i = 0; i < s->setup.n_indicators; i++)
        if (!finite_number(z[i])) return failed(s, INTEGRATOR_BAD_INDICATOR, i, t, ERROR);
    return OK;
}

static uint32_t completed(Integrator *s, bool *event) {
    if (!s->setup.completed) return OK;
    bool enter = false, terminate = false;
    if (s->setup.version == 2) {
        int enter2 = 0, terminate2 = 0;
        TRY(INTEGRATOR_COMPLETED,
            CALL(INTEGRATOR_COMPLETED, (void *, int, int *, int *), s->no_set_prior, &enter2, &terminate2));
        enter = enter2 != 0, terminate = terminate2 != 0;
    } else {
        TRY(INTEGRATOR_COMPLETED,
            CALL(INTEGRATOR_COMPLETED, (void *, bool, bool *, bool *), s->no_set_prior, &enter, &terminate));
    }
    if (terminate) return failed(s, INTEGRATOR_TERMINATED, 0, s->memory.time, DISCARD);
    *event |= enter;
    called(s);
    return OK;
}

typedef struct {
    int again, terminate, nominals, states, next_event_defined;
    double next_event;
} EventInfo2;

/* Event iteration: discrete states are updated until they stay. `nominals`: those of the states are to be read. */
static uint32_t update(Integrator *s, bool nominals) {
    const double t = s->memory.time;
    for (int i = 0; i < UPDATES; i++) {
        bool flag[5] = {false, false, false, false, false};
        double next = 0.0;
        if (s->setup.version == 2) {
            EventInfo2 info = {0, 0, 0, 0, 0, 0.0};
            TRY(INTEGRATOR_UPDATE, CALL(INTEGRATOR_UPDATE, (void *, EventInfo2 *), &info));
            flag[0] = info.again != 0, flag[1] = info.terminate != 0, flag[2] = info.nominals != 0;
            flag[4] = info.next_event_defined != 0, next = info.next_event;
        } else {
            TRY(INTEGRATOR_UPDATE, CALL(INTEGRATOR_UPDATE, (void *, bool *, bool *, bool *, bool *, bool *, double *),
                &flag[0], &flag[1], &flag[2], &flag[3], &flag[4], &next));
        }
        s->memory.ends |= flag[1];
        if (flag[1]) return failed(s, INTEGRATOR_TERMINATED, 0, t, DISCARD);
        called(s);
        nominals |= flag[2];
        if (flag[0]) continue;
        if (flag[4] && next != next) return failed(s, INTEGRATOR_BAD_EVENT, 0, t, ERROR);
        s->next_event = flag[4] ? smaller(next, DBL_MAX) : DBL_MAX;
        if (nominals) {
            PASS(array(s, INTEGRATOR_GET_NOMINALS, s->nominal, s->setup.n));
            called(s);
            for (uint32_t k = 0; k < s->setup.n; k++) {
                s->nominal[k] = size_of(s->nominal[k]);
                if (!finite_number(s->nominal[k]) || s->nominal[k] == 0.0) s->nominal[k] = 1.0;
            }
        }
        return OK;
    }
    return failed(s, INTEGRATOR_NOT_CONVERGED, 0, t, ERROR);
}

/* An FMU with other numbers of states or event indicators would read and write beyond its vectors. */
static uint32_t check_counts(Integrator *s) {
    const size_t listed[2] = {s->setup.n, s->setup.n_indicators};
    for (uint32_t i = 0; i < 2; i++) {
        const uint32_t number = INTEGRATOR_COUNT_STATES + i;
        size_t found = listed[i];
        if (!s->call[number] || s->setup.version != 3) continue;
        const uint32_t status = CALL(number, (void *, size_t *), &found);
        if (status > ERROR) return failed(s, INTEGRATOR_CALL_FAILED, number, s->memory.time, status);
        if (status > WARNING || found == listed[i]) continue;
        s->report.found = found < UINT32_MAX ? (uint32_t)found : UINT32_MAX;
        return failed(s, INTEGRATOR_OTHER_COUNT, number, s->memory.time, ERROR);
    }
    return OK;
}

/* From event mode to continuous time at the present time. */
static uint32_t leave_events(Integrator *s) {
    PASS(plain(s, INTEGRATOR_ENTER_CONTINUOUS));
    PASS(array(s, INTEGRATOR_GET_STATES, s->x, s->setup.n));
    for (uint32_t i = 0; i < s->setup.n; i++)
        if (!finite_number(s->x[i])) return failed(s, INTEGRATOR_BAD_STATE, i, s->memory.time, ERROR);
    PASS(derivatives(s, s->memory.time, s->x, s->f));
    return indicators(s, s->memory.time, s->z);
}

/* ------------------------------------------------------------------ steps of both methods */

/* The largest error of a state in units of its tolerance; `worst` is that state. */
static double measure(Integrator *s, uint32_t *worst) {
    double largest = 0.0;
    *worst = 0;
    for (uint32_t i = 0; i < s->setup.n; i++) {
        const double scale = s->setup.tolerance * (s->nominal[i] + larger(size_of(s->x[i]), size_of(s->x1[i])));
        const double e = size_of(s->error[i]) / scale;
        if (!(e <= largest)) {
            largest = e;
            *worst = i;
            if (!finite_number(e)) break;
        }
    }
    return largest;
}

/* Dormand, Prince: A family of embedded Runge-Kutta formulae (1980), with the dense output of Hairer, Norsett, Wanner:
 * Solving Ordinary Differential Equations I (1993), II.6. The last stage is the derivative at the end. */
static uint32_t explicit_step(Integrator *s, double t, double h) {
    static const double c[6] = {0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0};
    static const double a[6][5] = {{0.0}, {0.2}, {3.0 / 40.0, 9.0 / 40.0}, {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
        {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
        {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0}};
    static const double b[6] = {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0};
    static const double e[7] = {71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0,
        -1.0 / 40.0};
    static const double d[7] = {-12715105075.0 / 11282082432.0, 0.0, 87487479700.0 / 32700410799.0,
        -10690763975.0 / 1880347072.0, 701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
        69997945.0 / 29380423.0};
    const uint32_t n = s->setup.n;
    double *const k[7] = {s->f, s->k[1], s->k[2], s->k[3], s->k[4], s->k[5], s->f1};
    for (int stage = 1; stage < 6; stage++) {
        for (uint32_t i = 0; i < n; i++) {
            double sum = 0.0;
            for (int j = 0; j < stage; j++) sum += a[stage][j] * k[j][i];
            s->trial[i] = s->x[i] + h * sum;
        }
        PASS(derivatives(s, t + c[stage] * h, s->trial, k[stage]));
    }
    for (uint32_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (int j = 0; j < 6; j++) sum += b[j] * k[j][i];
        s->x1[i] = s->x[i] + h * sum;
    }
    PASS(derivatives(s, t + h, s->x1, s->f1));
    double stiff = 0.0, apart = 0.0; /* of the last two stages, at the same time: how fast the fastest motion is */
    for (uint32_t i = 0; i < n; i++) {
        double error = 0.0, bend = 0.0;
        for (int j = 0; j < 7; j++) error += e[j] * k[j][i], bend += d[j] * k[j][i];
        s->error[i] = h * error;
        const double change = s->x1[i] - s->x[i], first = h * k[0][i] - change;
        s->dense[0][i] = s->x[i];
        s->dense[1][i] = change;
        s->dense[2][i] = first;
        s->dense[3][i] = change - h * s->f1[i] - first;
        s->dense[4][i] = h * bend;
        const double df = (s->f1[i] - k[5][i]) / s->nominal[i], dx = (s->x1[i] - s->trial[i]) / s->nominal[i];
        stiff += df * df;
        apart += dx * dx;
    }
    const double limit = 3.25 / h;
    if (stiff > limit * limit * apart) s->memory.stiff++, s->memory.not_stiff = 0;
    else if (s->memory.stiff && ++s->memory.not_stiff == NOT_STIFF) s->memory.stiff = 0;
    return OK;
}

/* LU decomposition with pivots, row by row; false: the matrix is singular. */
static bool decompose(double *m, uint32_t *pivot, uint32_t n) {
    for (uint32_t k = 0; k < n; k++) {
        uint32_t p = k;
        for (uint32_t i = k + 1; i < n; i++)
            if (size_of(m[i * n + k]) > size_of(m[p * n + k])) p = i;
        pivot[k] = p;
        if (m[p * n + k] == 0.0 || !finite_number(m[p * n + k])) return false;
        for (uint32_t j = 0; p != k && j < n; j++) {
            const double swapped = m[k * n + j];
            m[k * n + j] = m[p * n + j];
            m[p * n + j] = swapped;
        }
        for (uint32_t i = k + 1; i < n; i++) {
            const double factor = m[i * n + k] /= m[k * n + k];
            if (factor != 0.0)
                for (uint32_t j = k + 1; j < n; j++) m[i * n + j] -= factor * m[k * n + j];
        }
    }
    return true;
}

static void solve(const double *m, const uint32_t *pivot, uint32_t n, double *b) {
    for (uint32_t k = 0; k < n; k++) {
        const double swapped = b[k];
        b[k] = b[pivot[k]];
        b[pivot[k]] = swapped;
    }
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < i; j++) b[i] -= m[i * n + j] * b[j];
    for (uint32_t i = n; i-- > 0;) {
        for (uint32_t j = i + 1; j < n; j++) b[i] -= m[i * n + j] * b[j];
        b[i] /= m[i * n + i];
    }
}

/* Whether directional derivatives agree with differences along one direction: with others the implicit method would
 * need tiny steps. */
static uint32_t compare(Integrator *s, double t, const double *jacobian) {
    const uint32_t n = s->setup.n;
    for (uint32_t i = 0; i < n; i++) {
        s->seed[i] = 0x1p-20 * larger(size_of(s->x[i]), s->nominal[i]);
        s->trial[i] = s->x[i] + s->seed[i];
    }
    const uint32_t status = derivatives(s, t, s->trial, s->k[0]);
    if (status > DISCARD) return status;
    s->memory.directional = status > WARNING ? 0 : 1; /* where there are none the next step will tell */
    for (uint32_t i = 0; i < n; i++) {
        double sum = 0.0, all = 0.0;
        for (uint32_t j = 0; j < n; j++) {
            const double part = jacobian[i * n + j] * s->seed[j];
            sum += part, all += size_of(part);
        }
        const double difference = size_of(s->k[0][i] - s->f[i] - sum);
        const bool agrees = difference <= 0.01 * all + 1e-9 * size_of(s->f[i]) && finite_number(difference);
        if (status <= WARNING && !agrees) s->memory.directional = 2;
    }
    for (uint32_t i = 0; i < n; i++) s->seed[i] = 0.0;
    return OK;
}

/* Derivatives of the derivatives by the states, into `jacobian` row by row, and by the time, at the begin of a step. */
static uint32_t linearize(Integrator *s, double t, double *jacobian) {
    const uint32_t n = s->setup.n, m = s->setup.n_references;
    const double root = 0x1p-26; /* of the resolution of doubles */
    const double dt = root * larger(size_of(t), 1e-5);
    PASS(derivatives(s, t + dt, s->x, s->trial));
    for (uint32_t i = 0; i < n; i++) s->slope[i] = (s->trial[i] - s->f[i]) / dt;
    const bool directional = s->setup.directional && s->memory.directional < 2;
    if (directional) PASS(place(s, t, s->x));
    for (uint32_t j = 0; j < n; j++) {
        if (directional) {
            s->seed[j] = 1.0;
            const uint32_t status = s->setup.version == 2
                ? CALL(INTEGRATOR_DIRECTIONAL,
                      (void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, double *),
                      s->derivatives, m, s->states, m, s->seed, s->k[0])
                : CALL(INTEGRATOR_DIRECTIONAL, (void *, const uint32_t *, size_t, const uint32_t *, size_t,
                      const double *, size_t, double *, size_t), s->derivatives, m, s->states, m, s->seed,
                      n, s->k[0], n);
            s->seed[j] = 0.0;
            if (status > WARNING && status <= ERROR) {
                s->memory.directional = 2;
                return linearize(s, t, jacobian);
            }
            TRY(INTEGRATOR_DIRECTIONAL, status);
            called(s);
            for (uint32_t i = 0; i < n; i++) jacobian[i * n + j] = s->k[0][i];
            continue;
        }
        const double kept = s->x[j], moved = kept + root * larger(size_of(kept), s->nominal[j]);
        s->x[j] = moved;
        const uint32_t status = derivatives(s, t, s->x, s->k[0]);
        s->x[j] = kept;
        PASS(status);
        for (uint32_t i = 0; i < n; i++) jacobian[i * n + j] = (s->k[0][i] - s->f[i]) / (moved - kept);
    }
    if (!directional || s->memory.directional) return OK;
    PASS(compare(s, t, jacobian));
    return s->memory.directional == 2 ? linearize(s, t, jacobian) : OK;
}

/* RODAS of Hairer, Wanner: Solving Ordinary Differential Equations II (1996), IV.7; coefficients of their code. */
static uint32_t implicit_step(Integrator *s, double t, double h) {
    static const double a[6][5] = {{0.0}, {0.1544000000000000e+01}, {0.9466785280815826, 0.2557011698983284},
        {0.3314825187068521e+01, 0.2896124015972201e+01, 0.9986419139977817},
        {0.1221224509226641e+01, 0.6019134481288629e+01, 0.1253708332932087e+02, -0.6878860361058950},
        {0.1221224509226641e+01, 0.6019134481288629e+01, 0.1253708332932087e+02, -0.6878860361058950, 1.0}};
    static const double c[6][5] = {{0.0}, {-0.56688e+01}, {-0.2430093356833875e+01, -0.2063599157091915},
        {-0.1073529058151375, -0.9594562251023355e+01, -0.2047028614809616e+02},
        {0.7496443313967647e+01, -0.1024680431464352e+02, -0.3399990352819905e+02, 0.1170890893206160e+02},
        {0.8083246795921522e+01, -0.7981132988064893e+01, -0.3152159432874371e+02, 0.1631930543123136e+02,
            -0.6058818238834054e+01}};
    static const double at[6] = {0.0, 0.386, 0.21, 0.63, 1.0, 1.0};
    static const double by_time[6] = {0.25, -0.1043, 0.1035, -0.3620000000000023e-01, 0.0, 0.0};
    static const double d[2][5] = {{0.1012623508344586e+02, -0.7487995877610167e+01, -0.3480091861555747e+02,
                                       -0.7992771707568823e+01, 0.1025137723295662e+01},
        {-0.6762803392801253, 0.6087714651680015e+01, 0.1643084320892478e+02, 0.2476722511418386e+02,
            -0.6594389125716872e+01}};
    const uint32_t n = s->setup.n;
    double *const jacobian = s->matrix, *const m = s->matrix + (size_t)n * n;
    if (!s->linearized) PASS(linearize(s, t, jacobian));
    s->linearized = true; /* a rejected step is repeated with the same derivatives */
    for (size_t i = 0; i < (size_t)n * n; i++) m[i] = -jacobian[i];
    for (uint32_t i = 0; i < n; i++) m[i * n + i] += 4.0 / h;
    if (!decompose(m, s->pivot, n)) return failed(s, INTEGRATOR_TOO_SMALL, 0, t, DISCARD);
    for (int stage = 0; stage < 6; stage++) {
        const double *f = s->f;
        if (stage) {
            for (uint32_t i = 0; i < n; i++) {
                s->trial[i] = s->x[i];
                for (int j = 0; j < stage; j++) s->trial[i] += a[stage][j] * s->k[j][i];
            }
            PASS(derivatives(s, t + at[stage] * h, s->trial, s->f1));
            f = s->f1;
        }
        for (uint32_t i = 0; i < n; i++) {
            double sum = 0.0;
            for (int j = 0; j < stage; j++) sum += c[stage][j] * s->k[j][i];
            s->k[stage][i] = f[i] + sum / h + h * by_time[stage] * s->slope[i];
        }
        solve(m, s->pivot, n, s->k[stage]);
    }
    for (uint32_t i = 0; i < n; i++) {
        s->error[i] = s->k[5][i];
        s->x1[i] = s->trial[i] + s->k[5][i];
        s->dense[0][i] = s->x[i];
        s->dense[1][i] = s->x1[i];
        s->dense[2][i] = s->dense[3][i] = 0.0;
        for (int j = 0; j < 5; j++) {
            s->dense[2][i] += d[0][j] * s->k[j][i];
            s->dense[3][i] += d[1][j] * s->k[j][i];
        }
    }
    return derivatives(s, t + h, s->x1, s->f1);
}

/* The states within the last step, at the part p of it. */
static void interpolate(const Integrator *s, bool implicit, double p, double *x) {
    const double q = 1.0 - p;
    double *const *d = s->dense;
    for (uint32_t i = 0; i < s->setup.n; i++)
        x[i] = implicit ? d[0][i] * q + p * (d[1][i] + q * (d[2][i] + p * d[3][i]))
                        : d[0][i] + p * (d[1][i] + q * (d[2][i] + p * (d[3][i] + q * d[4][i])));
}

/* ------------------------------------------------------------------ events */

/* The standard's domains: an event happens where an indicator changes between z > 0 and z <= 0. */
static bool crossed(double before, double after) { return (before > 0.0) != (after > 0.0); }

/* Of the part from z before to z after, where a straight line makes the first of the indicators that changed zero. */
static bool first_crossing(const Integrator *s, const double *before, const double *after, double *part) {
    bool found = false;
    *part = 1.0;
    for (uint32_t i = 0; i < s->setup.n_indicators; i++) {
        if (!crossed(s->z[i], after[i])) continue;
        found = true;
        const double a = size_of(before[i]), b = size_of(after[i]);
        *part = smaller(*part, a + b > 0.0 ? a / (a + b) : 0.5);
    }
    return found;
}

/* The first state event within the step from t to t + h, at whose end the indicators are z1: `part` of the step after
 * which it has just happened, to the resolution of the time, by the method of Oliveira and Takahashi (2020). Then x1,
 * z1 and the FMU are there. */
static uint32_t locate(Integrator *s, bool implicit, double t, double h, double *part) {
    const uint32_t n = s->setup.n_indicators;
    const double narrow = resolution(t, h) / h;
    double a = 0.0, b = 1.0, line, *before = s->z1 + n, *now = s->z1 + 2 * (size_t)n, allowed = 1.0;
    memcpy(before, s->z, n * sizeof *before);
    for (int k = 0; k < ROOTS && b - a > narrow; k++, allowed *= 0.5) {
        first_crossing(s, before, s->z1, &line);
        const double middle = 0.5 * (a + b), from = a + line * (b - a);
        const double toward = 0.1 * (b - a) * (b - a) + 0.25 * narrow, radius = larger(allowed - 0.5 * (b - a), 0.0);
        double p = size_of(middle - from) <= toward ? middle : from + (middle > from ? toward : -toward);
        if (size_of(p - middle) > radius) p = middle + (p > middle ? radius : -radius);
        if (!(p > a && p < b)) p = middle;
        if (!(p > a && p < b)) break;
        interpolate(s, implicit, p, s->trial);
        PASS(place(s, t + p * h, s->trial));
        PASS(indicators(s, t + p * h, now));
        double unused;
        if (first_crossing(s, before, now, &unused)) b = p, memcpy(s->z1, now, n * sizeof *now);
        else a = p, memcpy(before, now, n * sizeof *now);
    }
    *part = b;
    if (b < 1.0) interpolate(s, implicit, b, s->x1);
    const uint32_t status = place(s, b < 1.0 ? t + b * h : t + h, s->x1);
    called(s);
    return status;
}

/* ------------------------------------------------------------------ steps */

/* The n-th root of a number within the limits of a change of the step size, without a library. */
static double root_of(double a, int n) {
    double y = 1.0;
    for (int i = 0; i < 60; i++) {
        double power = 1.0;
        for (int j = 1; j < n; j++) power *= y;
        const double next = ((n - 1) * y + a / power) / n;
        if (size_of(next - y) <= 1e-9 * y) break;
        y = next;
    }
    return y;
}

/* A first step size: Hairer, Norsett, Wanner, II.4, without its second part. */
static double first_step(const Integrator *s, double h) {
    double x = 0.0, f = 0.0;
    for (uint32_t i = 0; i < s->setup.n; i++) {
        const double scale = s->nominal[i] + size_of(s->x[i]);
        x = larger(x, size_of(s->x[i]) / scale);
        f = larger(f, size_of(s->f[i]) / scale);
    }
    return f > 0.0 ? smaller(h, 0.01 * larger(x, 1e-3) / f) : h;
}

/* One accepted step from the present time toward `stop`: into x1, f1; `h` is its length. */
static uint32_t one_step(Integrator *s, double stop, double *length, bool *was_implicit) {
    IntegratorMemory *const m = &s->memory;
    const double t = m->time, smallest = larger(resolution(t, 0.0), 1e-14 * (stop - t));
    bool rejected = false;
    s->linearized = false;
    if (!s->setup.n) { /* nothing but time */
        *length = stop - t;
        *was_implicit = false;
        s->report.steps++;
        return place(s, stop, s->x1);
    }
    if (!(m->h > 0.0)) m->h = first_step(s, stop - t);
    for (;;) {
        const double left = stop - t;
        const bool last = m->h >= left / 1.01;
        const double h = last ? left : m->h;
        const bool implicit = m->implicit != 0;
        const uint32_t status = implicit ? implicit_step(s, t, h) : explicit_step(s, t, h);
        if (status > DISCARD) return status;
        uint32_t worst = s->report.index;
        const double error = status > WARNING ? DBL_MAX : measure(s, &worst);
        const bool forced = status <= WARNING && finite_number(error) && left <= smallest;
        if (error <= 1.0 || forced) {
            const double small = implicit ? 1e-4 : 1e-5; /* of which the roots are 0.1 */
            double factor = 0.9 / root_of(larger(error, small), implicit ? 4 : 5);
            if (rejected) factor = smaller(factor, 1.0);
            if (!last || h * factor > m->h) m->h = forced ? m->h : h * larger(factor, 0.2);
            s->report.steps++;
            s->report.end = INTEGRATOR_FINE;
            *length = h;
            *was_implicit = implicit;
            if (s->setup.method == INTEGRATOR_AUTO && s->setup.n <= LARGEST_AUTO && m->stiff >= STIFF) m->implicit = 1;
            return OK;
        }
        s->report.rejected++;
        rejected = true;
        const double factor = error < 1e5 ? 0.9 / root_of(error, implicit ? 4 : 5) : 0.1;
        m->h = h * larger(factor, 0.1);
        if (m->h < smallest) {
            m->h = 0.0;
            return status > WARNING ? status : failed(s, INTEGRATOR_TOO_SMALL, worst, t, ERROR);
        }
    }
}

/* From the present time, in continuous time, to `stop` or to the first event. */
static uint32_t integrate(Integrator *s, double stop, uint64_t *steps, bool *event) {
    IntegratorMemory *const m = &s->memory;
    while (m->time < stop && !*event) {
        double h = 0.0, part = 1.0;
        bool implicit = false;
        if (++*steps > STEPS) return failed(s, INTEGRATOR_TOO_MANY_STEPS, 0, m->time, ERROR);
        PASS(one_step(s, stop, &h, &implicit));
        PASS(indicators(s, m->time + h, s->z1));
        double line;
        if (first_crossing(s, s->z, s->z1, &line)) {
            PASS(locate(s, implicit, m->time, h, &part));
            *event = true;
        }
        m->time = part < 1.0 ? m->time + part * h : h == stop - m->time ? stop : m->time + h;
        double *const x = s->x, *const f = s->f, *const z = s->z;
        s->x = s->x1, s->x1 = x;
        s->f = s->f1, s->f1 = f;
        memcpy(z, s->z1, s->setup.n_indicators * sizeof *z);
        PASS(completed(s, event));
    }
    return OK;
}

/* A step from event mode at the present time to event mode at `end`. */
static uint32_t advance(Integrator *s, double end, double h) {
    IntegratorMemory *const m = &s->memory;
    uint64_t steps = 0;
    PASS(update(s, true)); /* a restored state may have other nominals */
    for (int events = 0; events < EVENTS; events++) {
        bool event = s->next_event <= m->time;
        if (!event && m->time < end) {
            const bool timed = s->next_event <= end + resolution(end, h);
            PASS(leave_events(s));
            PASS(integrate(s, timed ? s->next_event : end, &steps, &event));
            PASS(plain(s, INTEGRATOR_ENTER_EVENTS));
            called(s);
            event |= timed && m->time >= s->next_event;
        }
        if (!event && m->time >= end) return OK;
        s->report.events += event;
        PASS(update(s, false));
        if (m->time >= end && !(s->next_event <= m->time)) return OK;
    }
    return failed(s, INTEGRATOR_TOO_MANY_EVENTS, 0, m->time, ERROR);
}

/* ------------------------------------------------------------------ what others call */

const char *integrator_function(uint32_t version, uint32_t number) {
    static const char *const names[2][INTEGRATOR_FUNCTIONS] = {
        {"SetTime", "SetContinuousStates", "GetContinuousStates", "GetDerivatives", "GetEventIndicators",
            "GetNominalsOfContinuousStates", "EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode",
            "CompletedIntegratorStep", "GetDirectionalDerivative"},
        {"SetTime", "SetContinuousStates", "GetContinuousStates", "GetContinuousStateDerivatives",
            "GetEventIndicators", "GetNominalsOfContinuousStates", "EnterEventMode", "UpdateDiscreteStates",
            "EnterContinuousTimeMode", "CompletedIntegratorStep", "GetDirectionalDerivative",
            "GetNumberOfContinuousStates", "GetNumberOfEventIndicators"}};
    return number < INTEGRATOR_FUNCTIONS ? names[version == 3][number] : NULL;
}

void integrator_why(const IntegratorSetup *setup, const IntegratorReport *report, const char *state, char *text,
    size_t size) {
    const unsigned version = setup->version, number = report->index + 1;
    char own[32];
    (void)snprintf(own, sizeof own, "number %u", number);
    if (!state) state = own;
    text[0] = 0;
#define SAY(...) (void)snprintf(text, size, __VA_ARGS__); break
    switch (report->end) {
        case INTEGRATOR_CALL_FAILED:
            SAY("fmi%u%s failed", version, integrator_function(version, report->index));
        case INTEGRATOR_BAD_STATE: SAY("state %s is NaN or infinite after an event", state);
        case INTEGRATOR_BAD_DERIVATIVE:
            SAY("the derivative of state %s is NaN or infinite; check its inputs and parameters", state);
        case INTEGRATOR_BAD_INDICATOR:
            SAY("event indicator %u is NaN or infinite; check its inputs and parameters", number);
        case INTEGRATOR_TOO_SMALL:
            SAY("the error of state %s exceeds the tolerance %.3g even with the smallest step: the state diverges, or "
                "the model jumps without an event; a larger tolerance may help", state, setup->tolerance);
        case INTEGRATOR_TOO_MANY_STEPS:
            SAY("more than 1000000 steps of the integrator in one communication step; a larger tolerance or the "
                "implicit solver may help");
        case INTEGRATOR_NOT_CONVERGED:
            SAY("event iteration did not converge: every update of discrete states requires another one (fmi%u%s); "
                "correct the model's event equations", version, integrator_function(version, INTEGRATOR_UPDATE));
        case INTEGRATOR_TOO_MANY_EVENTS:
            SAY("more than 10000 events in one communication step: the model switches back and forth (chattering), or "
                "its next time event is never later; add hysteresis to its conditions");
        case INTEGRATOR_BAD_EVENT:
            SAY("its next time event is at NaN (nextEventTime of fmi%u%s)", version,
                integrator_function(version, INTEGRATOR_UPDATE));
        case INTEGRATOR_TERMINATED: SAY("it asks for the end of the simulation");
        case INTEGRATOR_OTHER_COUNT:
            SAY("fmi%u%s returns %u, and ModelStructure lists %u %s; export the FMU again", version,
                integrator_function(version, report->index), report->found,
                report->index == INTEGRATOR_COUNT_STATES ? setup->n : setup->n_indicators,
                report->index == INTEGRATOR_COUNT_STATES ? "continuous states" : "event indicators");
        default: break;
    }
}

bool integrator_needs(const IntegratorSetup *setup, uint32_t number) {
    switch (number) {
        case INTEGRATOR_SET_STATES:
        case INTEGRATOR_GET_STATES:
        case INTEGRATOR_GET_DERIVATIVES:
        case INTEGRATOR_GET_NOMINALS: return setup->n > 0;
        case INTEGRATOR_GET_INDICATORS: return setup->n_indicators > 0;
        case INTEGRATOR_COMPLETED: return setup->completed;
        case INTEGRATOR_DIRECTIONAL: return setup->directional;
        case INTEGRATOR_COUNT_STATES:
        case INTEGRATOR_COUNT_INDICATORS: return false;
        default: return number < INTEGRATOR_FUNCTIONS;
    }
}

enum { VECTORS = 21 }; /* of n doubles: x, x1, trial, f, f1, error, nominal, slope, seed, k, dense, one in reserve */

/* Whether there are matrices: automatically only up to a size at which they cost less than small steps. */
static bool solves(const IntegratorSetup *setup) {
    return setup->method == INTEGRATOR_IMPLICIT || (setup->method == INTEGRATOR_AUTO && setup->n <= LARGEST_AUTO);
}

size_t integrator_size(const IntegratorSetup *setup) {
    const size_t n = setup->n, square = solves(setup) ? 2 * n * n : 0;
    if (n > 1 << 20 || (setup->method == INTEGRATOR_IMPLICIT && n > LARGEST_IMPLICIT)) return 0;
    if (setup->n_indicators > 1 << 24 || setup->n_references > n) return 0;
    return sizeof(Integrator) + (VECTORS * n + square + 4 * (size_t)setup->n_indicators) * sizeof(double) +
           (n + 2 * (size_t)setup->n_references) * sizeof(uint32_t);
}

Integrator *integrator_make(void *memory, const IntegratorSetup *setup, const uint32_t *references, void *instance,
    void *const *calls) {
    Integrator *const s = memory;
    const size_t n = setup->n;
    memset(memory, 0, integrator_size(setup));
    s->setup = *setup;
    s->instance = instance;
    for (int i = 0; i < INTEGRATOR_FUNCTIONS; i++) s->call[i] = calls[i];
    double *p = (double *)(void *)(s + 1);
    double **const vectors[9] = {&s->x, &s->x1, &s->trial, &s->f, &s->f1, &s->error, &s->nominal, &s->slope, &s->seed};
    for (int i = 0; i < 9; i++, p += n) *vectors[i] = p;
    for (int i = 0; i < 6; i++, p += n) s->k[i] = p;
    for (int i = 0; i < 5; i++, p += n) s->dense[i] = p;
    p += n;
    s->z = p, s->z1 = p + setup->n_indicators, p += 4 * (size_t)setup->n_indicators;
    s->matrix = p, p += solves(setup) ? 2 * n * n : 0;
    s->pivot = (uint32_t *)(void *)p;
    uint32_t *const own = s->pivot + n;
    memcpy(own, references, 2 * (size_t)setup->n_references * sizeof *own);
    s->states = own, s->derivatives = own + setup->n_references;
    s->memory.implicit = setup->method == INTEGRATOR_IMPLICIT;
    for (size_t i = 0; i < n; i++) s->nominal[i] = 1.0;
    return s;
}

uint32_t integrator_begin(void *integrator, double t) {
    Integrator *const s = integrator;
    s->memory = (IntegratorMemory){.time = t, .implicit = s->setup.method == INTEGRATOR_IMPLICIT};
    s->report = (IntegratorReport){.end = INTEGRATOR_FINE};
    if (s->setup.foreign) environment_begin(s->environment);
    uint32_t status = check_counts(s);
    if (status <= WARNING) status = update(s, true);
    environment_end(s->environment);
    return status;
}

uint32_t integrator_step2(void *integrator, double t, double h, int no_set_prior) {
    Integrator *const s = integrator;
    const bool alone = t != t;
    s->no_set_prior = no_set_prior != 0;
    if (s->memory.ends) return alone ? OK : failed(s, INTEGRATOR_TERMINATED, 0, s->memory.time, DISCARD);
    if (alone) t = s->memory.time, h = 0.0;
    if (!(size_of(t - s->memory.time) <= 2.0 * resolution(t, h))) s->memory.time = t; /* not where a time event was */
    if (!solves(&s->setup)) s->memory.implicit = 0; /* whatever a saved state says */
    if (s->setup.foreign) environment_begin(s->environment);
    const uint32_t status = advance(s, t + h, h);
    environment_end(s->environment);
    return alone && s->memory.ends ? OK : status;
}

uint32_t integrator_step3(void *integrator, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last) {
    *event = *terminate = *early = false;
    const uint32_t status = integrator_step2(integrator, t, h, no_set_prior);
    *last = status > WARNING ? ((Integrator *)integrator)->memory.time : t + h;
    return status;
}
