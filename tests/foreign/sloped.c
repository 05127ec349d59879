/* A model without states, FMI 2.0 or 3.0 Co-Simulation, from the standard's headers alone (sloped.py):
 *
 *   a = t + k sin(p) + q / 4,  b = p q / 8 - k cos(q)
 *
 * with directional derivatives. Of these the parameter `trouble` makes: 1 others, 2 NaN, 3 to 5 Discard, Error or
 * Fatal. With 6, outputs follow inputs in steps only, and a also has the sum of h p over the steps. With 7, getting
 * values for p < -1 returns Discard and a wrong value. With 8, a grows by 1 when initialization ends. With 9, getting b
 * for p < -1 returns Discard and wrong values of all that is asked for. With 10, the first update for p >= 1 asks for
 * the end. `calls` counts derivatives; `multiples` are a and 2 a. With DISCRETE q is a discrete input: setting it in
 * step mode is an Error. */
#include <math.h>

#include "../fmi_names.h"

enum { P, Q, A, B, K, TROUBLE, CALLS, MULTIPLES = 8, WHOLE, LESS };

typedef struct {
    double value[7], time, sum;
    bool stepping, asked;
} Model;

static bool is_lazy(const Model *m) { return m->value[TROUBLE] == 6.0; }

static Model *made(void) {
    Model *m = calloc(1, sizeof *m);
    if (m) m->value[K] = 1.0;
    return m;
}

static void compute(Model *m) {
    double *const x = m->value;
    x[A] = m->time + x[K] * sin(x[P]) + 0.25 * x[Q] + m->sum;
    x[B] = 0.125 * x[P] * x[Q] - x[K] * cos(x[Q]);
}

static double get(Model *m, Reference r) {
    if (!is_lazy(m)) compute(m);
    return m->value[r];
}

/* All values that are asked for; false where it refuses them. */
static bool tell(Model *m, const Reference of[], size_t n, double value[]) {
    double *const first = value;
    bool refused = m->value[TROUBLE] == 7.0;
    for (size_t i = 0; i < n; i++) {
        *value++ = get(m, of[i] == MULTIPLES ? A : of[i]);
        if (of[i] == MULTIPLES) *value++ = 2.0 * get(m, A);
        refused |= of[i] == B && m->value[TROUBLE] == 9.0;
    }
    refused &= m->value[P] < -1.0;
    while (refused && value > first) *--value = 1e3;
    return !refused;
}

static void step(Model *m, double t, double h) {
    m->time = t + h;
    if (!is_lazy(m)) return;
    m->sum += h * m->value[P];
    compute(m);
}

static Status slopes(Model *m, const Reference of[], size_t n, const Reference by[], size_t k, const double seed[],
    double slope[]) {
    const double *const x = m->value;
    const int trouble = (int)x[TROUBLE];
    double d[2] = {0.0, 0.0};
    m->value[CALLS]++;
    for (size_t i = 0; i < k; i++) d[by[i]] = seed[i];
    for (size_t i = 0; i < n; i++) {
        slope[i] = of[i] == A ? x[K] * cos(x[P]) * d[P] + 0.25 * d[Q]
                              : 0.125 * x[Q] * d[P] + (0.125 * x[P] + x[K] * sin(x[Q])) * d[Q];
        if (trouble == 1) slope[i] *= -3.0;
        if (trouble == 2) slope[i] = NAN;
    }
    return trouble < 3 || trouble > 5 ? F(OK) : (Status)(trouble - 1);
}

#define M ((Model *)c)
INSTANTIATE(made())
void F(FreeInstance)(Instance c) { free(c); }
Status F(SetDebugLogging)(Instance c, Flag on, size_t n, const Text categories[]) { return F(OK); }
SETUP((M->time = begin, M->sum = 0.0, F(OK)), F(OK))
Status F(ExitInitializationMode)(Instance c) { return M->sum += M->value[TROUBLE] == 8.0, F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(Reset)(Instance c) { return memset(M, 0, sizeof(Model)), M->value[K] = 1.0, F(OK); }
ACCESS(REAL, double, return tell(M, vr, n, value) ? F(OK) : F(Discard),
    if (DISCRETE && M->stepping) for (size_t i = 0; i < n; i++) if (vr[i] == Q) return F(Error);
    EACH(M->value[vr[i]] = value[i]))
#if FMI == 3
Status fmi3GetInt64(Instance c, const Reference vr[], size_t n, int64_t value[], size_t n_values) {
    EACH(value[i] = (int64_t)(1e3 * get(M, A)) - (vr[i] == LESS));
}
Status fmi3EnterEventMode(Instance c) { return M->stepping = false, fmi3OK; }
Status fmi3EnterStepMode(Instance c) { return M->stepping = true, fmi3OK; }
Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *terminate, Flag *nominals, Flag *values, Flag *has_next,
    double *next) {
    *again = *nominals = *values = *has_next = false;
    *terminate = M->value[TROUBLE] == 10.0 && M->value[P] >= 1.0 && !M->asked;
    M->asked |= *terminate;
    return fmi3OK;
}
Status fmi3SetClock(Instance c, const Reference vr[], size_t n, const fmi3Clock value[]) { return fmi3OK; }
#endif
#ifndef LACKING
Status F(GetDirectionalDerivative)(Instance c, const Reference of[], size_t n, const Reference by[], size_t k,
    const double seed[], FMI2_OR_3(, size_t n_seed COMMA) double slope[] FMI2_OR_3(, COMMA size_t n_slope)) {
    return slopes(M, of, n, by, k, seed, slope);
}
#endif
COPIED_STATES(Model, )
DO_STEP((step(M, t, h), F(OK)))
