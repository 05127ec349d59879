/* A lag, dx/dt = u - x, FMI 2.0 or 3.0, Co-Simulation and Model Exchange, whose functions fail: number `function` of
 * the list below returns `status` from its call `after` + 1 on (failing.py). */
#include <math.h>

#include "../fmi_names.h"

enum { U, X, DX, FUNCTION, STATUS, AFTER, VALUES };
enum { /* functions, as in failing.py */
    NOTHING, SET_REAL, GET_REAL, SETUP_EXPERIMENT, ENTER_INITIALIZATION, EXIT_INITIALIZATION, DO_STEP, TERMINATE, RESET,
    GET_STATE, SET_STATE, SET_TIME, SET_STATES, GET_STATES, GET_DERIVATIVES, GET_INDICATORS, GET_NOMINALS, ENTER_EVENTS,
    UPDATE, ENTER_CONTINUOUS, COMPLETED
};

typedef struct {
    double value[VALUES], time;
    int calls;
} Model;

/* Return from here if that is what the function is to do. */
#define MAY_FAIL(number)                                                            \
    Model *m = c;                                                                   \
    if (m->value[FUNCTION] == (number) && m->calls++ >= (int)m->value[AFTER])       \
        return (Status)(int)m->value[STATUS];

static void start(Model *m) {
    memset(m, 0, sizeof *m);
    m->value[X] = 1.0;
}
static Instance made(void) {
    Model *m = malloc(sizeof *m);
    if (m) start(m);
    return m;
}
INSTANTIATE(made())
#if FMI == 3
Instance fmi3InstantiateModelExchange(Text name, Text token, Text resources, Flag visible, Flag logging,
    fmi3InstanceEnvironment environment, Logger log) {
    return made();
}
#endif
void F(FreeInstance)(Instance c) { free(c); }
Status F(SetDebugLogging)(Instance c, Flag on, size_t n, const Text categories[]) { return F(OK); }
Status F(Reset)(Instance c) {
    MAY_FAIL(RESET);
    return start(c), F(OK);
}
static Status setup(Instance c, double begin) {
    MAY_FAIL(SETUP_EXPERIMENT);
    return m->time = begin, F(OK);
}
#define SIMPLE(NAME, NUMBER)      \
    Status F(NAME)(Instance c) {  \
        MAY_FAIL(NUMBER);         \
        return F(OK);             \
    }
#define COUNTED(NAME, NUMBER, TYPE, DO)              \
    Status F(NAME)(Instance c, TYPE x[], size_t n) { \
        MAY_FAIL(NUMBER);                            \
        DO;                                          \
        return F(OK);                                \
    }
static Status enter(Instance c) {
    MAY_FAIL(ENTER_INITIALIZATION);
    return F(OK);
}
SETUP(setup(c, begin), enter(c))
SIMPLE(ExitInitializationMode, EXIT_INITIALIZATION)
SIMPLE(Terminate, TERMINATE)
SIMPLE(EnterEventMode, ENTER_EVENTS)
SIMPLE(EnterContinuousTimeMode, ENTER_CONTINUOUS)
static double *at(Model *m, unsigned r) {
    m->value[DX] = m->value[U] - m->value[X];
    return &m->value[r];
}
static Status get(Instance c, const Reference r[], size_t n, double v[]) {
    MAY_FAIL(GET_REAL);
    EACH(v[i] = *at(m, r[i]));
}
static Status set(Instance c, const Reference r[], size_t n, const double v[]) {
    Model *own = c;
    if (r[0] < FUNCTION) {
        MAY_FAIL(SET_REAL);
    }
    EACH(own->value[r[i]] = v[i]);
}
ACCESS(REAL, double, return get(c, vr, n, value), return set(c, vr, n, value))
static Status step(Instance c, double h) {
    MAY_FAIL(DO_STEP);
    return m->value[X] += h * (m->value[U] - m->value[X]), F(OK);
}
DO_STEP(step(c, h))
Status STATE(Get, )(Instance c, Saved *s) {
    MAY_FAIL(GET_STATE);
    if (!*s) *s = malloc(sizeof *m);
    return memcpy(*s, m, sizeof *m), F(OK);
}
Status STATE(Set, )(Instance c, Saved s) {
    MAY_FAIL(SET_STATE);
    const int calls = m->calls;
    memcpy(m, s, sizeof *m);
    return m->calls = calls, F(OK);
}
Status STATE(Free, )(Instance c, Saved *s) { return free(*s), *s = NULL, F(OK); }

Status F(SetTime)(Instance c, double t) {
    MAY_FAIL(SET_TIME);
    return m->time = t, F(OK);
}
COUNTED(SetContinuousStates, SET_STATES, const double, m->value[X] = x[0])
COUNTED(GetContinuousStates, GET_STATES, double, x[0] = m->value[X])
COUNTED(GetEventIndicators, GET_INDICATORS, double, x[0] = m->value[X] - 0.5)
COUNTED(GetNominalsOfContinuousStates, GET_NOMINALS, double, x[0] = 1.0)
static Status update(Instance c) {
    MAY_FAIL(UPDATE);
    return F(OK);
}
Status F(CompletedIntegratorStep)(Instance c, Flag prior, Flag *enter, Flag *end) {
    *enter = *end = false;
    MAY_FAIL(COMPLETED);
    return F(OK);
}
#if FMI == 2
COUNTED(GetDerivatives, GET_DERIVATIVES, double, x[0] = *at(m, DX))
Status fmi2NewDiscreteStates(Instance c, fmi2EventInfo *i) { return memset(i, 0, sizeof *i), update(c); }
Status fmi2GetRealStatus(Instance c, const fmi2StatusKind kind, double *value) { return fmi2Discard; }
Status fmi2GetBooleanStatus(Instance c, const fmi2StatusKind kind, Flag *value) { return fmi2Discard; }
#else
#ifndef INDICATORS
#define INDICATORS 1
#define STATES 1
#endif
Status fmi3GetNumberOfContinuousStates(Instance c, size_t *n) { return *n = STATES, F(OK); }
Status fmi3GetNumberOfEventIndicators(Instance c, size_t *n) { return *n = INDICATORS, F(OK); }
COUNTED(GetContinuousStateDerivatives, GET_DERIVATIVES, double, x[0] = *at(m, DX))
Status fmi3UpdateDiscreteStates(
    Instance c, Flag *again, Flag *end, Flag *nominals, Flag *states, Flag *defined, double *next) {
    *again = *end = *nominals = *states = *defined = false;
    return update(c);
}
#endif
