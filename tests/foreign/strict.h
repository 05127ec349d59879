/* What the strict FMI 3.0 FMUs of the tests share: whatever the standard does not allow in a state is an Error.
 * Included behind the type `Values`, which has the fields `state`, `now`, `events` and `early` (both allowed), and the
 * macros REFUSED, which says of the arguments below whether there is no instance, and ENTERED, what else initialization
 * begins with. */
#include <stdarg.h>
#include <stdio.h>

enum { INSTANTIATED, INITIALIZATION, EVENT, STEP, TERMINATED };

typedef struct {
    Values v;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
    fmi3IntermediateUpdateCallback update;
} Model;

static fmi3Status error(Model *m, const char *format, ...) {
    char text[200];
    va_list list;
    va_start(list, format);
    vsnprintf(text, sizeof text, format, list);
    va_end(list);
    if (m->log) m->log(m->environment, fmi3Error, "", text);
    return fmi3Error;
}

#define IN(states)                                                                             \
    Model *m = c;                                                                              \
    if (!((states) >> m->v.state & 1)) return error(m, "%s in state %d", __func__, m->v.state)
#define BIT(state) (1 << (state))

static void start(Model *m); /* values at the begin; `events` and `early` stay */

const char *fmi3GetVersion(void) { return fmi3Version; }
Instance fmi3InstantiateCoSimulation(Text name, Text token, Text resources, Flag visible, Flag log, Flag events,
    Flag early, const Reference required[], size_t n, fmi3InstanceEnvironment environment, Logger message,
    fmi3IntermediateUpdateCallback update) {
    Model *m = REFUSED ? NULL : calloc(1, sizeof *m);
    if (!m) return NULL;
    m->log = message;
    m->environment = environment;
    m->update = update;
    m->v.events = events;
    m->v.early = early;
    start(m);
    return m;
}
void fmi3FreeInstance(Instance c) { free(c); }
Status fmi3Reset(Instance c) { return start(c), fmi3OK; }
Status fmi3EnterInitializationMode(Instance c, Flag a, double tolerance, double begin, Flag b, double stop) {
    IN(BIT(INSTANTIATED));
    m->v.now = begin;
    ENTERED;
    return m->v.state = INITIALIZATION, fmi3OK;
}
Status fmi3EnterEventMode(Instance c) {
    IN(BIT(STEP));
    if (!m->v.events) return error(m, "event mode is not used");
    return m->v.state = EVENT, fmi3OK;
}
Status fmi3Terminate(Instance c) {
    IN(BIT(STEP) | BIT(EVENT));
    return m->v.state = TERMINATED, fmi3OK;
}
#if !defined(OWN_STEP_MODE)
Status fmi3EnterStepMode(Instance c) {
    IN(BIT(EVENT));
    return m->v.state = STEP, fmi3OK;
}
#endif

#define VALUES(C) (&((Model *)(C))->v)
COPIED_STATES(Values, VALUES)

/* The begin of fmi3DoStep. */
#define STEPS_FROM(t) \
    IN(BIT(STEP));    \
    if (fabs(t - m->v.now) > 1e-9) return error(m, "a step from %.12g, but it is %.12g", t, m->v.now)
