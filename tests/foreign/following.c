/* A small FMI 3.0 Co-Simulation FMU that asks for its input inside its steps, from the standard's headers alone.
 *
 * dx/dt = u in ten internal steps of a communication step, each by the trapezoidal rule with what u is at both of its
 * ends; y = u; the array xs integrates the array w alike, and `energy` u^2. `asked` counts the callbacks that ask for
 * inputs, `early` the steps that ended early on request. The parameter `kind` says how it calls back; UPWARD: in that
 * rounding mode, in which nothing else is computed. */
#include <fenv.h>
#include <math.h>
#include <string.h>

#include "../fmi_names.h"

enum { FOLLOWS, SILENT, READS, NOT_A_TIME, LATE, OUTSIDE, UNSETTABLE, NO_POINTERS, CRASHES, UPWARD }; /* kinds */
enum { U, X, Y, ASKED, EARLY, KIND, FREE, W, XS, ENERGY, TIME = 100 };                        /* value references */
enum { PARTS = 10, N = 3 };

typedef struct {
    int state;
    bool events, early, updating;
    int32_t asked, returned, kind;
    double now, x, u, unset, w[N], xs[N], energy;
} Values;

#define REFUSED (update ? n != 2 || required[0] != U || required[1] != W : n)
#define ENTERED
#include "strict.h"

static void start(Model *m) { m->v = (Values){.events = m->v.events, .early = m->v.early, .w = {0.0, 0.0, 7.0}}; }
static size_t count(Reference r) { return r == W || r == XS ? N : 1; }

Status fmi3ExitInitializationMode(Instance c) {
    IN(BIT(INITIALIZATION));
    m->v.state = STEP;
    return fmi3OK;
}
Status fmi3GetFloat64(Instance c, const Reference vr[], size_t n, double value[], size_t k) {
    IN(BIT(INITIALIZATION) | BIT(STEP) | BIT(TERMINATED));
    if (m->v.kind == OUTSIDE && m->update) /* in no step */
        m->update(m->environment, m->v.now, true, true, true, false, NULL, NULL);
    for (size_t i = 0; i < n; value += count(vr[i++]))
        if (count(vr[i]) == N) memcpy(value, vr[i] == W ? m->v.w : m->v.xs, sizeof m->v.w);
        else
            *value = vr[i] == X        ? m->v.x
                     : vr[i] == ENERGY ? m->v.energy
                     : vr[i] == FREE   ? m->v.unset
                     : vr[i] == TIME   ? m->v.now
                                       : m->v.u;
    return fmi3OK;
}
Status fmi3SetFloat64(Instance c, const Reference vr[], size_t n, const double value[], size_t k) {
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(STEP));
    for (size_t i = 0; i < n; value += count(vr[i++])) {
        if (m->v.updating && vr[i] != U && vr[i] != W) return error(m, "%u is set inside a step", (unsigned)vr[i]);
        if (m->v.updating && m->v.kind == UNSETTABLE) return error(m, "u = %g is refused", *value);
        memcpy(vr[i] == U ? &m->v.u : vr[i] == W ? m->v.w : &m->v.unset, value, count(vr[i]) * sizeof *value);
    }
    return fmi3OK;
}
ACCESS(INTEGER, Whole, IN(BIT(INITIALIZATION) | BIT(STEP));
    EACH(value[i] = vr[i] == ASKED ? m->v.asked : vr[i] == EARLY ? m->v.returned : m->v.kind),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION)); EACH(m->v.kind = value[i]))

/* Whether the importer wants the step to end. */
static bool call_back(Model *m, double t) {
    Flag wanted = false;
    double when = 0.0;
    const int32_t kind = m->v.kind;
    if (kind == SILENT || !m->update) return false;
    if (kind == CRASHES) *(volatile int *)0 = 0;
    if (kind == NOT_A_TIME) t = NAN;
    if (kind == LATE) t += 1.0;
    m->v.asked += kind != READS;
    m->v.updating = true;
    if (kind == UPWARD) fesetround(FE_UPWARD);
    m->update(m->environment, t, kind != READS, true, true, m->v.early, kind == NO_POINTERS ? NULL : &wanted,
        kind == NO_POINTERS ? NULL : &when);
    m->v.asked += kind == UPWARD && fegetround() != FE_UPWARD; /* it was changed */
    if (kind == UPWARD) fesetround(FE_TONEAREST);
    m->v.updating = false;
    return wanted;
}

Status fmi3DoStep(Instance c, double t, double h, Flag no_set_prior, Flag *event,
    Flag *terminate, Flag *early, double *last) {
    STEPS_FROM(t);
    const double part = h / PARTS;
    *event = *terminate = *early = false;
    for (int i = 1; i <= PARTS && !*early; i++) {
        const Values before = m->v;
        *last = t + i * part;
        *early = call_back(m, *last) && m->v.early;
        m->v.x += part * 0.5 * (before.u + m->v.u);
        m->v.energy += part * 0.5 * (before.u * before.u + m->v.u * m->v.u);
        for (int k = 0; k < N; k++) m->v.xs[k] += part * 0.5 * (before.w[k] + m->v.w[k]);
    }
    if (*early) m->v.returned++;
    else *last = t + h;
    m->v.now = *last;
    return fmi3OK;
}
