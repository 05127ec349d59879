/* What components say, and what their failures mean: see container.h. */
#include "container.h"

/* Of what a component says, errors and warnings are passed on. */
void container_log(void *context, int status, const char *message) {
    const Source *source = context;
    if (status == (int)fmi3OK) return;
    (void)fmu_fail(source->self, status <= (int)fmi3Fatal ? (FmuStatus)status : FMU_ERROR, "%s: %s",
                   P->components[source->component].name, message);
}

void container_say_changes(FmuInstance *self) {
    for (int32_t i = 0; i < P->n_components; i++) {
        Component *m = &self->components[i];
        const uint32_t own = m->exchange && m->exchange->changed ? m->exchange->changed(m) : 0u;
        if (self->bound[i].changed | own) component_changed(m, self->bound[i].changed | own);
    }
}

const char *container_status(uint32_t status) {
    static const char *const names[] = {"OK", "Warning", "Discard", "Error", "Fatal", "Pending"};
    return status < sizeof names / sizeof *names ? names[status] : "no FMI status";
}

/* What a component's call has returned, as this FMU's status, with a message. After a call that has changed nothing the
 * system continues, unless the component is lost. */
FmuStatus container_refused(FmuInstance *self, int32_t i, const char *what, uint32_t status) {
    if (self->components[i].dead) self->state->mode = MODE_ERROR;
    return fmu_fail(self, FMU_ERROR, "component '%s': %s returned %s at time %.9g s", P->components[i].name, what,
        container_status(status), fmu_time(self));
}

/* The same, and the end of this simulation: no step follows (FMI 2.0, 3.0: after an error). */
FmuStatus container_failed(FmuInstance *self, int32_t i, const char *what, uint32_t status) {
    self->state->mode = MODE_ERROR;
    return container_refused(self, i, what, status);
}

/* The component that has failed or asked for the end in a step of component i, which others may have taken with it. */
int32_t container_culprit(const FmuInstance *self, int32_t i, int32_t *call, char *text, size_t size) {
    const Component *m = &self->components[i];
    if (m->exchange && m->exchange->culprit) m = m->exchange->culprit(m, call, text, size);
    return (int32_t)(m - self->components);
}

/* A call of component i that the engine has made has failed. */
FmuStatus container_call_failed(FmuInstance *self, int32_t i) {
    int32_t call = self->engine.call;
    const Component *m = &self->components[i];
    if (m->exchange && m->exchange->culprit) {
        char text[1024];
        i = container_culprit(self, i, &call, text, sizeof text);
        m = &self->components[i];
        (void)fmu_fail(self, FMU_ERROR, "component '%s': %s", P->components[i].name, text);
    }
    if (self->engine.status == fmi3Fatal) self->components[i].dead = true;
    if (m->exchange && !m->exchange->culprit && !call) {
        char text[1024];
        double time;
        const bool fails = m->exchange->why(m, &time, text, sizeof text);
        if (*text)
            (void)fmu_fail(self, FMU_ERROR, "component '%s': its %s %s at %.9g s: %s", P->components[i].name,
                P->components[i].integrated ? "integration" : "event mode", fails ? "failed" : "ended", time, text);
    }
    const PlanComponent *p = &P->components[i];
    const bool together = m->exchange && m->exchange->culprit, early = self->engine.status <= fmi3Warning;
    if (early && !together)
        (void)fmu_fail(self, FMU_ERROR, "component '%s': it returned early, which it was not allowed to "
            "(earlyReturnAllowed is false)", p->name);
    double when;
    const char *const refused = p->follows && !call ? P->updates->why(m, &when) : NULL;
    if (refused) (void)fmu_fail(self, FMU_ERROR, "component '%s': it %s, at %.9g s", p->name, refused, when);
    const bool sets = call > 0 && call <= p->n_sets, gets = call < 0 && call >= -p->n_gets;
    const PlanTransfer *t = sets ? &p->sets[call - 1] : gets ? &p->gets[-call - 1] : NULL;
    if (t && t->exact) {
        uint32_t most = 0;
        const EngineTransfer *bound = container_calls_of(self, i) + (sets ? call - 1 : p->n_sets - call - 1);
        const uint64_t n = t->waits ? 0 : P->texts->too_long(bound->references, &most);
        if (n)
            (void)fmu_fail(self, FMU_ERROR, "component '%s': a value of at least %llu bytes is longer than its "
                "connection holds, %u: export the system with connect(..., max_size=...)",
                p->name, (unsigned long long)n, (unsigned)most);
    }
    return container_failed(self, i,
        call == CALL_SAVE           ? "GetFMUState"
        : call == CALL_RESTORE      ? "SetFMUState"
        : call == ENGINE_DERIVATIVE ? "GetDirectionalDerivative"
        : call > 0 ? "setting its inputs"
        : call < 0 ? "getting its outputs"
        : together ? "taking its step"
        : self->state->mode == MODE_INITIALIZATION ? "its first event iteration"
                                                   : "DoStep",
        early ? (uint32_t)fmi3Discard : self->engine.status);
}

FmuStatus container_step_failed(FmuInstance *self, int32_t i, uint32_t status) {
    self->engine.call = 0;
    self->engine.status = status;
    return container_call_failed(self, i);
}

FmuStatus container_not_solved(FmuInstance *self) {
    const EngineLoop *l = &self->engine.loops[self->engine.component];
    self->state->mode = MODE_ERROR;
    if (self->engine.call)
        return fmu_fail(self, FMU_ERROR,
            "the algebraic loop through %s has no solution at time %.9g s: discrete states of its components change "
            "again with each solution; export the system with delay=True at one of its connections",
            P->owners[l->published[0]], fmu_time(self));
    return fmu_fail(self, FMU_ERROR,
        "the algebraic loop through %s has no solution at time %.9g s, or its solution jumps there "
        "(%.9g, residual %.3g): export the system with a start value of an input of the loop near the solution",
        P->owners[l->published[0]], fmu_time(self), l->work[0], l->work[l->n]);
}
