/* Communication steps that follow the error of the exchange: see adaptive.h. */
#include "adaptive.h"

#include "environment.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { LARGEST_SUCCESS = 1, DISCARD = 2, MOST_JUMPS = 10, SAVE = -2, RESTORE = -3 };
#define SAFETY 0.9
#define LEAST_FACTOR 0.1 /* by which a step becomes shorter */
#define MOST_FACTOR 2.0  /* by which the next step becomes longer */

static double duration(const Engine *e, int64_t ticks) { return (double)(ticks * e->a) / (double)e->d; }

/* ------------------------------------------------------------------ saved states */

static int move_others(Engine *e, const EngineAdaptive *a, int32_t what) {
    return a->others && e->back(e->context, what, NAN) ? ENGINE_BACK_FAILED : ENGINE_AT_END;
}

static int state_failed(Engine *e, const EngineAdaptive *a, int32_t fmu, int32_t call, uint32_t status) {
    e->component = a->numbers[fmu];
    e->call = call;
    e->status = status;
    return ENGINE_STATE_FAILED;
}

static int save(Engine *e, EngineAdaptive *a) {
    for (int32_t i = 0; i < a->n_fmus; i++) {
        const uint32_t status = a->fmus[i].get(a->fmus[i].instance, &a->states[i]);
        if (status > LARGEST_SUCCESS) return state_failed(e, a, i, 0, status);
    }
    return move_others(e, a, SAVE);
}

static int restore(Engine *e, EngineAdaptive *a) {
    for (int32_t i = 0; i < a->n_fmus; i++) {
        const uint32_t status = a->fmus[i].set(a->fmus[i].instance, a->states[i]);
        if (status > LARGEST_SUCCESS) return state_failed(e, a, i, 1, status);
    }
    return move_others(e, a, RESTORE);
}

/* ------------------------------------------------------------------ one step */

static int finite_or(Engine *e, const EngineComponent *m) {
    if (!e->check_finite || engine_finite(m->y, m->n_outputs)) return ENGINE_AT_END;
    e->component = (int32_t)(m - e->components);
    return ENGINE_NOT_FINITE;
}

/* Outputs that depend directly on inputs: of the inputs as they are published now; `after` a step. */
static int refresh(Engine *e, EngineAdaptive *a, bool after) {
    for (int32_t i = 0; i < a->n_refreshed; i++) {
        const int32_t loop = -1 - a->refreshed[i];
        int result = ENGINE_AT_END;
        if (loop >= 0) {
            if (after || !e->loops[loop].repeats) result = engine_solve(e, loop);
        } else {
            const EngineComponent *m = &e->components[a->refreshed[i]];
            result = engine_exchange(e, m, NAN);
            if (!result) result = finite_or(e, m);
            if (!result) engine_publish_outputs(e, m);
        }
        if (result) return result;
    }
    return ENGINE_AT_END;
}

/* All components from the begin of the step on, with inputs of its middle; their outputs at its end are published. */
static int try_step(Engine *e, EngineAdaptive *a, double t) {
    double *published = e->values + a->published;
    const double h = duration(e, a->steps->tried);
    a->since = t;
    const int32_t done = e->n_stepped - e->n_due_discrete;
    for (uint32_t k = 0; k < a->n; k++) published[k] = a->begin[k] + a->slope[k] * (0.5 * h);
    for (int32_t i = e->n_discrete + (done > 0 ? done : 0); i < e->n_components; i++) {
        EngineComponent *m = &e->components[i];
        m->step = h;
        int result = engine_component(e, i, t);
        if (!result) result = finite_or(e, m);
        if (result) {
            e->n_stepped = e->n_due_discrete + i - e->n_discrete + 1;
            return result;
        }
    }
    memcpy(published, e->values + a->computed, a->n * sizeof(double));
    return refresh(e, a, true);
}

/* The largest difference between what has arrived and what was extrapolated, relative to the tolerance. */
static double largest_error(const Engine *e, EngineAdaptive *a) {
    const double *arrived = e->values + a->computed, h = duration(e, a->steps->tried);
    double largest = 0.0;
    a->worst = 0;
    for (uint32_t k = 0; k < a->n; k++) {
        if (!(a->use[k] & ENGINE_READ)) continue;
        const double size = fabs(arrived[k]) > a->size[k] ? fabs(arrived[k]) : a->size[k];
        const double error = fabs(arrived[k] - (a->begin[k] + a->slope[k] * h)) / (a->tolerance * size);
        if (error > largest) {
            largest = error;
            a->worst = k;
        }
    }
    return a->error = largest;
}

