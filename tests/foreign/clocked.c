/* A small FMI 3.0 FMU with a clock, which owes nothing to this project but its description (clocked.py): from the
 * standard's headers alone.
 *
 * When the clock ticks, x := x + u and y := x; z is the integral of y. It is strict: whatever the standard does not
 * allow in a state is an Error, clocked variables outside of their ticks and steps beyond a tick included. KIND says
 * how its interval is known; `pulse` ticks at every third tick. */
#include <math.h>

#include "../fmi_names.h"

enum { CONSTANT, FIXED, TUNABLE, CHANGING, COUNTDOWN, EARLY, ENDLESS };
enum { U, Y, Z, TICKS, LAST, PERIOD, SHIFT, START, CLOCK, PULSE, W, TIME = 100 }; /* value references */

typedef struct {
    int state;
    bool events, early, ticking, pulsing, begin, start, told, known;
    int32_t ticks;
    double now, u, x, y, z, w, last, period, shift, next;
} Values;

#define REFUSED (early || n || update) /* these are not for FMUs with clocks */
#define ENTERED
#define OWN_STEP_MODE
#include "strict.h"

static void start(Model *m) {
    const double period = KIND == CONSTANT ? 1.0 / 300.0 : KIND == FIXED ? 0.02 : 0.01;
    m->v = (Values){.events = m->v.events, .period = period, .last = -1.0};
}

static bool due(const Model *m) { return m->v.known && fabs(m->v.next - m->v.now) < 1e-9; }

Status fmi3SetDebugLogging(Instance c, Flag on, size_t n, const Text categories[]) { return fmi3OK; }
Status fmi3ExitInitializationMode(Instance c) {
    IN(BIT(INITIALIZATION));
    if (m->v.events && KIND >= FIXED && KIND <= COUNTDOWN && !m->v.told)
        return error(m, "nobody has asked for the interval");
    m->v.state = m->v.events ? EVENT : STEP;
    if (KIND == COUNTDOWN) return fmi3OK;
    m->v.next = m->v.now + (KIND == CHANGING ? m->v.period : KIND == FIXED ? m->v.shift : 0.0);
    m->v.known = true;
    return fmi3OK;
}
Status fmi3EnterStepMode(Instance c) {
    IN(BIT(EVENT));
    if (m->v.ticking || m->v.pulsing) return error(m, "discrete states have not been updated");
    m->v.state = STEP;
    return fmi3OK;
}

Status fmi3SetClock(Instance c, const Reference vr[], size_t n, const fmi3Clock value[]) {
    IN(BIT(EVENT));
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != CLOCK) return error(m, "%u is no input clock", vr[i]);
        if (!value[i]) continue;
        if (m->v.ticking) return error(m, "the clock ticks already");
        if (!due(m)) return error(m, "the clock ticks at %.12g, not at %.12g", m->v.next, m->v.now);
        m->v.ticking = true;
        m->v.known = false;
        m->v.pulsing = m->v.ticks % 3 == 2;
    }
    return fmi3OK;
}
Status fmi3GetClock(Instance c, const Reference vr[], size_t n, fmi3Clock value[]) {
    IN(BIT(EVENT));
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == PULSE ? m->v.pulsing : m->v.ticking;
    return fmi3OK;
}
static double following(Model *m) { return KIND == CHANGING ? 0.01 * (1 + m->v.ticks % 3) : m->v.period; }
Status fmi3GetIntervalDecimal(
    Instance c, const Reference vr[], size_t n, double value[], fmi3IntervalQualifier q[]) {
    IN(BIT(INITIALIZATION) | BIT(EVENT));
    m->v.told = true;
    if (KIND == COUNTDOWN) {
        q[0] = m->v.start ? fmi3IntervalChanged : fmi3IntervalNotYetKnown;
        value[0] = 0.015;
        if (m->v.start) m->v.next = m->v.now + 0.015, m->v.known = true;
        m->v.start = false;
        return fmi3OK;
    }
    if (KIND == CHANGING && m->v.state == EVENT && !m->v.ticking) return error(m, "the clock does not tick");
    value[0] = m->v.state == INITIALIZATION ? m->v.period : following(m);
    q[0] = m->v.state == INITIALIZATION || KIND == TUNABLE || KIND == CHANGING ? fmi3IntervalChanged
                                                                               : fmi3IntervalUnchanged;
    if (KIND == TUNABLE && m->v.state == EVENT) m->v.next = m->v.now + m->v.period;
    return fmi3OK;
}
Status fmi3GetIntervalFraction(Instance c, const Reference vr[], size_t n, uint64_t counter[],
    uint64_t resolution[], fmi3IntervalQualifier q[]) {
    double decimal;
    if (KIND != COUNTDOWN || !FRACTIONS) return error(c, "no fractions here");
    const Status status = fmi3GetIntervalDecimal(c, vr, n, &decimal, q);
    const bool known = q[0] != fmi3IntervalNotYetKnown;
    counter[0] = known ? 3 : 0;
    resolution[0] = known ? 200 : 0;
    return status;
}
Status fmi3GetShiftDecimal(Instance c, const Reference vr[], size_t n, double value[]) {
    IN(BIT(INITIALIZATION));
    value[0] = m->v.shift;
    return fmi3OK;
}
Status fmi3GetShiftFraction(
    Instance c, const Reference vr[], size_t n, uint64_t counter[], uint64_t resolution[]) {
    return error(c, "no fractions here");
}
Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *terminate,
    Flag *nominals, Flag *values, Flag *has_next, double *next) {
    IN(BIT(EVENT));
    *terminate = *nominals = *values = *has_next = false;
    *again = KIND == ENDLESS;
    *next = 0.0;
    if (m->v.ticking) {
        m->v.x = m->v.y = m->v.x + m->v.u;
        m->v.last = m->v.now;
        if (m->v.pulsing) m->v.w = m->v.x;
        if (KIND != COUNTDOWN) m->v.next += following(m), m->v.known = true;
        m->v.ticks++;
    }
    m->v.ticking = m->v.pulsing = false;
    return fmi3OK;
}

