/* What the strict FMI 3.0 FMUs of the tests share: whatever the standard does not allow in a state is an Error.
 * Included behind the type `Values`, which has the fields `state` and `events`. */
#include <stdarg.h>
#include <stdio.h>

enum { INSTANTIATED, INITIALIZATION, EVENT, STEP, TERMINATED };

typedef struct {
    Values v;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
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

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }
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
