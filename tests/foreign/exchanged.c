/* Models with known solutions that offer Model Exchange only, FMI 2.0 or 3.0, from the standard's headers alone
 * (exchanged.py). The parameter `kind` chooses the model:
 *
 *   0  dx/dt = k u(t) - x, with an input; y = x
 *   1  a ball: dx/dt = v, dv/dt = -g; at x = 0 downwards v = -0.8 v; y = x
 *   2  time events at 0.1, 0.3, 0.5, ... that add 1 to x; dx/dt = 0
 *   3  stiff: dx/dt = -1e5 (x - cos t) - sin t; the solution is cos t
 *   4  time enters alone: dx/dt = 3 t^2
 *   5  the derivative of v is NaN from t = 0.5 on
 *   6  every update of discrete states requires another one from t = 0.5 on
 *   7  the indicator changes its sign again and again: x' = -sign(x)
 *   8  it asks for the end of the simulation at t = 0.5
 *   9  getting derivatives is an error from t = 0.5 on
 *  10  a time event at 0.5 that is never later
 *  11  x' = 1/(1 - t)^2 diverges at t = 1
 *  12  discard: derivatives exist only for x < 1; x' = 1 - x
 *  13  a harmonic oscillator, x'' = -w^2 x, with a state event where x changes its sign: `count` counts
 *  14  x' = -x, exact in every rounding mode; getting derivatives leaves the mode "upward" behind
 *      (with u != 0: enables the trap of divisions by zero instead, where the processor is x86-64)
 *  15  the next time event is at NaN from t = 0.5 on
 *  16  as 13 without indicator; from a time event at 0.5 on the nominal values of the states are 1000
 *
 * `last` is the time of the last event, `steps` counts completed steps of the integrator. */
#include <fenv.h>
#include <math.h>

#include "../fmi_names.h"

enum { U, X, DX, V, DV, K, KIND, COUNT, STEPS, LAST };

typedef struct {
    double value[10], time, sign, next;
    bool in_event;
} Model;

static double kind(const Model *m) { return m->value[KIND]; }

static void rates(Model *m) {
    double *const y = m->value;
    const double t = m->time, x = y[X], v = y[V], k = y[K];
    y[DX] = y[DV] = 0.0;
    switch ((int)kind(m)) {
        case 0: y[DX] = k * y[U] - x; break;
        case 1: y[DX] = v, y[DV] = -9.81; break;
        case 3: y[DX] = -1e5 * (x - cos(t)) - sin(t); break;
        case 4: y[DX] = 3.0 * t * t; break;
        case 5: y[DX] = v, y[DV] = t < 0.5 ? 1.0 : NAN; break;
        case 7: y[DX] = -m->sign; break;
        case 11: y[DX] = t < 1.0 ? 1.0 / ((1.0 - t) * (1.0 - t)) : INFINITY; break;
        case 12: y[DX] = 1.0 - x; break;
        case 14: y[DX] = -x; break;
        case 13:
        case 16: y[DX] = v, y[DV] = -k * k * x; break;
        default: break;
    }
}

static Status update(
    Model *m, Flag *again, Flag *end, Flag *nominals, Flag *states, Flag *defined, double *next) {
    const double count = m->value[COUNT];
    *again = *end = *nominals = *states = false;
    switch ((int)kind(m)) {
        case 1:
            if (m->value[X] <= 0.0 && m->value[V] < 0.0) m->value[X] = 0x1p-1022, m->value[V] *= -0.8, *states = true;
            m->value[COUNT] += *states;
            break;
        case 2:
            if (m->time >= m->next) m->value[X] += 1.0, m->value[COUNT] += 1.0, m->next += 0.2, *states = true;
            break;
        case 6: *again = m->time >= 0.5; break;
        case 7: m->sign = m->value[X] > 0.0 ? 1.0 : -1.0; break;
        case 8: *end = m->time >= 0.5; break;
        case 16: *nominals = m->time >= 0.5 && count == 0.0, m->value[COUNT] = m->time >= 0.5; break;
        case 13:
            if ((m->value[X] > 0.0) != (m->sign > 0.0)) m->sign = -m->sign, m->value[COUNT] += 1.0;
            break;
        default: break;
    }
    if (m->value[COUNT] != count) m->value[LAST] = m->time;
    if (kind(m) == 6.0 || kind(m) == 8.0 || kind(m) == 10.0 || kind(m) == 16.0) m->next = 0.5;
    if (kind(m) == 15.0) m->next = m->time < 0.5 ? 0.5 : NAN;
    *defined = kind(m) == 2.0 || ((kind(m) == 6.0 || kind(m) == 8.0 || kind(m) == 16.0) && m->time < 0.5) ||
               kind(m) == 10.0 || kind(m) == 15.0;
    *next = m->next;
    return F(OK);
}

