/* Steps of FMUs that report events or return early: see event_steps.h. */
#include "event_steps.h"

#include "environment.h"

#include <math.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR }; /* statuses of FMI */
enum { UPDATES = 1000, EVENTS = 10000 };

static uint32_t failed(EventSteps *s, EventEnd end, uint32_t index, double t, uint32_t status) {
    s->report = (EventReport){.end = end, .index = index, .status = status, .time = t};
    return status > WARNING ? status : ERROR;
}

#define TRY(number, expression)                                                                  \
    do {                                                                                         \
        const uint32_t status_ = (expression);                                                   \
        if (status_ > WARNING) return failed(s, EVENT_CALL_FAILED, number, t, status_);          \
    } while (0)
#define PASS(expression)                       \
    do {                                       \
        const uint32_t passed_ = (expression); \
        if (passed_ > WARNING) return passed_; \
    } while (0)

static uint32_t plain(EventSteps *s, EventFunction number, double t) {
    TRY(number, ((uint32_t(*)(void *))s->call[number])(s->instance));
    return OK;
}

/* Times that differ by rounding only are the same. */
static double resolution(double t, double h) {
    const double a = 1e-9 * (1.0 + fabs(t)), b = 1e-3 * h;
    return a < b ? a : b;
}

uint32_t event_steps_set(void *instance, const uint32_t *inputs, size_t n, void *data, size_t n_data) {
    const EventInputs *const d = (const EventInputs *)(const void *)inputs;
    (void)n;
    return d->steps->stepping ? (uint32_t)OK : d->call(instance, d->references, d->n_references, data, n_data);
}

static bool inputs_changed(const EventSteps *s) {
    for (int32_t i = 0; i < s->n_inputs; i++)
        if (memcmp(s->inputs[i].data, s->inputs[i].before, s->inputs[i].size)) return true;
    return false;
}

static uint32_t set_inputs(EventSteps *s, double t) {
    for (const EventInputs *d = s->inputs; d < s->inputs + s->n_inputs; d++) {
        TRY(EVENT_SET, d->call(s->instance, d->references, d->n_references, d->data, d->n_data));
        memcpy(d->before, d->data, d->size);
    }
    return OK;
}

uint32_t event_steps_enter(EventSteps *s, double t) { return s->memory.ends ? (uint32_t)OK : plain(s, EVENT_ENTER, t); }

uint32_t event_steps_leave(EventSteps *s, double t) {
    typedef uint32_t (*Update)(void *, bool *, bool *, bool *, bool *, bool *, double *);
    bool again = true, terminate = false, nominals = false, states = false, has_next = false;
    double next = INFINITY;
    if (s->memory.ends) return OK;
    for (int k = 0; again; k++) {
        if (k == UPDATES) return failed(s, EVENT_NOT_CONVERGED, EVENT_UPDATE, t, ERROR);
        again = has_next = false;
        TRY(EVENT_UPDATE, ((Update)s->call[EVENT_UPDATE])(
            s->instance, &again, &terminate, &nominals, &states, &has_next, &next));
        s->memory.ends = terminate;
        if (terminate) return failed(s, EVENT_TERMINATED, EVENT_UPDATE, t, ERROR);
    }
    if (has_next && isnan(next)) return failed(s, EVENT_BAD_EVENT, EVENT_UPDATE, t, ERROR);
    s->memory.next_event = has_next ? next : INFINITY;
    return plain(s, EVENT_LEAVE, t);
}

uint32_t event_steps_begin(EventSteps *s, double t) {
    s->memory = (EventMemory){.next_event = INFINITY};
    s->report.time = t;
    for (const EventInputs *d = s->inputs; d < s->inputs + s->n_inputs; d++) memcpy(d->before, d->data, d->size);
    s->stepping = true;
    return s->event_mode ? event_steps_leave(s, t) : (uint32_t)OK;
}