Status fmi3GetFloat64(Instance c, const Reference vr[], size_t n, double value[], size_t k) {
    IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP) | BIT(TERMINATED));
    for (size_t i = 0; i < n; i++) {
        const bool initializing = m->v.state == INITIALIZATION;
        switch (vr[i]) {
            case Z: value[i] = m->v.z; break;
            case TIME: value[i] = m->v.now; break;
            case PERIOD: value[i] = m->v.period; break;
            case SHIFT: value[i] = m->v.shift; break;
            case W:
                if (!m->v.pulsing) return error(m, "w is read while pulse does not tick");
                value[i] = m->v.x + m->v.u;
                break;
            default:
                if (!m->v.ticking && !initializing) return error(m, "%u is read while its clock does not tick", vr[i]);
                value[i] = vr[i] == LAST  ? (m->v.ticking ? m->v.now : m->v.last)
                           : initializing ? m->v.x
                                          : m->v.x + m->v.u;
        }
    }
    return fmi3OK;
}
Status fmi3SetFloat64(
    Instance c, const Reference vr[], size_t n, const double value[], size_t k) {
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    for (size_t i = 0; i < n; i++) {
        const bool before = m->v.state <= INITIALIZATION;
        if (vr[i] == U) {
            if (!before && !m->v.ticking) return error(m, "u is set while its clock does not tick");
            m->v.u = value[i];
        } else if (vr[i] == PERIOD) {
            if (KIND == TUNABLE && value[i] > 1.0) return fmi3Discard;
            if (!before && (KIND != TUNABLE || m->v.state != EVENT))
                return error(m, "period is set in state %d", m->v.state);
            m->v.period = value[i];
        } else {
            if (!before) return error(m, "shift is fixed");
            m->v.shift = value[i];
        }
    }
    return fmi3OK;
}
Status fmi3GetInt32(Instance c, const Reference vr[], size_t n, int32_t value[], size_t k) {
    IN(BIT(INITIALIZATION) | BIT(EVENT));
    if (!m->v.ticking && m->v.state == EVENT) return error(m, "ticks is read while its clock does not tick");
    for (size_t i = 0; i < n; i++) value[i] = m->v.ticks + m->v.ticking;
    return fmi3OK;
}
Status fmi3SetBoolean(
    Instance c, const Reference vr[], size_t n, const bool value[], size_t k) {
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT)); /* discrete: not in step mode */
    for (size_t i = 0; i < n; i++) {
        m->v.start |= value[i] && !m->v.begin; /* a rising edge */
        m->v.begin = value[i];
    }
    return fmi3OK;
}
Status fmi3GetBoolean(Instance c, const Reference vr[], size_t n, bool value[], size_t k) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->v.begin;
    return fmi3OK;
}
Status fmi3DoStep(Instance c, double t, double h, Flag no_set_prior, Flag *event,
    Flag *terminate, Flag *early, double *last) {
    STEPS_FROM(t);
    if (m->v.events && m->v.known && m->v.next < t + h - 1e-9)
        return error(m, "a step to %.12g passes the tick at %.12g", t + h, m->v.next);
    if (KIND == EARLY) h *= 0.5;
    m->v.z += h * m->v.y;
    m->v.now = t + h;
    *event = *terminate = false;
    *early = KIND == EARLY;
    *last = m->v.now;
    return fmi3OK;
}
