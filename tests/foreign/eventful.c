/* A small FMI 3.0 Co-Simulation FMU with event mode and no clocks, from the standard's headers alone.
 *
 * dz/dt = u * level, where `level` is the discrete input k at the last event; `count` counts events and `last` is the
 * time of the last one. It is strict: whatever the standard does not allow in a state is an Error, k in step mode
 * included. The parameter `kind` says what happens every `period`. */
#include <math.h>
#include <string.h>

#include "../fmi_names.h"

enum { ANNOUNCED, EARLY, PAUSED, AT_END, ENDLESS, ENDING, BACKWARD, STUCK }; /* kinds; PAUSED: early without an event */
enum { U, K, Z, LEVEL, COUNT, LAST, STEPS, PERIOD, WHAT, TIME = 100 };       /* value references */

typedef struct {
    int state;
    bool events, early;
    int32_t k, level, count, steps, kind;
    double now, u, z, last, period, next;
} Values;

#define REFUSED (events && !strcmp(token, "refuses"))
#include "strict.h"

static void start(Model *m) {
    m->v = (Values){.events = m->v.events, .early = m->v.early, .period = 0.03, .last = -1.0};
}

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean a, double tolerance, double begin, fmi3Boolean b, double end) {
    IN(BIT(INSTANTIATED));
    m->v.now = begin;
    m->v.next = begin + m->v.period;
    m->v.state = INITIALIZATION;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    IN(BIT(INITIALIZATION));
    m->v.level = m->v.k;
    m->v.state = m->v.events ? EVENT : STEP;
    return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *has_next, double *next) {
    IN(BIT(EVENT));
    *terminate = *nominals = *values = false;
    *again = m->v.kind == ENDLESS && m->v.count > 1;
    m->v.level = m->v.k;
    if (m->v.now > m->v.next - 1e-9) {
        m->v.count++;
        m->v.last = m->v.now;
        m->v.next += m->v.period;
        *terminate = m->v.kind == ENDING && m->v.count == 2;
    }
    *has_next = m->v.kind == ANNOUNCED || m->v.kind >= ENDLESS;
    *next = m->v.next;
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, double value[], size_t k) {
    IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP) | BIT(TERMINATED));
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == Z ? m->v.z : vr[i] == LAST ? m->v.last : vr[i] == PERIOD ? m->v.period : m->v.now;
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const double value[], size_t k) {
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    for (size_t i = 0; i < n; i++) *(vr[i] == U ? &m->v.u : &m->v.period) = value[i];
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, int32_t value[], size_t k) {
    IN(BIT(INITIALIZATION) | BIT(EVENT) | BIT(STEP));
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == LEVEL ? m->v.level : vr[i] == COUNT ? m->v.count : vr[i] == STEPS ? m->v.steps : m->v.k;
    return fmi3OK;
}
fmi3Status fmi3SetInt32(
    fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const int32_t value[], size_t k) {
    IN(BIT(INSTANTIATED) | BIT(INITIALIZATION) | BIT(EVENT)); /* discrete: not in step mode */
    for (size_t i = 0; i < n; i++) *(vr[i] == K ? &m->v.k : &m->v.kind) = value[i];
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance instance, double t, double h, fmi3Boolean no_set_prior, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, double *last) {
    STEPS_FROM(t);
    const bool due = m->v.next < t + h + 1e-9, inside = m->v.next < t + h - 1e-9;
    const bool told = m->v.kind == ANNOUNCED || m->v.kind == AT_END;
    *event = due && m->v.kind != PAUSED;
    *terminate = false;
    *early = inside && m->v.early && !told;
    if (*early) h = m->v.next - t;
    if (m->v.kind == BACKWARD && due) h = -0.1, *early = true;
    if (m->v.kind == STUCK && due) h = 0.0, *event = false, *early = true;
    m->v.steps++;
    m->v.z += h * m->v.u * m->v.level;
    m->v.now = *last = t + h;
    if (m->v.kind == PAUSED && due) m->v.next += m->v.period;
    return fmi3OK;
}
