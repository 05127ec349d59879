/* What the strict FMI 3.0 FMUs of the tests share: whatever the standard does not allow in a state is an Error.
 * Included behind the type `Values`, which has the fields `state`, `now`, `events` and `early` (both allowed), and the
 * macro REFUSED, which says of the arguments below whether there is no instance. */
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
    Model *m = instance;                                                                       \
    if (!((states) >> m->v.state & 1)) return error(m, "%s in state %d", __func__, m->v.state)
#define BIT(state) (1 << (state))

static void start(Model *m); /* values at the begin; `events` and `early` stay */

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean log, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message, fmi3IntermediateUpdateCallback update) {
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
void fmi3FreeInstance(fmi3Instance instance) { free(instance); }
fmi3Status fmi3Reset(fmi3Instance instance) {
    start(instance);
    return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    IN(BIT(STEP));
    if (!m->v.events) return error(m, "event mode is not used");
    m->v.state = EVENT;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance instance) {
    IN(BIT(STEP) | BIT(EVENT));
    m->v.state = TERMINATED;
    return fmi3OK;
}
#if !defined(OWN_STEP_MODE)
fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
    IN(BIT(EVENT));
    m->v.state = STEP;
    return fmi3OK;
}
#endif

#define VALUES(C) (&((Model *)(C))->v)
COPIED_STATES(Values, VALUES)

/* The begin of fmi3DoStep. */
#define STEPS_FROM(t) \
    IN(BIT(STEP));    \
    if (fabs(t - m->v.now) > 1e-9) return error(m, "a step from %.12g, but it is %.12g", t, m->v.now)
