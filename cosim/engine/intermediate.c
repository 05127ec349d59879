/* Inputs that follow a straight line inside a step: see intermediate.h. */
#include "intermediate.h"

#include "environment.h"

#include <math.h>

enum { WARNING = 1, ERROR = 3 }; /* statuses of FMI */

/* In the floating-point environment of the caller of the step, not that in which the FMU calls back. */
static void set_inputs(IntermediateUpdate *u, double t) {
    u->environment[1] = u->environment[0];
    environment_after_call(u->environment);
    const double *const start = u->line + 2, *const slope = start + u->n, since = t - u->line[0];
    double *const values = u->line + 2 + 2 * (size_t)u->n;
    u->report.time = t;
    for (uint32_t i = 0; i < u->n; i++) values[i] = start[i] + slope[i] * since;
    environment_end(u->environment);
    u->report.status = u->n ? u->set(u->instance, u->references, u->n_references, values, u->n) : 0;
    if (u->report.status > WARNING) u->report.end = INTERMEDIATE_SET_FAILED;
}

void intermediate_begin(IntermediateUpdate *u) {
    u->report.end = INTERMEDIATE_FINE;
    u->stepping = true;
    environment_begin(u->environment);
    if (u->begins && u->set) set_inputs(u, u->line[0]);
}

void intermediate_update(void *environment, double t, bool asks, bool allows, bool finished, bool can_return,
    bool *returns, double *return_time) {
    IntermediateUpdate *const u = environment;
    (void)allows, (void)finished;
    if (returns) *returns = false;
    if (!u || !u->stepping) return; /* it belongs to no step */
    if (asks && u->report.end == INTERMEDIATE_FINE) {
        const double near = 1e-9 * (1.0 + fabs(u->line[1]));
        u->report.requests++;
        if (t - u->line[0] >= -near && t <= u->line[1] + near) set_inputs(u, t);
        else u->report.end = INTERMEDIATE_BAD_TIME, u->report.time = t;
    }
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
    for (uint32_t i = 0; i < s->n_lines; i++) {
        const EngineExtrapolation *const x = &s->lines[i];
        const double scale = s->scale ? s->scale[x->input] : 1.0, offset = s->scale ? s->offset[x->input] : 0.0;
        double now, rate = 0.0;
        if (x->period == 0.0) now = s->values[x->now]; /* it is held */
        else if (s->adaptive) { /* of its parabola, the mean and the slope in the middle */
            const EngineAdaptive *const a = s->adaptive;
            const double middle = t - a->since + 0.5 * h, slope = a->slope[x->now], curve = a->curve[x->now];
            rate = slope + curve * (2.0 * middle + a->over);
            now = a->begin[x->now] + middle * (slope + curve * (middle + a->over)) + curve * h * h / 12.0;
            now -= 0.5 * h * rate;
        } else {
            const double last = s->values[x->now], change = last - s->values[x->before];
            rate = change / x->period;
            now = last + change * ((t + x->shift - s->values[x->sample_time]) / x->period);
        }
        start[s->element[i]] = now * scale + offset;
        slope[s->element[i]] = rate * scale;
    }
    intermediate_begin(u);
    const uint32_t status = s->step(u->instance, t, h, no_set_prior, event, terminate, early, last);
    u->stepping = false;
    return u->report.end == INTERMEDIATE_FINE || status > WARNING ? status : ERROR;
}
