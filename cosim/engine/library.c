/* What Python calls of the engine: a shared library of its own. */
#include "adaptive.h"
#include "clocked_steps.h"
#include "engine.h"
#include "environment.h"
#include "event_steps.h"
#include "exact_values.h"
#include "integrator.h"
#include "intermediate.h"
#include "table.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* `a`: NULL where all steps are fixed. */
EXPORT int cosim_engine_run(Engine *e, EngineAdaptive *a, int64_t end) {
    return a ? engine_adaptive_run(e, a, end) : engine_run(e, end);
}
/* Parts of the instant at `tick`, time t; with `resumed` of the one in which a component has failed. */
EXPORT int cosim_engine_instant(
    Engine *e, EngineAdaptive *a, double t, bool resumed, bool arrives, bool samples, bool advances) {
    e->environment = environment_bits();
    if (!resumed) engine_look_up(e, e->tick);
    int result = !arrives ? ENGINE_AT_END : a ? engine_adaptive_arrive(e, a, t) : engine_arrive(e, t);
    if (!result && samples) result = a ? engine_adaptive_sample(e, a, t) : engine_sample(e, t);
    return result || !advances ? result : a ? engine_adaptive_advance(e, a, t) : engine_advance(e, t);
}
EXPORT int cosim_engine_cut(Engine *e, EngineAdaptive *a, int64_t tick) { return engine_adaptive_cut(e, a, tick); }
EXPORT void cosim_engine_publish(Engine *e) { engine_publish(e); }
EXPORT int cosim_engine_follow_events(Engine *e, double *before) { return engine_follow_events(e, before); }
EXPORT int cosim_engine_settle(Engine *e, const bool *settles, double *before, size_t n_values, bool late) {
    return (late ? engine_settle_late : engine_settle)(e, settles, before, n_values);
}
EXPORT size_t cosim_engine_loop_work(int32_t n) { return engine_loop_work(n); }
EXPORT size_t cosim_engine_size(void) {
    return sizeof(Engine) + sizeof(EngineComponent) + sizeof(EngineLoop) + sizeof(EngineDerivative)
           + sizeof(EngineAdaptive) + sizeof(Table) + sizeof(Integrator) + sizeof(EventSteps) + sizeof(EventInputs)
           + sizeof(ClockedFmu) + sizeof(ClockedSetup) + sizeof(ClockedGroup) + sizeof(ClockSetup) + sizeof(ClockWire)
           + sizeof(ExactValues) + sizeof(ExactItem) + sizeof(IntermediateStep);
}
/* The states of n FMUs. Returns how many were saved or restored; if not all, `status` is that of the next one. */
EXPORT int32_t cosim_engine_save(const EngineStates *fmus, int32_t n, void **states, uint32_t *status) {
    int32_t i = 0;
    while (i < n && (*status = fmus[i].get(fmus[i].instance, &states[i])) <= 1) i++;
    return i;
}
EXPORT int32_t cosim_engine_restore(const EngineStates *fmus, int32_t n, void **states, uint32_t *status) {
    int32_t i = 0;
    while (i < n && (*status = fmus[i].set(fmus[i].instance, states[i])) <= 1) i++;
    return i;
}
EXPORT void cosim_engine_free(const EngineStates *fmus, int32_t n, void **states) {
    for (int32_t i = 0; i < n; i++)
        if (states[i]) fmus[i].free(fmus[i].instance, &states[i]);
}
EXPORT uint32_t cosim_table_step(void *table, double t, double h, int no_set_prior) {
    return table_step(table, t, h, no_set_prior);
}

EXPORT const char *cosim_integrator_function(uint32_t version, uint32_t number) {
    return integrator_function(version, number);
}
EXPORT void cosim_integrator_why(const IntegratorSetup *setup, const IntegratorReport *report, const char *state,
    char *text, size_t size) {
    integrator_why(setup, report, state, text, size);
}
EXPORT bool cosim_integrator_needs(const IntegratorSetup *setup, uint32_t number) {
    return integrator_needs(setup, number);
}
EXPORT size_t cosim_integrator_size(const IntegratorSetup *setup) { return integrator_size(setup); }
EXPORT Integrator *cosim_integrator_make(void *memory, const IntegratorSetup *setup, const uint32_t *references,
    void *instance, void *const *calls) {
    return integrator_make(memory, setup, references, instance, calls);
}
EXPORT uint32_t cosim_integrator_begin(void *integrator, double t) { return integrator_begin(integrator, t); }
EXPORT uint32_t cosim_integrator_step2(void *integrator, double t, double h, int no_set_prior) {
    return integrator_step2(integrator, t, h, no_set_prior);
}
EXPORT uint32_t cosim_integrator_step3(void *integrator, double t, double h, bool no_set_prior, bool *event,
    bool *terminate, bool *early, double *last) {
    return integrator_step3(integrator, t, h, no_set_prior, event, terminate, early, last);
}

EXPORT uint32_t cosim_event_steps_set(void *instance, const uint32_t *inputs, size_t n, void *data, size_t n_data) {
    return event_steps_set(instance, inputs, n, data, n_data);
}
EXPORT uint32_t cosim_event_steps_begin(EventSteps *s, double t) { return event_steps_begin(s, t); }
EXPORT uint32_t cosim_event_steps_enter(EventSteps *s, double t) { return event_steps_enter(s, t); }
EXPORT uint32_t cosim_event_steps_leave(EventSteps *s, double t) { return event_steps_leave(s, t); }
EXPORT const char *cosim_event_steps_why(const EventReport *report) { return event_steps_why(report); }
EXPORT uint32_t cosim_event_steps_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last) {
    return event_steps_step(steps, t, h, no_set_prior, event, terminate, early, last);
}

EXPORT const ClockedCalls *cosim_clocked_calls(void) { return &clocked_calls; }

EXPORT void cosim_intermediate_update(void *environment, double t, bool asks, bool allows, bool finished,
    bool can_return, bool *returns, double *return_time) {
    intermediate_update(environment, t, asks, allows, finished, can_return, returns, return_time);
}
EXPORT uint32_t cosim_intermediate_step(void *steps, double t, double h, bool no_set_prior, bool *event,
    bool *terminate, bool *early, double *last) {
    return intermediate_step(steps, t, h, no_set_prior, event, terminate, early, last);
}

EXPORT uint32_t cosim_exact_set2(void *instance, const uint32_t *exact, size_t n, void *slots) {
    return exact_set2(instance, exact, n, slots);
}
EXPORT uint32_t cosim_exact_set3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots) {
    return exact_set3(instance, exact, n, slots, n_slots);
}
EXPORT uint32_t cosim_exact_get2(void *instance, const uint32_t *exact, size_t n, void *slots) {
    return exact_get2(instance, exact, n, slots);
}
EXPORT uint32_t cosim_exact_get3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots) {
    return exact_get3(instance, exact, n, slots, n_slots);
}