/* The change of each output in the step before, or in one that was rejected (negative), tells its slope. */
static void learn(const Engine *e, EngineAdaptive *a, int64_t over) {
    const double *arrived = e->values + a->computed, h = fabs(duration(e, over));
    for (uint32_t k = 0; k < a->n; k++)
        a->slope[k] = over && !(a->use[k] & ENGINE_HELD) ? (arrived[k] - a->begin[k]) / h : 0.0;
    a->steps->over = over;
}

/* The step before, over which slopes are measured; 0: none. The one with a jump tells no slope; where its successor is
 * as bad without slopes, the value is steep, and its own slope serves. */
static int64_t measured_over(const EngineSteps *s) { return s->jumps % 2 ? 0 : s->end - s->begin; }

/* Values at the begin of a step, after the discrete components. */
static int begin_step(Engine *e, EngineAdaptive *a) {
    EngineSteps *s = a->steps;
    if (e->n_due_discrete || s->changed) {
        const int result = refresh(e, a, false);
        if (result) return result;
    }
    s->changed = 0;
    memcpy(a->begin, e->values + a->published, a->n * sizeof(double));
    for (uint32_t k = 0; k < a->n; k++)
        if (fabs(a->begin[k]) > a->size[k]) a->size[k] = fabs(a->begin[k]);
    return save(e, a);
}

/* How far a step may go: to the next instant of a discrete component, or to the stop time. */
static int64_t ticks_left(const Engine *e, const EngineAdaptive *a) {
    int64_t left = INT64_MAX / 4;
    for (int32_t i = 0; i < e->n_clocks - 1; i++) {
        const int64_t until = e->next[i] + (e->due[i] ? e->clocks[i].period : 0) - e->tick;
        if (until < left) left = until;
    }
    return e->tick < a->stop && a->stop - e->tick < left ? a->stop - e->tick : left;
}

static void accept(Engine *e, EngineAdaptive *a) {
    EngineSteps *s = a->steps;
    const int64_t n = s->tried;
    s->begin = e->tick;
    s->end = e->tick + n;
    s->total += n;
    if (!s->n_accepted || n < s->smallest) s->smallest = n;
    if (n > s->largest) s->largest = n;
    s->n_accepted++;
    memcpy(e->values + a->published, a->begin, a->n * sizeof(double));
}

/* The length that the error of the accepted step allows for the next one. That of a value which is held grows with the
 * length h. That of an extrapolated one grows with h |h + g|, where its slope was measured over a length of g: the next
 * length is f h with f (f + 1) = SAFETY |1 + g / h| / error. */
static void control(EngineAdaptive *a) {
    EngineSteps *s = a->steps;
    double factor = MOST_FACTOR;
    if (a->error > 0.0 && a->slope[a->worst] == 0.0) factor = SAFETY / a->error;
    else if (a->error > 0.0) {
        const double reach = fabs(1.0 + (double)s->over / (double)s->tried);
        factor = 0.5 * (sqrt(1.0 + 4.0 * SAFETY * reach / a->error) - 1.0);
    }
    if (factor < LEAST_FACTOR) factor = LEAST_FACTOR;
    if (factor < MOST_FACTOR) s->next = (int64_t)(factor * (double)s->tried);
    else if (s->next < 2 * s->tried) s->next = 2 * s->tried; /* else the step was cut short */
    if (s->next < 1) s->next = 1;
    if (s->next > a->largest) s->next = a->largest;
}

