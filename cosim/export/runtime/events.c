/* Components that report events or return early, without clocks: see component.h. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "event_steps.h"

static EventSteps *steps_of(const Component *m) { return m->integrator; }

static bool make(Component *m, const char *name, const char *token, const char *resources) {
    static const char *const names[] = {"EnterEventMode", "UpdateDiscreteStates", "EnterStepMode"};
    const EventSetup *const setup = m->setup;
    const size_t inputs = setup->n * sizeof(EventInputs), before = setup->n_values * sizeof(double);
    m->instance = m->f3->InstantiateCoSimulation(name, token, resources, false, false, setup->event_mode,
        setup->variable_step, REQUIRED(m), m, m->say, m->update);
    if (!m->instance && setup->event_mode) { /* as in a run of the system */
        m->say(m, fmi3Warning, "", "it cannot be instantiated with event mode, and processes its events by itself");
        m->exchange = NULL;
        m->instance = m->f3->InstantiateCoSimulation(
            name, token, resources, false, false, false, false, REQUIRED(m), m, m->say, m->update);
        return m->instance != NULL;
    }
    EventSteps *const s = m->integrator = calloc(1, sizeof *s + inputs + before);
    if (!s || !m->instance) return false;
    *s = (EventSteps){.instance = m->instance,
        .stepped = m->instance,
        .inputs = (EventInputs *)(s + 1),
        .event_mode = setup->event_mode,
        .variable_step = setup->variable_step,
        .internal = setup->internal};
    memcpy(&s->call[EVENT_DO_STEP], &m->f3->DoStep, sizeof s->call[0]);
    if (m->follows) {
        memcpy(&s->call[EVENT_DO_STEP], &m->step, sizeof s->call[0]);
        s->stepped = m->updates;
    }
    for (int i = 0; setup->event_mode && i < 3; i++) {
        const ExchangeCall call = m->find(m->library, m->version, names[i]);
        if (!call) return false;
        memcpy(&s->call[EVENT_ENTER + i], &call, sizeof call);
    }
    m->memory[0] = (ComponentMemory){&s->memory, sizeof s->memory};
    m->memory[1] = (ComponentMemory){(char *)(s + 1) + inputs, before};
    return true;
}

static uint32_t begin(Component *m) { return event_steps_begin(steps_of(m), m->begin); }

static void bind(Component *m, bool stepping) {
    steps_of(m)->stepping = stepping;
    steps_of(m)->n_inputs = 0;
}

static void wait_for_events(Component *m, EngineTransfer *t) {
    EventSteps *const s = steps_of(m);
    EventInputs *const d = &s->inputs[s->n_inputs++];
    const EventInputs *const last = s->n_inputs > 1 ? d - 1 : NULL;
    *d = (EventInputs){.steps = s,
        .call = t->call3,
        .references = t->references,
        .n_references = t->n_references,
        .data = t->data,
        .n_data = t->n_data,
        .before = last ? (char *)last->before + last->size : m->memory[1].at,
        .size = t->n_data * sizeof(double)}; /* so much there is for each, of whatever type */
    t->call3 = event_steps_set;
    t->references = (const uint32_t *)(const void *)d;
}

static uint32_t change(Component *m, bool begins, bool done) {
    (void)done;
    EventSteps *const s = steps_of(m);
    if (!s->stepping || !s->event_mode) return fmi3OK;
    return begins ? event_steps_enter(s, s->report.time) : event_steps_leave(s, s->report.time);
}

static const char *why(const Component *m, uint32_t *number, double *time) {
    static const char *const texts[] = {"a function failed, number", "a function failed, number",
        "event iteration did not converge, in function", "too many events in one communication step, in function",
        "it returned early at a time outside of its step, from function",
        "the next event that it announces is at NaN, by function", NULL};
    const EventReport *const r = &steps_of(m)->report;
    *number = r->index + 1;
    *time = r->time;
    return r->end < sizeof texts / sizeof *texts ? texts[r->end] : texts[0];
}

const Exchange events = {make, begin, bind, wait_for_events, change, why, NULL, event_steps_step};