const char *event_steps_why(const EventReport *report) {
    static const char *const functions[] = {"", "fmi3EnterEventMode failed", "fmi3UpdateDiscreteStates failed",
        "fmi3EnterStepMode failed", "setting discrete inputs failed"};
    static const char *const said[] = {"", "",
        "event iteration did not converge: every update of discrete states requires another one "
        "(fmi3UpdateDiscreteStates); correct the model's event equations",
        "more than 10000 events in one communication step: the model switches back and forth (chattering), returns "
        "early without progress, or announces a next event that is never later; add hysteresis to its conditions",
        "fmi3DoStep returned early at a time outside of its step",
        "the next event that it announces is at NaN (nextEventTime of fmi3UpdateDiscreteStates)",
        "it asks for the end of the simulation"};
    return report->end == EVENT_CALL_FAILED ? functions[report->index] : said[report->end];
}

/* Where to step from `now`: to the announced event, or to the end of the internal step that holds it. An event that is
 * later by less than `near` has been tried at `now`; an FMU that still announces it wants to be there. */
static double target(const EventSteps *s, double now, double end, double near) {
    double to = s->memory.next_event;
    if (!s->event_mode || !s->variable_step || !(to > now)) return end;
    if (!(to < end - near)) return end;
    if (s->internal > 0.0) {
        const double n = (to - now - near) / s->internal; /* internal steps until then, rounded up */
        if (n < 1e15) to = now + ((double)(int64_t)n + 1.0) * s->internal;
    }
    return to < end - near ? to : end;
}

/* Event mode at time t within a step, again where the FMU announces the next event for then; `ends`: where it asks for
 * the end of the simulation there. */
static uint32_t process_event(EventSteps *s, double t, bool *ends) {
    uint32_t status = OK;
    for (int k = 0; status <= WARNING && (!k || s->memory.next_event <= t); k++) {
        if (k == EVENTS) return failed(s, EVENT_TOO_MANY, EVENT_UPDATE, t, ERROR);
        status = event_steps_enter(s, t);
        if (status <= WARNING) status = set_inputs(s, t);
        if (status <= WARNING) status = event_steps_leave(s, t);
        environment_after_call(s->environment);
    }
    *ends = status > WARNING && s->report.end == EVENT_TERMINATED;
    return *ends ? (uint32_t)OK : status;
}

static uint32_t step(
    EventSteps *s, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    const double end = t + h, near = resolution(t, h);
    double now = t;
    *event = *early = false;
    s->report.end = EVENT_FINE;
    *terminate = s->memory.ends != 0;
    if (*terminate) (void)failed(s, EVENT_TERMINATED, EVENT_UPDATE, t, ERROR);
    else if (s->event_mode && (s->memory.next_event <= t + near || inputs_changed(s)))
        PASS(process_event(s, t, terminate));
    *early = *terminate;
    *last = t;
    for (int k = 0; k < EVENTS && !*terminate; k++) {
        const double to = target(s, now, end, near);
        bool needed = false;
        *last = now;
        TRY(EVENT_DO_STEP, ((EngineStep3)s->call[EVENT_DO_STEP])(
            s->stepped, now, to - now, no_set_prior, &needed, terminate, early, last));
        environment_after_call(s->environment);
        const bool returned = *early || (*terminate && !ENGINE_IS_WHOLE(*last, now, to - now));
        if (returned && !s->variable_step) return OK; /* which it was not allowed to */
        if (returned && !(*last >= now - near && *last <= to + near))
            return failed(s, EVENT_BAD_TIME, EVENT_DO_STEP, *last, ERROR);
        now = returned ? *last : to;
        const bool complete = now >= end - near;
        *last = s->report.time = now;
        if (s->event_mode && !*terminate && (needed || s->memory.next_event <= now + near))
            PASS(process_event(s, now, terminate));
        *early = !complete && *terminate;
        if (complete) return OK;
    }
    if (*terminate) return OK;
    return failed(s, EVENT_TOO_MANY, EVENT_DO_STEP, now, ERROR);
}

uint32_t event_steps_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early,
    double *last) {
    EventSteps *const s = steps;
    environment_begin(s->environment);
    const uint32_t status = step(s, t, h, no_set_prior, event, terminate, early, last);
    environment_end(s->environment);
    return status;
}
