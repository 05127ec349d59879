/* A small FMI 3.0 Co-Simulation FMU with a triggered input clock `in` and an output clock `out`, from the standard's
 * headers alone.
 *
 * With a period, `out` ticks every `period` and y counts. With relay 1 it ticks when `in` does, and y = x + 1; with
 * relay 2 that comes one update later. `count` counts ticks of `in`, `last` is the time of the last one, and `got` is
 * what x was then. With relay 3 to 5 no event is announced: a step returns early where `out` ticks; with 4 at a time
 * before the step, with 5 without progress, and with 6 also after half of a step between 1 and 9 ms.
 * At `end` it asks for the end of the simulation, as `how` says. It is strict: x is set and y is read only while their
 * clocks are active. Events happen up to NEAR earlier than they are announced. */
#include <math.h>
#include <string.h>

#include "../fmi_names.h"

#ifndef NEAR
#define NEAR 1e-9 /* [s] */
#endif

enum { X, Y, COUNT, LAST, GOT, PERIOD, RELAY, IN_CLOCK, OUT_CLOCK, END, HOW, TIME = 100 }; /* value references */
enum { WHOLE, DISCARDED, EARLY, IN_EVENT_MODE }; /* how */

typedef struct {
    int state;
    bool events, early, in, out, told;
    int32_t count, relay, how;
    double now, x, y, last, got, period, next, end;
} Values;

#define REFUSED (!events)
#define ENTERED m->v.next = m->v.period > 0.0 ? begin + m->v.period : INFINITY
#include "strict.h"

static void start(Model *m) { m->v = (Values){.events = m->v.events, .early = m->v.early, .last = -1.0, .end = 1e9}; }

Status fmi3ExitInitializationMode(Instance c) {
    IN(BIT(INITIALIZATION));
    m->v.state = EVENT;
    return fmi3OK;
}
Status fmi3SetClock(Instance c, const Reference vr[], size_t n, const fmi3Clock value[]) {
    IN(BIT(EVENT));
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != IN_CLOCK || m->v.in) return error(m, "clock %u is set again", (unsigned)vr[i]);
        m->v.in = value[i];
    }
    return fmi3OK;
}
Status fmi3GetClock(Instance c, const Reference vr[], size_t n, fmi3Clock value[]) {
    IN(BIT(EVENT));
    if (m->v.relay == 1 && m->v.in && !m->v.told) m->v.out = true, m->v.y = m->v.x + 1.0;
    if (m->v.now > m->v.next - NEAR && !m->v.told) m->v.out = true, m->v.y += 1.0;
    for (size_t i = 0; i < n; i++) value[i] = m->v.out && !m->v.told;
    m->v.told |= m->v.out;
    return fmi3OK;
}
Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *terminate,
    Flag *nominals, Flag *values, Flag *has_next, double *next) {
    IN(BIT(EVENT));
    *nominals = *values = false;
    *terminate = m->v.how == IN_EVENT_MODE && m->v.now > m->v.end - 1e-9;
    if (m->v.in) m->v.count++, m->v.last = m->v.now, m->v.got = m->v.x;
    if (m->v.now > m->v.next - NEAR) m->v.next += m->v.period;
    *again = m->v.out = m->v.relay == 2 && m->v.in;
    if (m->v.out) m->v.y = m->v.x + 1.0;
    m->v.in = m->v.told = false;
    *has_next = m->v.period > 0.0 && m->v.relay < 3;
    *next = m->v.next;
    return fmi3OK;
}
ACCESS(REAL, double, IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP) | BIT(TERMINATED));
    EACH({
        if (vr[i] == Y && !(m->v.state == EVENT && m->v.out)) return error(m, "y is read, and its clock is not active");
        value[i] = vr[i] == Y ? m->v.y : vr[i] == LAST  ? m->v.last
                                : vr[i] == GOT ? m->v.got
                                : vr[i] == END ? m->v.end
                                               : m->v.period;
    }),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT));
    EACH({
        if (vr[i] == X && m->v.state == EVENT && !m->v.in) return error(m, "x is set, and its clock is not active");
        *(vr[i] == X ? &m->v.x : vr[i] == END ? &m->v.end : &m->v.period) = value[i];
    }))
ACCESS(INTEGER, Whole, IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    EACH(value[i] = vr[i] == COUNT ? m->v.count : vr[i] == HOW ? m->v.how : m->v.relay),
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION)); EACH(*(vr[i] == HOW ? &m->v.how : &m->v.relay) = value[i]))
Status fmi3DoStep(Instance c, double t, double h, Flag no_set_prior, Flag *event,
    Flag *terminate, Flag *early, double *last) {
    STEPS_FROM(t);
    *event = *terminate = *early = false;
    if (m->v.next < t + h - NEAR) {
        if (m->v.relay < 3 || !m->v.early)
            return error(m, "a step to %.12g, over the event at %.12g", t + h, m->v.next);
        *early = true;
        *event = m->v.relay == 3;
        h = m->v.relay == 3 ? m->v.next - t : m->v.relay == 4 ? -1.0 : 0.0;
    } else if (m->v.relay == 6 && h > 1e-3 && h < 9e-3) {
        *early = true;
        h *= 0.5;
    } else if (m->v.relay == 3) *event = m->v.next < t + h + 1e-9;
    if (m->v.how < IN_EVENT_MODE && t + h > m->v.end - 1e-9) {
        *terminate = true;
        *early |= m->v.how == EARLY;
        *last = t;
        if (m->v.how == DISCARDED) return fmi3Discard;
        if (m->v.how == EARLY) h = m->v.end - t;
    }
    m->v.now = *last = t + h;
    return fmi3OK;
}
