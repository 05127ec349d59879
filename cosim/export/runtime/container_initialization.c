/* Initialization of a system: see container.h. */
#include "container.h"
#include "environment.h"
#include "fmu_math.h"

#include <string.h>

/* Whether a parameter can have a value. */
static FmuStatus check_passed(FmuInstance *self, const PlanPassed *p, double x) {
    const bool whole = p->to.kind != KIND_FLOAT64 && p->to.kind != KIND_FLOAT32;
    if (isfinite(x) && x >= p->min && x <= p->max && (!whole || x == floor(x))) return FMU_OK;
    self->state->mode = MODE_ERROR;
    return fmu_fail(self, FMU_ERROR, "%s would be %g, a value that it cannot have: change the parameters that it is "
        "calculated from", p->name, x);
}

/* Set a parameter to the one that another component calculates, unless that is the one that was passed on before. */
static FmuStatus pass(FmuInstance *self, const PlanPassed *p, uint64_t *before, bool first, bool *changed) {
    Component *from = &self->components[p->from.component], *to = &self->components[p->to.component];
    union {
        double numbers[COMPONENT_LARGEST];
        uint64_t words[COMPONENT_LARGEST];
    } of;
    const bool text = p->to.kind == KIND_STRING, bytes = p->to.kind == KIND_BINARY;
    const char *said = "";
    const unsigned char *held = NULL;
    size_t n = 0;
    uint32_t status = text    ? component_get_text(from, p->from.reference, &said)
                      : bytes ? component_get_bytes(from, p->from.reference, &held, &n)
                      : p->exact
                          ? component_move_wide(from, p->from.kind, p->from.reference, of.words, p->from.n, false)
                          : component_get(from, p->from.kind, p->from.reference, of.numbers, p->from.n);
    if (status > fmi3Warning)
        return container_failed(self, p->from.component, "getting a calculated parameter", status);
    uint64_t word = text ? fmu_hash(said, strlen(said)) : bytes ? fmu_hash(held, n) : of.words[p->from.index];
    double x = 0.0;
    if (!p->exact) {
        x = p->scale * of.numbers[p->from.index] + p->offset;
        memcpy(&word, &x, sizeof word);
    }
    if (!first && word == *before) return FMU_OK;
    *before = word;
    *changed = true;
    if (text) status = component_set_text(to, p->to.reference, said);
    else if (bytes) status = component_set_bytes(to, p->to.reference, held, n);
    else {
        if (p->exact) x = p->to.kind == KIND_INT64 ? (double)(int64_t)word : (double)word;
        const FmuStatus fits = check_passed(self, p, x);
        if (fits != FMU_OK) return fits;
        if (p->to.n > 1)
            status = p->exact ? component_move_wide(to, p->to.kind, p->to.reference, of.words, p->to.n, false)
                              : component_get(to, p->to.kind, p->to.reference, of.numbers, p->to.n);
        of.words[p->to.index] = word;
        if (status <= fmi3Warning)
            status = p->exact ? component_move_wide(to, p->to.kind, p->to.reference, of.words, p->to.n, true)
                              : component_set(to, p->to.kind, p->to.reference, of.numbers, p->to.n);
    }
    return status > fmi3Warning ? container_failed(self, p->to.component, "setting a parameter", status) : FMU_OK;
}

/* Set parameters to those that other components calculate, until none changes: one may follow from another. */
static FmuStatus pass_parameters(FmuInstance *self) {
    for (uint32_t round = 0; round <= P->n_passed; round++) {
        bool changed = false;
        for (uint32_t k = 0; k < P->n_passed; k++) {
            const FmuStatus status = pass(self, &P->passed[k], &self->passed[k], round == 0, &changed);
            if (status != FMU_OK) return status;
        }
        if (!changed) return FMU_OK;
    }
    self->state->mode = MODE_ERROR;
    return fmu_fail(self, FMU_ERROR, "calculated parameters do not settle: some follow from each other");
}

/* Pass outputs to inputs until nothing changes any more. */
FmuStatus container_settle(FmuInstance *self) {
    State *s = self->state;
    if (s->settled) return FMU_OK;
    const FmuStatus passed = pass_parameters(self);
    if (passed != FMU_OK) return passed;
    const int result = engine_settle(&self->engine, NULL, self->before, P->n_values);
    container_say_changes(self);
    if (result == ENGINE_CALL_FAILED) return container_call_failed(self, self->engine.component);
    if (result == ENGINE_NO_SOLUTION) return container_not_solved(self);
    s->settled = 1;
    if (result == ENGINE_UNSETTLED)
        (void)fmu_fail(self, FMU_WARNING, "initial values do not settle, there is a loop among them");
    return FMU_OK;
}

/* Outputs of component i by the calls of `e`. */
static int get_outputs(FmuInstance *self, int32_t i, const EngineComponent *e) {
    self->engine.environment = environment_bits();
    const int result = engine_get(&self->engine, e);
    engine_put_back_environment(&self->engine, &self->bound[i]);
    return result;
}

