/* Components whose inputs follow inside their steps (intermediate update): see component.h. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "intermediate.h"

static void called_back(fmi3InstanceEnvironment environment, fmi3Float64 t, fmi3Boolean asks, fmi3Boolean allows,
    fmi3Boolean finished, fmi3Boolean can_return, fmi3Boolean *returns, fmi3Float64 *return_time) {
    const Component *const m = environment;
    IntermediateStep *const s = m->updates;
    intermediate_update(&s->update, t, asks, allows, finished, can_return, returns, return_time);
}

static bool make(Component *m) {
    const UpdateSetup *const p = m->follows;
    IntermediateStep *const s = m->updates = calloc(1, sizeof *s + (2 + 3 * (size_t)p->n) * sizeof(double));
    m->update = called_back;
    m->step = intermediate_step;
    return s != NULL;
}

static uint32_t bind(Component *m, const EngineComponent *e, const double *values) {
    const UpdateSetup *const p = m->follows;
    IntermediateStep *const s = m->updates;
    *s = (IntermediateStep){.update = {.instance = m->instance,
                                .set = (EngineValues3)m->f3->SetFloat64,
                                .references = p->references,
                                .n_references = p->n_references,
                                .n = p->n,
                                .line = (double *)(s + 1)},
        .step = (EngineStep3)m->f3->DoStep,
        .values = values,
        .scale = e->scale,
        .offset = e->offset,
        .lines = p->lines,
        .element = p->element,
        .n_lines = p->n_lines};
    memset(s + 1, 0, (2 + 3 * (size_t)p->n) * sizeof(double));
    for (uint32_t i = 0; i < p->n_free; i++) { /* elements that nobody drives */
        double array[COMPONENT_LARGEST];
        const UpdateFree *const f = &p->free[i];
        const uint32_t status = component_get(m, KIND_FLOAT64, f->reference, array, f->n);
        if (status > fmi3Warning) return status;
        s->update.line[2 + f->element] = array[f->index];
    }
    return fmi3OK;
}

static const char *why(const Component *m, double *time) {
    const IntermediateReport *const r = &((const IntermediateStep *)m->updates)->update.report;
    *time = r->time;
    return r->end == INTERMEDIATE_BAD_TIME     ? "asks for inputs outside of its step"
           : r->end == INTERMEDIATE_SET_FAILED ? "refuses inputs inside its step"
                                               : NULL;
}

const Updates updates = {make, bind, why};
