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
#define FINER 0.96       /* ratio of the factors that are considered */

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
            if (after || !e->loops[loop].repeats) result = engine_solve_events(e, loop);
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

/* What components read in a half of the step, or in all of it: two constants that have the mean and the first moment of
 * begin + slope s + curve s (s + over) over it; or the mean, and its last value at the end. */
static void extrapolate(const Engine *e, const EngineAdaptive *a, bool halves, bool second) {
    double *published = e->values + a->published;
    const double h = duration(e, a->steps->tried);
    for (uint32_t k = 0; k < a->n; k++) {
        const double slope = a->slope[k] + a->curve[k] * a->over, bend = a->curve[k] * h;
        const double mean = a->begin[k] + h * (slope / 2.0 + bend / 3.0);
        const double change = a->use[k] & ENGINE_LAST ? h * (slope / 2.0 + bend * 2.0 / 3.0)
            : halves                                  ? h * (slope + bend) / 3.0
                                                      : 0.0;
        published[k] = second || !halves ? mean + change : mean - change;
    }
}

static int64_t smallest(const EngineAdaptive *a) { return a->internal ? a->internal : 1; }

/* The longest step up to n, at least the smallest one, whose halves are multiples of internal steps. */
static int64_t fitting(const EngineAdaptive *a, int64_t n) {
    if (n <= smallest(a)) return smallest(a);
    if (!a->internal) return n;
    return n < 2 * a->internal ? a->internal : n - n % (2 * a->internal);
}

/* All components from the begin of the step on, in two halves, the smallest step in one; their outputs at its end are
 * published. */
static int try_step(Engine *e, EngineAdaptive *a, double t) {
    const bool halves = a->steps->tried > smallest(a) && fitting(a, a->steps->tried) == a->steps->tried;
    const double whole = duration(e, a->steps->tried), h = halves ? 0.5 * whole : whole;
    const int32_t n = e->n_components - e->n_discrete, done = e->n_stepped - e->n_due_discrete;
    const int32_t first = done > 0 ? done : 0;
    a->since = t;
    a->over = duration(e, a->steps->over);
    for (int32_t i = first; i < (halves ? 2 * n : n); i++) {
        const bool second = i >= n;
        if (i == first || i == n) extrapolate(e, a, halves, second);
        EngineComponent *m = &e->components[e->n_discrete + (second ? i - n : i)];
        m->step = h;
        int result = engine_component(e, (int32_t)(m - e->components), second ? t + h : t);
        if (!result) result = finite_or(e, m);
        if (result) {
            e->n_stepped = e->n_due_discrete + i + 1;
            return result;
        }
    }
    memcpy(e->values + a->published, e->values + a->computed, a->n * sizeof(double));
    return refresh(e, a, true);
}

/* The largest difference between what has arrived and what was extrapolated, relative to the tolerance. It is infinite
 * where one of them is not finite. */
static double largest_error(const Engine *e, EngineAdaptive *a) {
    const double *arrived = e->values + a->computed, h = duration(e, a->steps->tried);
    double largest = 0.0;
    a->worst = 0;
    for (uint32_t k = 0; k < a->n; k++) {
        if (!(a->use[k] & ENGINE_READ)) continue;
        const double size = fabs(arrived[k]) > a->size[k] ? fabs(arrived[k]) : a->size[k];
        const double expected = a->begin[k] + h * (a->slope[k] + a->curve[k] * (h + a->over));
        const double error = fabs(arrived[k] - expected) / (a->tolerance * size);
        if (!(error <= largest)) {
            largest = error < INFINITY ? error : INFINITY;
            a->worst = k;
        }
    }
    return a->error = largest;
}

/* The second divided difference of an output over a step of length h that begins at the present begin, or that was
 * accepted or rejected there. */
static double curve(const EngineAdaptive *a, uint32_t k, double slope, double h, double past) {
    return past > 0.0 && !(a->use[k] & ENGINE_STEPWISE) ? (slope - a->back[k]) / (h + past) : 0.0;
}

/* The change of each output in the step that was accepted, or in one that was rejected, tells its slope, and with that
 * in the step before its curve. A length of 0 tells nothing. */
static void learn(const Engine *e, EngineAdaptive *a, int64_t length, bool accepted) {
    EngineSteps *s = a->steps;
    const double *arrived = e->values + a->computed, h = duration(e, length), past = duration(e, s->past);
    if (!length) s->past = 0;
    for (uint32_t k = 0; k < a->n; k++) {
        const double slope = length && !(a->use[k] & ENGINE_STEPWISE) ? (arrived[k] - a->begin[k]) / h : 0.0;
        a->curve[k] = length ? curve(a, k, slope, h, past) : 0.0;
        a->slope[k] = slope;
        if (accepted) a->back[k] = slope;
    }
    s->far = s->past && accepted ? s->past + length : s->past;
    s->over = accepted ? length : -length;
    if (accepted) s->past = length;
}

