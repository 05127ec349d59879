/* Components of a system as the engine calls them: see container.h. */
#include "container.h"

/* Calls and buffers of a component for the engine, as far as they do not change. */
FmuStatus container_bind(FmuInstance *self) {
    EngineTransfer *t = self->transfers;
    double *u = self->values + P->n_values;
    char *buffers = (char *)(u + P->n_u), *texts_at = self->texts;
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        Component *m = &self->components[i];
        double *own = p->in_place ? self->values + p->u : u + p->u, *y = self->values + p->first;
        EngineComponent *e = &self->bound[i];
        *e = (EngineComponent){.fmi = p->version,
            .clock = p->clock,
            .step = p->step,
            .check_before = p->check_before,
            .n_copies_before = p->n_copies_before,
            .copies = p->copies,
            .n_copies = p->n_copies,
            .timestamp_slot = p->timestamp_slot,
            .index = p->index,
            .n_inputs = p->in_place ? 0 : p->n_inputs,
            .scale = p->scale,
            .offset = p->offset,
            .extrapolations = p->extrapolations,
            .n_extrapolations = p->n_extrapolations,
            .u = own,
            .y = y,
            .first = p->first,
            .n_outputs = p->n_outputs,
            .instance = m->instance,
            .stepped = m->exchange ? m->integrator : m->instance,
            .flags = self->flags + 4 * i,
            .last = self->last + i,
            .foreign = p->folder != NULL,
            .integrated = p->integrated && p->folder,
            .begins_with_events = p->begins_with_events,
            .no_set_prior = 0,
            .n_sets = p->n_sets,
            .n_gets = p->n_gets};
        if (m->exchange) e->step2 = m->exchange->step2, e->step3 = m->exchange->step3;
        else if (p->version == 2) e->step2 = (EngineStep2)m->f2->DoStep;
        else e->step3 = (EngineStep3)m->f3->DoStep;
        const bool waits = m->exchange && m->exchange->bind;
        if (waits) m->exchange->bind(m, self->state->mode == MODE_STEP);
        if (p->follows) {
            const uint32_t status = P->updates->bind(m, e, self->values);
            if (status > fmi3Warning) return container_failed(self, i, "getting inputs", status);
            if (!m->exchange) e->step3 = m->step, e->stepped = m->updates;
        }
        double *from_u = own, *to_y = y;
        if (m->exchange && m->exchange->values) m->exchange->values(m, &from_u, &to_y);
        bool direct = p->n_sets == 1 && p->n_gets == 1;
        for (int set = 1; set >= 0; set--) {
            if (set) e->sets = t;
            else e->gets = t;
            for (int32_t k = 0; k < (set ? p->n_sets : p->n_gets); k++, t++) {
                const PlanTransfer *from = set ? &p->sets[k] : &p->gets[k];
                void *data = from->element ? (void *)(buffers + from->buffer)
                                           : (void *)((set ? from_u : to_y) + from->at);
                *t = (EngineTransfer){.references = from->references,
                    .n_references = from->n_references,
                    .widths = from->widths,
                    .data = data,
                    .n_data = from->n_data,
                    .n = from->n,
                    .element = from->element,
                    .place = from->place};
                component_values(m, from->kind, set != 0, t);
                if (from->exact) {
                    P->texts->bind(m, from, set != 0, texts_at, t);
                    texts_at += P->texts->room(from);
                }
                if (waits && from->waits) m->exchange->wait(m, t);
                direct = direct && !from->element;
            }
        }
        if (m->exchange && m->exchange->attach) {
            m->exchange->attach(m, e, p->n_inputs);
            direct = e->n_sets == 1 && e->n_gets == 1;
        }
        e->direct = direct;
    }
    EngineDerivative *d = self->derivatives;
    for (int32_t i = 0; i < P->n_loops; i++)
        for (int32_t k = 0; P->loops[i].derivatives && k < P->loops[i].n_components; k++, d++) {
            const Component *m = &self->components[P->loops[i].components[k]];
            if (!d->n_knowns) continue;
            if (m->version == 2) d->call2 = (EngineDerivative2)m->f2->GetDirectionalDerivative;
            else d->call3 = (EngineDerivative3)m->f3->GetDirectionalDerivative;
        }
    return FMU_OK;
}

/* The calls of component i, first those that set. */
const EngineTransfer *container_calls_of(const FmuInstance *self, int32_t i) {
    const EngineTransfer *t = self->transfers;
    for (int32_t k = 0; k < i; k++) t += P->components[k].n_sets + P->components[k].n_gets;
    return t;
}
