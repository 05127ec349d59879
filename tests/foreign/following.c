/* A small FMI 3.0 Co-Simulation FMU that asks for its input inside its steps, from the standard's headers alone.
 *
 * dx/dt = u in ten internal steps of a communication step, each by the trapezoidal rule with what u is at both of its
 * ends; y = u. `asked` counts the callbacks that ask for inputs, `early` the steps that ended early on request. The
 * parameter `kind` says how it calls back. */
#include <math.h>
#include <string.h>

#include "../fmi_names.h"

enum { FOLLOWS, SILENT, READS, NOT_A_TIME, LATE, OUTSIDE, UNSETTABLE, NO_POINTERS, CRASHES }; /* kinds */
enum { U, X, Y, ASKED, EARLY, KIND, FREE, TIME = 100 };                                       /* value references */
enum { PARTS = 10 };

typedef struct {
    int state;
    bool events, early, updating;
    int32_t asked, returned, kind;
    double now, x, u, unset;
} Values;

#define REFUSED (n != 1 || required[0] != U || !update)
#define ENTERED
#include "strict.h"

static void start(Model *m) { m->v = (Values){.events = m->v.events, .early = m->v.early}; }

Status fmi3ExitInitializationMode(Instance c) {
    IN(BIT(INITIALIZATION));
    m->v.state = STEP;
    return fmi3OK;
}
ACCESS(REAL, double, IN(BIT(INITIALIZATION) | BIT(STEP) | BIT(TERMINATED));
    if (m->v.kind == OUTSIDE) m->update(m->environment, m->v.now, true, true, true, false, NULL, NULL); /* in no step */
    EACH(value[i] = vr[i] == X ? m->v.x : vr[i] == FREE ? m->v.unset : vr[i] == TIME ? m->v.now : m->v.u),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(STEP));
    EACH({
        if (m->v.updating && vr[i] != U) return error(m, "%u is set inside a step", (unsigned)vr[i]);
        if (m->v.updating && m->v.kind == UNSETTABLE) return error(m, "u = %g is refused", value[i]);
        *(vr[i] == U ? &m->v.u : &m->v.unset) = value[i];
    }))
ACCESS(INTEGER, Whole, IN(BIT(INITIALIZATION) | BIT(STEP));
    EACH(value[i] = vr[i] == ASKED ? m->v.asked : vr[i] == EARLY ? m->v.returned : m->v.kind),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION)); EACH(m->v.kind = value[i]))

/* Whether the importer wants the step to end. */
static bool call_back(Model *m, double t) {
    Flag wanted = false;
    double when = 0.0;
    const int32_t kind = m->v.kind;
    if (kind == SILENT) return false;
    if (kind == CRASHES) *(volatile int *)0 = 0;
    if (kind == NOT_A_TIME) t = NAN;
    if (kind == LATE) t += 1.0;
    m->v.asked += kind != READS;
    m->v.updating = true;
    m->update(m->environment, t, kind != READS, true, true, m->v.early, kind == NO_POINTERS ? NULL : &wanted,
        kind == NO_POINTERS ? NULL : &when);
    m->v.updating = false;
    return wanted;
}

Status fmi3DoStep(Instance c, double t, double h, Flag no_set_prior, Flag *event,
    Flag *terminate, Flag *early, double *last) {
    STEPS_FROM(t);
    const double part = h / PARTS;
    *event = *terminate = *early = false;
    for (int i = 1; i <= PARTS && !*early; i++) {
        const double before = m->v.u;
        *last = t + i * part;
        *early = call_back(m, *last) && m->v.early;
        m->v.x += part * 0.5 * (before + m->v.u);
    }
    if (*early) m->v.returned++;
    else *last = t + h;
    m->v.now = *last;
    return fmi3OK;
}