FmuStatus fmu_enter_initialization(FmuInstance *self) {
    State *s = self->state;
    if (!s->d) { /* FMI 2.0 allows leaving out SetupExperiment */
        const FmuStatus status = fmu_setup(self, 0.0, 0, 0.0);
        if (status != FMU_OK) return status;
    }
    s->mode = MODE_INITIALIZATION;
    s->settled = 0;
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        const EngineClock *clock = &P->clocks[p->clock];
        s->tick = clock->offset;
        const double begin = fmu_time(self);
        s->tick = s->stop_tick;
        const bool met = s->stop_tick != INT64_MAX && s->stop_tick > clock->offset &&
                         (s->stop_tick - clock->offset) % clock->period == 0;
        const double stop = met ? fmu_time(self) : 0.0;
        s->tick = 0;
        const uint32_t status = component_enter(&self->components[i], p->has_tolerance, p->tolerance, begin, met, stop);
        if (status > fmi3Warning) return container_failed(self, i, "EnterInitializationMode", status);
    }
    const FmuStatus bound = container_bind(self);
    if (bound != FMU_OK) return bound;
    for (int32_t i = 0; i < P->n_components; i++) /* elements that nobody drives */
        for (int32_t k = 0; k < P->components[i].n_sets; k++)
            if (P->components[i].sets[k].keeps) {
                EngineTransfer t = container_calls_of(self, i)[k];
                component_values(&self->components[i], P->components[i].sets[k].kind, false, &t);
                t.references = P->components[i].sets[k].references;
                t.element = NULL;
                EngineComponent e = self->bound[i];
                e.gets = &t;
                e.n_gets = 1;
                if (get_outputs(self, i, &e)) return container_call_failed(self, i);
            }
    for (int32_t i = 0; i < P->n_variables; i++) { /* inputs and parameters that are shown as values too */
        const PlanVariable *v = &P->variables[i];
        if (v->slot >= 0 && (v->role == FMU_INPUT || v->role == FMU_PARAMETER)) {
            const uint32_t status =
                component_get(&self->components[v->component], v->kind, v->reference, self->values + v->slot, 1);
            if (status > fmi3Warning) return container_failed(self, v->component, "getting a value", status);
        }
    }
    engine_publish(&self->engine);
    return FMU_OK;
}

static FmuStatus check_finite(FmuInstance *self) {
    for (uint32_t k = 0; k < P->n_values; k++)
        if (!isfinite(self->values[k]))
            return fmu_fail(self, FMU_ERROR, "%s is %g at time %.9g s", P->owners[k], self->values[k], fmu_time(self));
    return FMU_OK;
}

/* The first event iteration of component i has returned a status. Where it asks for the end, the run ends in the first
 * instant. */
static FmuStatus begun(FmuInstance *self, int32_t i, uint32_t status) {
    State *s = self->state;
    double time;
    char text[1024];
    int32_t call = 0;
    if (status <= fmi3Warning) return FMU_OK;
    if (!component_asked_to_end(&self->components[i], &time)) return container_step_failed(self, i, status);
    if (s->ending == INT64_MAX) s->ends_by = container_culprit(self, i, &call, text, sizeof text);
    s->ending = s->tick;
    return FMU_OK;
}

FmuStatus fmu_exit_initialization(FmuInstance *self) {
    State *s = self->state;
    FmuStatus result = container_settle(self);
    memcpy(self->before, self->values, P->n_values * sizeof *self->before);
    for (int32_t i = 0; i < P->n_components && result == FMU_OK; i++) {
        const uint32_t status = component_exit(&self->components[i]);
        const Exchange *const steps = P->components[i].exchange;
        if (status <= fmi3Warning) result = begun(self, i, component_begin(&self->components[i]));
        else if (steps && steps->culprit) result = container_step_failed(self, i, status);
        else result = container_failed(self, i, "ExitInitializationMode", status);
    }
    for (int32_t i = 0; i < P->n_connected && result == FMU_OK; i++)
        result = begun(self, P->connected[i].components[0], P->networks->begin(container_network(self, i)));
    for (int32_t i = 0; i < P->n_components && result == FMU_OK; i++)
        if (get_outputs(self, i, &self->bound[i])) result = container_call_failed(self, i);
    container_say_changes(self);
    if (result == FMU_OK) {
        const int followed = engine_follow_events(&self->engine, self->before);
        if (followed == ENGINE_CALL_FAILED) result = container_call_failed(self, self->engine.component);
        else if (followed) result = container_not_solved(self);
    }
    if (result == FMU_OK) result = check_finite(self);
    s->mode = result == FMU_OK ? MODE_STEP : MODE_ERROR;
    container_repeat_steps(self);
    if (result == FMU_OK) (void)fmu_fail(self, FMU_OK, "%s initialized at %.9g s", fmu_model.name, fmu_time(self));
    return result;
}
