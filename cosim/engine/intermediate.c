/* Inputs that follow a straight line inside a step: see intermediate.h. */
#include "intermediate.h"

#include <math.h>

enum { WARNING = 1, ERROR = 3 }; /* statuses of FMI */

static void set_inputs(IntermediateUpdate *u, double t) {
    const double *const start = u->line + 2, *const slope = start + u->n;
    double *const values = u->line + 2 + 2 * (size_t)u->n;
    const double since = t - u->line[0], near = 1e-9 * (1.0 + fabs(u->line[1]));
    u->report.requests++;
    u->report.time = t;
    if (!(since >= -near && t <= u->line[1] + near)) {
        u->report.end = INTERMEDIATE_BAD_TIME;
        return;
    }
    for (uint32_t i = 0; i < u->n; i++) values[i] = start[i] + slope[i] * since;
    u->report.status = u->n ? u->set(u->instance, u->references, u->n, values, u->n) : 0;
    if (u->report.status > WARNING) u->report.end = INTERMEDIATE_SET_FAILED;
}

void intermediate_update(void *environment, double t, bool asks, bool allows, bool finished, bool can_return,
    bool *returns, double *return_time) {
    IntermediateUpdate *const u = environment;
    (void)allows, (void)finished;
    if (returns) *returns = false;
    if (!u || !u->stepping) return; /* it belongs to no step */
    if (asks && u->report.end == INTERMEDIATE_FINE) set_inputs(u, t);
    if (u->report.end == INTERMEDIATE_FINE || !can_return || !returns || !return_time) return;
    *returns = true; /* the step has failed: nothing of the rest of it counts */
    *return_time = t;
}

uint32_t intermediate_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last) {
    IntermediateStep *const s = steps;
    IntermediateUpdate *const u = &s->update;
    double *const start = u->line + 2, *const slope = start + u->n;
    u->line[0] = t;
    u->line[1] = t + h;
    for (uint32_t i = 0; i < u->n; i++) {
        const EngineExtrapolation *const x = &s->lines[i];
        const double now = s->values[x->now], change = now - s->values[x->before];
        const double scale = s->scale ? s->scale[x->input] : 1.0, offset = s->scale ? s->offset[x->input] : 0.0;
        start[i] = (now + change * ((t + x->shift - s->values[x->sample_time]) / x->period)) * scale + offset;
        slope[i] = change / x->period * scale;
    }
    u->report.end = INTERMEDIATE_FINE;
    u->stepping = true;
    const uint32_t status = s->step(u->instance, t, h, no_set_prior, event, terminate, early, last);
    u->stepping = false;
    return u->report.end == INTERMEDIATE_FINE || status > WARNING ? status : ERROR;
}