/* The step before, over which slopes are measured; 0: none. The one with a jump tells no slope; where its successor is
 * as bad without slopes, the value is steep, and its own slope serves. */
static int64_t measured_over(const EngineSteps *s) { return s->jumps == 1 ? 0 : s->end - s->begin; }

/* Values at the begin of a step, after the discrete components. */
static int begin_step(Engine *e, EngineAdaptive *a) {
    EngineSteps *s = a->steps;
    if (e->n_due_discrete || s->changed) {
        const int result = refresh(e, a, false);
        if (result) return result;
        s->past = 0; /* slopes may jump here */
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

/* How the error grows with the length f of a step, whose begin is `over` and `far` after known values; 0: none. */
static double growth(double f, double over, double far) {
    return f * (over == 0.0 ? 1.0 : fabs(f + over)) * (far == 0.0 ? 1.0 : f + far);
}

/* The largest factor up to `most` by which a step may differ from the one that was tried: the next one, which begins at
 * its end, or itself again. */
static double factor_of(const EngineAdaptive *a, double error, double most, bool next) {
    const EngineSteps *s = a->steps;
    const bool flat = a->slope[a->worst] == 0.0;
    const double h = (double)s->tried, over = flat ? 0.0 : (double)s->over / h, far = flat ? 0.0 : (double)s->far / h;
    const double then = next && over != 0.0 ? 1.0 : over, ago = next && far != 0.0 ? 1.0 + (double)s->past / h : far;
    const double allowed = SAFETY * growth(1.0, over, far);
    while (most > LEAST_FACTOR && error * growth(most, then, ago) > allowed) most *= FINER;
    return most > LEAST_FACTOR ? most : LEAST_FACTOR;
}

/* The length that the error of the accepted step allows for the next one. */
static void control(EngineAdaptive *a) {
    EngineSteps *s = a->steps;
    const double factor = factor_of(a, a->error, MOST_FACTOR, true);
    if (factor < MOST_FACTOR) s->next = (int64_t)(factor * (double)s->tried);
    else if (s->next < 2 * s->tried) s->next = 2 * s->tried; /* else the step was cut short */
    if (s->next < 1) s->next = 1;
    if (s->next > a->largest) s->next = a->largest;
}

/* The step has failed: what is published is that of its begin. */
static int fail(Engine *e, const EngineAdaptive *a, int result) {
    memcpy(e->values + a->published, a->begin, a->n * sizeof(double));
    return result;
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
        s->tried = fitting(a, s->next >= left ? left : 2 * s->next > left ? (left + 1) / 2 : s->next);
        if (s->tried > left) s->tried = left; /* to an instant between internal steps */
    }
    for (;;) {
        result = try_step(e, a, t);
        if (resumed && !result) break;
        const bool repeatable = result == ENGINE_NOT_FINITE || result == ENGINE_NO_SOLUTION
            || (result == ENGINE_CALL_FAILED && e->status <= DISCARD);
        if (result && (resumed || !repeatable || s->tried <= smallest(a))) return fail(e, a, result);
        const double error = result ? INFINITY : largest_error(e, a);
        if (error <= 1.0 || s->tried <= smallest(a)) {
            s->jumps = error <= 1.0 ? 0 : s->jumps + 1;
            s->n_beyond += error > 1.0;
            if (s->jumps > MOST_JUMPS || error == INFINITY) return fail(e, a, ENGINE_NO_STEP);
            control(a);
            break;
        }
        s->n_rejected++;
        const double factor = factor_of(a, error, SAFETY, false);
        if (factor > LEAST_FACTOR) learn(e, a, s->tried, false); /* else it may be a jump, which has no slope */
        if ((result = restore(e, a))) return fail(e, a, result);
        e->n_stepped = 0;
        s->next = s->tried = fitting(a, (int64_t)(factor * (double)s->tried));
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
    if (result) return fail(e, a, result);
    s->end = tick;
    s->total += s->tried - before;
    if (s->tried < s->smallest) s->smallest = s->tried;
    learn(e, a, measured_over(s), true);
    e->tick = tick;
    return ENGINE_AT_END;
}

/* ------------------------------------------------------------------ instants */

int engine_adaptive_arrive(Engine *e, EngineAdaptive *a, double t) {
    const EngineSteps *s = a->steps;
    double *published = e->values + a->published;
    const double *computed = e->values + a->computed;
    if (e->tick == s->end) {
        learn(e, a, measured_over(s), true); /* before a discrete component changes a loop */
        memcpy(published, computed, a->n * sizeof(double));
    } else {
        const double h = duration(e, s->end - s->begin), past = duration(e, s->past);
        const double share = (double)(e->tick - s->begin) / (double)(s->end - s->begin);
        for (uint32_t k = 0; k < a->n; k++) {
            const double change = a->use[k] & ENGINE_STEPWISE ? 0.0 : computed[k] - a->begin[k];
            const double bend = curve(a, k, change / h, h, past) * h * h;
            published[k] = a->begin[k] + share * (change - bend * (1.0 - share));
        }
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