static void start(Model *m) {
    memset(m, 0, sizeof *m);
    m->value[X] = m->value[K] = m->sign = 1.0;
    m->next = 0.1;
}

#if FMI == 2
Instance fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *callbacks, Flag visible, Flag logging) {
    if (type != fmi2ModelExchange) return NULL;
#else
Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, Flag visible,
    Flag logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
#endif
    Model *m = malloc(sizeof *m);
    if (m) start(m);
    return m;
}

void F(FreeInstance)(Instance c) { free(c); }
Status F(Reset)(Instance c) { return start(c), F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(ExitInitializationMode)(Instance c) { return ((Model *)c)->in_event = true, F(OK); }
Status F(EnterEventMode)(Instance c) {
    Model *m = c;
    if (m->in_event) return F(Error);
    return m->in_event = true, F(OK);
}
Status F(EnterContinuousTimeMode)(Instance c) {
    Model *m = c;
    if (!m->in_event) return F(Error);
    return m->in_event = false, F(OK);
}
Status F(SetTime)(Instance c, double t) {
    Model *m = c;
    if (m->in_event) return F(Error);
    return m->time = t, F(OK);
}
Status F(GetContinuousStates)(Instance c, double x[], size_t n) {
    const Model *m = c;
    if (n != 2) return F(Error);
    return x[0] = m->value[X], x[1] = m->value[V], F(OK);
}
Status F(SetContinuousStates)(Instance c, const double x[], size_t n) {
    Model *m = c;
    if (n != 2 || m->in_event) return F(Error);
    return m->value[X] = x[0], m->value[V] = x[1], F(OK);
}
Status F(GetNominalsOfContinuousStates)(Instance c, double x[], size_t n) {
    const Model *m = c;
    return x[0] = x[1] = kind(m) == 16.0 && m->value[COUNT] > 0.0 ? 1000.0 : 1.0, F(OK);
}
Status F(GetEventIndicators)(Instance c, double z[], size_t n) {
    const Model *m = c;
    if (n != 1) return F(Error);
    const bool has = kind(m) == 1.0 || kind(m) == 7.0 || kind(m) == 13.0;
    return z[0] = has ? m->value[X] : 1.0, F(OK);
}
static Status derivatives(Model *m, double *dx, size_t n) {
    rates(m);
    if (kind(m) == 14.0 && m->value[U] == 0.0) fesetround(FE_UPWARD);
#if defined(__x86_64__)
    if (kind(m) == 14.0 && m->value[U] != 0.0) __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() & ~0x200u);
#endif
    if (n != 2 || (kind(m) == 9.0 && m->time >= 0.5)) return F(Error);
    if (kind(m) == 12.0 && m->value[X] >= 1.0 + 1e-12) return F(Discard);
    return dx[0] = m->value[DX], dx[1] = m->value[DV], F(OK);
}

static Status get(Model *m, const uint32_t r[], size_t n, double *v) {
    rates(m);
    for (size_t i = 0; i < n; i++) v[i] = m->value[r[i]];
    return F(OK);
}
static Status set(Model *m, const uint32_t r[], size_t n, const double *v) {
    for (size_t i = 0; i < n; i++) m->value[r[i]] = v[i];
    return F(OK);
}

Status F(CompletedIntegratorStep)(Instance c, Flag prior, Flag *enter, Flag *end) {
    ((Model *)c)->value[STEPS] += 1.0;
    return *enter = *end = false, F(OK);
}
SETUP((((Model *)c)->time = begin, F(OK)), F(OK))
ACCESS(REAL, double, return get(c, vr, n, value), return set(c, vr, n, value))
COPIED_STATES(Model, )
#if FMI == 2
Status fmi2GetDerivatives(Instance c, double dx[], size_t n) { return derivatives(c, dx, n); }
Status fmi2NewDiscreteStates(Instance c, fmi2EventInfo *i) {
    return update(c, &i->newDiscreteStatesNeeded, &i->terminateSimulation, &i->nominalsOfContinuousStatesChanged,
        &i->valuesOfContinuousStatesChanged, &i->nextEventTimeDefined, &i->nextEventTime);
}
#else
Status fmi3GetContinuousStateDerivatives(Instance c, double dx[], size_t n) { return derivatives(c, dx, n); }
Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *end, Flag *nominals, Flag *states, Flag *defined,
    double *next) {
    return update(c, again, end, nominals, states, defined, next);
}
#endif
#ifdef SLOPE /* directional derivatives that are all the same */
Status F(GetDirectionalDerivative)(Instance c, const Reference of[], size_t n, const Reference by[], size_t k,
    const double seed[], FMI2_OR_3(, size_t n_seed COMMA) double slope[] FMI2_OR_3(, COMMA size_t n_slope)) {
    for (size_t i = 0; i < n; i++) slope[i] = SLOPE;
    return RETURNED;
}
#endif
