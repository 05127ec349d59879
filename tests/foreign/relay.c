/* A relay, FMI 2.0 or 3.0, Model Exchange: y = gain (u + a) + offset while it is open, without offset else. It opens
 * where u + a >= on and closes where u + a < off, both by an update of discrete states, and dx/dt = y. `updates` counts
 * those. The update in which it opens asks for the end if `ends` is 1, and returns Discard if it is 2. */
#include "../fmi_names.h"

enum { U, Y, X, DX, GAIN, OFFSET, ON, OFF, OPEN, UPDATES, A, ENDS, VALUES };

typedef struct {
    double value[VALUES];
} Model;

static Model *start(Model *m) {
    if (m) *m = (Model){{[GAIN] = 0.5, [OFFSET] = 1.0, [ON] = 1.0, [OFF] = 1.0}};
    return m;
}
#define M ((Model *)c)
#if FMI == 2
Instance fmi2Instantiate(Text name, fmi2Type type, Text guid, Text resources, Logger logger, Flag visible, Flag on) {
#else
Instance fmi3InstantiateModelExchange(Text name, Text token, Text resources, Flag visible, Flag on,
    fmi3InstanceEnvironment environment, Logger log) {
#endif
    return start(malloc(sizeof(Model)));
}
void F(FreeInstance)(Instance c) { free(c); }
Status F(Reset)(Instance c) { return start(c), F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
SETUP(F(OK), F(OK))
Status F(ExitInitializationMode)(Instance c) { return F(OK); }
Status F(EnterEventMode)(Instance c) { return F(OK); }
Status F(EnterContinuousTimeMode)(Instance c) { return F(OK); }
Status F(SetTime)(Instance c, double t) { return F(OK); }
Status F(SetContinuousStates)(Instance c, const double x[], size_t n) { return M->value[X] = x[0], F(OK); }
Status F(GetContinuousStates)(Instance c, double x[], size_t n) { return x[0] = M->value[X], F(OK); }
Status F(GetNominalsOfContinuousStates)(Instance c, double x[], size_t n) { return x[0] = 1.0, F(OK); }

static double *at(Model *m, Reference r) {
    double *const v = m->value;
    v[DX] = v[Y] = v[GAIN] * (v[U] + v[A]) + (v[OPEN] != 0.0 ? v[OFFSET] : 0.0);
    return &v[r];
}
static Status update(Model *m, Flag *end) {
    double *const v = m->value, was = v[OPEN];
    v[UPDATES] += 1.0;
    if (v[U] + v[A] >= v[ON]) v[OPEN] = 1.0;
    else if (v[U] + v[A] < v[OFF]) v[OPEN] = 0.0;
    const bool opens = v[OPEN] > was;
    *end = opens && v[ENDS] == 1.0;
    return opens && v[ENDS] == 2.0 ? F(Discard) : F(OK);
}
ACCESS(REAL, double, EACH(value[i] = *at(c, vr[i])), EACH(M->value[vr[i]] = value[i]))
COPIED_STATES(Model, )
#if FMI == 2
Status fmi2GetDerivatives(Instance c, double dx[], size_t n) { return dx[0] = *at(c, DX), fmi2OK; }
Status fmi2NewDiscreteStates(Instance c, fmi2EventInfo *i) {
    memset(i, 0, sizeof *i);
    return update(c, &i->terminateSimulation);
}
#else
Status fmi3GetContinuousStateDerivatives(Instance c, double dx[], size_t n) { return dx[0] = *at(c, DX), fmi3OK; }
Status fmi3UpdateDiscreteStates(
    Instance c, Flag *again, Flag *end, Flag *nominals, Flag *states, Flag *defined, double *next) {
    *again = *nominals = *states = *defined = false;
    return update(c, end);
}
#endif
