/* A small FMI 3.0 Co-Simulation FMU with event mode and no clocks, from the standard's headers alone.
 *
 * dz/dt = u * level, where `level` is the discrete input k at the last event; `count` counts events and `last` is the
 * time of the last one. It is strict: whatever the standard does not allow in a state is an Error, k in step mode
 * included. The parameter `kind` says what happens every `period`. Events happen up to NEAR earlier than they are
 * announced. */
#include <fenv.h>
#include <math.h>
#include <string.h>

#include "../fmi_names.h"

#ifndef NEAR
#define NEAR 1e-9 /* [s] */
#endif

/* Kinds; PAUSED: early without an event; ENDLESS, ENDING: with period 0, in the first event iteration. NOWHERE
 * announces NaN after the first event, PASSED always the first event; TWICE announces each event once more when it has
 * come. UPWARD is ANNOUNCED, and leaves that rounding mode behind after steps, which it computes in the usual one. */
enum { ANNOUNCED, EARLY, PAUSED, AT_END, ENDLESS, ENDING, BACKWARD, STUCK, DISCARDS, NOWHERE, PASSED, TWICE, UPWARD };
enum { U, K, Z, LEVEL, COUNT, LAST, STEPS, PERIOD, WHAT, TIME = 100 }; /* value references */

typedef struct {
    int state;
    bool events, early;
    int32_t k, level, count, steps, kind;
    double now, u, z, last, period, next;
} Values;

#define REFUSED (events && !strcmp(token, "refuses"))
#define ENTERED m->v.next = begin + m->v.period
#include "strict.h"

static void start(Model *m) {
    m->v = (Values){.events = m->v.events, .early = m->v.early, .period = 0.03, .last = -1.0};
}

Status fmi3ExitInitializationMode(Instance c) {
    IN(BIT(INITIALIZATION));
    m->v.level = m->v.k;
    m->v.state = m->v.events ? EVENT : STEP;
    return fmi3OK;
}
Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *terminate,
    Flag *nominals, Flag *values, Flag *has_next, double *next) {
    IN(BIT(EVENT));
    *terminate = *nominals = *values = false;
    *again = m->v.kind == ENDLESS && (m->v.count > 1 || m->v.period == 0.0);
    m->v.level = m->v.k;
    if (m->v.now > m->v.next - NEAR) {
        m->v.count++;
        m->v.last = m->v.now;
        if (m->v.kind != PASSED && (m->v.kind != TWICE || m->v.count % 2 == 0)) m->v.next += m->v.period;
        *terminate = m->v.kind == ENDING && (m->v.count == 2 || m->v.period == 0.0);
    }
    *has_next = m->v.kind == ANNOUNCED || m->v.kind >= ENDLESS;
    *next = m->v.kind == NOWHERE && m->v.count ? NAN : m->v.next;
    return fmi3OK;
}
ACCESS(REAL, double, IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP) | BIT(TERMINATED));
    EACH(value[i] = vr[i] == Z ? m->v.z : vr[i] == LAST ? m->v.last : vr[i] == PERIOD ? m->v.period : m->v.now),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    EACH(*(vr[i] == U ? &m->v.u : &m->v.period) = value[i]))
ACCESS(INTEGER, Whole, IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    EACH(value[i] = vr[i] == LEVEL   ? m->v.level
                    : vr[i] == COUNT ? m->v.count
                    : vr[i] == STEPS ? m->v.steps
                                     : m->v.k),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT)); /* discrete: not in step mode */
    EACH(*(vr[i] == K ? &m->v.k : &m->v.kind) = value[i]))
Status fmi3DoStep(Instance c, double t, double h, Flag no_set_prior, Flag *event,
    Flag *terminate, Flag *early, double *last) {
    STEPS_FROM(t);
    if (m->v.kind == UPWARD) fesetround(FE_TONEAREST);
    const bool due = m->v.next < t + h + 1e-9, inside = m->v.next < t + h - 1e-9;
    const bool told = m->v.kind == ANNOUNCED || m->v.kind == AT_END || m->v.kind >= NOWHERE;
    *event = due && m->v.kind != PAUSED;
    *terminate = false;
    *early = inside && m->v.early && !told;
    if (*early) h = m->v.next - t;
    if (m->v.kind == BACKWARD && due) h = -0.1, *early = true;
    if (m->v.kind == STUCK && due) h = 0.0, *event = false, *early = true;
    if (m->v.kind == DISCARDS && due) return *terminate = true, *last = t, fmi3Discard;
    m->v.steps++;
    m->v.z += h * m->v.u * m->v.level;
    m->v.now = *last = t + h;
    if (m->v.kind == PAUSED && due) m->v.next += m->v.period;
    if (m->v.kind == UPWARD) fesetround(FE_UPWARD);
    return fmi3OK;
}