/* A step from the present instant on, repeated with shorter ones until its error is within the tolerance. */
static int take_step(Engine *e, EngineAdaptive *a, double t) {
    EngineSteps *s = a->steps;
    const bool resumed = e->n_stepped > e->n_due_discrete;
    int result = ENGINE_AT_END;
    if (!resumed) {
        result = begin_step(e, a);
        if (result) return result;
        const int64_t left = ticks_left(e, a);
        s->tried = s->next >= left ? left : 2 * s->next > left ? (left + 1) / 2 : s->next;
    }
    for (;;) {
        result = try_step(e, a, t);
        if (resumed && !result) break;
        const bool repeatable = result == ENGINE_NOT_FINITE || result == ENGINE_NO_SOLUTION
            || (result == ENGINE_CALL_FAILED && e->status <= DISCARD);
        if (result && (resumed || !repeatable || s->tried == 1)) {
            memcpy(e->values + a->published, a->begin, a->n * sizeof(double));
            return result;
        }
        const double error = result ? INFINITY : largest_error(e, a);
        if (error <= 1.0 || s->tried == 1) {
            s->jumps = error <= 1.0 ? 0 : s->jumps + 1;
            if (s->jumps > MOST_JUMPS) return ENGINE_NO_STEP;
            control(a);
            break;
        }
        s->n_rejected++;
        if (!result) learn(e, a, -s->tried);
        if ((result = restore(e, a))) return result;
        e->n_stepped = 0;
        const double factor = SAFETY / error > LEAST_FACTOR ? SAFETY / error : LEAST_FACTOR;
        s->tried = (int64_t)(factor * (double)s->tried);
        if (s->tried < 1) s->tried = 1;
        s->next = s->tried;
    }
    accept(e, a);
    return ENGINE_AT_END;
}

int engine_adaptive_cut(Engine *e, EngineAdaptive *a, int64_t tick) {
    EngineSteps *s = a->steps;
    e->environment = environment_bits();
    e->tick = s->begin;
    engine_look_up(e, e->tick);
    e->n_due_discrete = e->n_stepped = 0;
    int result = restore(e, a);
    const int64_t before = s->end - s->begin;
    s->tried = tick - s->begin;
    if (!result) result = try_step(e, a, engine_time(e, s->begin));
    if (result) return result;
    s->end = tick;
    s->total += s->tried - before;
    if (s->tried < s->smallest) s->smallest = s->tried;
    learn(e, a, measured_over(s));
    e->tick = tick;
    return ENGINE_AT_END;
}

/* ------------------------------------------------------------------ instants */

int engine_adaptive_arrive(Engine *e, EngineAdaptive *a, double t) {
    const EngineSteps *s = a->steps;
    double *published = e->values + a->published;
    const double *computed = e->values + a->computed;
    if (e->tick == s->end) {
        learn(e, a, measured_over(s)); /* before a discrete component changes a loop */
        memcpy(published, computed, a->n * sizeof(double));
    } else {
        const double share = (double)(e->tick - s->begin) / (double)(s->end - s->begin);
        for (uint32_t k = 0; k < a->n; k++)
            published[k] = a->begin[k] + (a->use[k] & ENGINE_STEPWISE ? 0.0 : (computed[k] - a->begin[k]) * share);
    }
    return engine_arrive(e, t);
}

int engine_adaptive_sample(Engine *e, EngineAdaptive *a, double t) {
    for (int32_t i = 0; i < e->n_loops; i++) e->due[e->loops[i].clock] = e->tick == a->steps->end;
    return engine_sample(e, t);
}

int engine_adaptive_advance(Engine *e, EngineAdaptive *a, double t) {
    return e->tick == a->steps->end ? take_step(e, a, t) : ENGINE_AT_END;
}

int engine_adaptive_run(Engine *e, EngineAdaptive *a, int64_t end) {
    e->environment = environment_bits();
    while (e->tick < end) {
        engine_look_up(e, e->tick);
        int64_t tick = a->steps->end >= e->tick ? a->steps->end : INT64_MAX;
        for (int32_t i = 0; i < e->n_clocks; i++)
            if (e->next[i] < tick) tick = e->next[i];
        if (tick >= end) break;
        if (tick > e->tick) engine_look_up(e, tick);
        e->tick = tick;
        if (e->due[e->n_clocks - 1] && e->count == e->room) return ENGINE_FULL;
        const double t = engine_time(e, tick);
        int result = engine_adaptive_arrive(e, a, t);
        if (!result) result = engine_adaptive_sample(e, a, t);
        if (!result) result = engine_adaptive_advance(e, a, t);
        if (result) return result;
        e->tick = tick + 1;
    }
    e->tick = end;
    return ENGINE_AT_END;
}
