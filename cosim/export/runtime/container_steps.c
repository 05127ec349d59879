/* Steps of a system: see container.h. */
#include <float.h>

#include "container.h"
#include "environment.h"
#include "fmu_math.h"

#define WITHIN 1e-9            /* of a tick: how near to a whole number of them a time must be */
#define MOST_TICKS 10000000.0  /* in one step: beyond it the step size is a mistake */

static int64_t gcd(int64_t a, int64_t b) {
    while (b) {
        const int64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

static double nearest(double x) { return floor(x + 0.5); }

/* The simplest fraction that is the start time: that of the shortest denominator, as cosim/core/time.py finds it. */
static FmuStatus use_start(FmuInstance *self, double start) {
    State *s = self->state;
    for (int64_t q = 1; q <= 1000000; q++) {
        const double p = nearest(start * (double)q);
        if (!(fabs(p) < (double)EXACT)) break;
        if (p / (double)q != start) continue;
        const int64_t d = P->d / gcd(P->d, q) * q; /* least common multiple */
        s->a = P->a * (d / P->d);
        s->b = (int64_t)p * (d / q);
        s->d = d;
        s->start = start;
        return d < EXACT && fabs((double)s->b) < (double)EXACT
                   ? FMU_OK
                   : fmu_fail(self, FMU_ERROR, "startTime %.17g cannot be kept exactly", start);
    }
    return fmu_fail(
        self, FMU_ERROR, "startTime %.17g is no fraction of seconds with a denominator up to a million", start);
}

/* Number of ticks in a duration, or -1 with an error. `slack`: times that are differences of others have their
 * rounding. */
static int64_t ticks_in(FmuInstance *self, const char *what, double duration, double slack) {
    const double tick = (double)P->a / (double)P->d, ticks = duration / tick, whole = nearest(ticks);
    if (fabs(ticks - whole) <= WITHIN + slack / tick && whole >= 0.0 && whole < (double)EXACT) return (int64_t)whole;
    (void)fmu_fail(self, FMU_ERROR,
        "%s %.17g s is no whole number of ticks of %.9g s, the common divisor of its components' steps", what, duration,
        tick);
    return -1;
}

FmuStatus fmu_setup(FmuInstance *self, double start_time, int has_stop, double stop_time) {
    State *s = self->state;
    if (!isfinite(start_time)) return fmu_fail(self, FMU_ERROR, "startTime %g is not finite", start_time);
    if (has_stop && !(isfinite(stop_time) && stop_time >= start_time))
        return fmu_fail(self, FMU_ERROR, "stopTime %g is not a time after startTime %g", stop_time, start_time);
    const FmuStatus status = use_start(self, start_time);
    if (status != FMU_OK) return status;
    s->tick = 0;
    s->stop_tick = s->ending = INT64_MAX;
    if (has_stop) {
        const double tick = (double)P->a / (double)P->d, ticks = (stop_time - start_time) / tick;
        if (ticks < (double)EXACT) s->stop_tick = (int64_t)floor(ticks * (1.0 + 4.0 * DBL_EPSILON) + WITHIN);
    }
    s->settled = 0;
    return FMU_OK;
}

void container_forget_last(FmuInstance *self, int32_t i) {
    LastStep *last = &self->repeated[i];
    if (last->state && !self->components[i].dead) (void)component_forget(&self->components[i], &last->state);
    last->state = NULL;
}

/* From now on the engine calls back for components that repeat their steps. There is no last step. */
void container_repeat_steps(FmuInstance *self) {
    for (int32_t i = 0; i < P->n_components && self->state->mode == MODE_STEP; i++)
        if (P->components[i].repeats) {
            container_forget_last(self, i);
            self->bound[i].fmi = self->bound[i].direct = 0;
        }
}

/* Whether component i has asked for the end of the simulation in its last step, which began at time t; `whole`: it took
 * that step first. */
static bool asked_to_end(FmuInstance *self, int32_t i, double t, bool *whole) {
    const PlanComponent *p = &P->components[i];
    const double step = self->bound[i].step;
    double reached = -INFINITY;
    const uint32_t status = self->engine.status;
    if (p->version == 3 && !p->integrated) {
        *whole = status <= fmi3Warning && !self->flags[4 * i + 3] && ENGINE_IS_WHOLE(self->last[i], t, step);
        return status <= fmi3Discard && self->flags[4 * i + 2];
    }
    const bool asked = status == fmi2Discard && component_asked_to_end(&self->components[i], &reached);
    *whole = ENGINE_IS_WHOLE(reached, t, step);
    return asked;
}

static int state_failed(FmuInstance *self, int32_t call, uint32_t status) {
    self->engine.call = call;
    self->engine.status = status;
    return ENGINE_STATE_FAILED;
}

/* A step of a component from t on, or, where t is NaN, the last one again with the inputs as they are. */
int container_repeat(void *context, int32_t i, double t) {
    FmuInstance *self = context;
    LastStep *last = &self->repeated[i];
    Component *m = &self->components[i];
    EngineComponent e = self->bound[i];
    e.fmi = P->components[i].version;
    int result = ENGINE_AT_END;
    uint32_t status = fmi3OK;
    bool whole;
    if (isnan(t)) {
        if (last->state && (status = component_restore(m, last->state)) > fmi3Warning)
            return state_failed(self, CALL_RESTORE, status);
        result = engine_set(&self->engine, &e);
        if (!result && last->state) {
            result = engine_step(&self->engine, &e, last->t);
            /* as when the step was done first */
            if (result && asked_to_end(self, i, last->t, &whole)) result = ENGINE_AT_END;
        }
    } else {
        container_forget_last(self, i);
        if ((status = component_save(m, &last->state)) > fmi3Warning)
            return state_failed(self, CALL_SAVE, status);
        last->t = t;
        result = engine_set(&self->engine, &e);
        if (!result) result = engine_step(&self->engine, &e, t);
    }
    return result ? result : engine_get(&self->engine, &e);
}

/* A component has asked for the end, at the present time. */
static FmuStatus end_of_all(FmuInstance *self, int32_t i) {
    self->state->ended = 1;
    (void)fmu_fail(self, FMU_DISCARD, "component '%s' requests termination at time %.9g s", P->components[i].name,
        fmu_time(self));
    return P->fmi == 3 ? FMU_OK : FMU_DISCARD; /* FMI 3.0 has a flag for it (fmu_ended) */
}

/* What an instant of the engine has ended with. */
static FmuStatus outcome(FmuInstance *self, int result) {
    const int32_t i = self->engine.component;
    if (result == ENGINE_AT_END) return FMU_OK;
    self->state->tick = self->engine.tick;
    if (result == ENGINE_NO_SOLUTION) return container_not_solved(self);
    if (result == ENGINE_NOT_FINITE) {
        const PlanComponent *p = &P->components[i];
        for (uint32_t k = p->first; k < p->first + p->n_outputs; k++)
            if (!isfinite(self->values[k]))
                return fmu_fail(self, FMU_ERROR, "%s is %g at time %.9g s", P->owners[k], self->values[k],
                                fmu_time(self) + (i < P->n_discrete ? 0.0 : p->step));
    }
    return container_call_failed(self, i);
}

static int64_t earlier(int64_t a, int64_t b) { return a < b ? a : b; }

/* From the present instant, which has arrived, to the end. Where a component asks for the end after its step, all
 * others go on until that step ends; where it did not take it, or has asked in its first event iteration, only what is
 * left of the sample is done. */
static int run_to(FmuInstance *self, int64_t end) {
    State *const s = self->state;
    Engine *const e = &self->engine;
    bool advances = s->tick < s->ending, whole = false;
    int result = engine_sample(e, fmu_time(self));
    if (!result && advances) result = engine_advance(e, fmu_time(self));
    for (;;) {
        if (!result) {
            const int64_t until = earlier(end, s->ending);
            s->ended = !advances;
            if (!advances) s->tick = e->tick;
            if (!advances || ++e->tick > until) return ENGINE_AT_END;
            result = engine_run(e, until);
            if (!result) return ENGINE_AT_END;
        }
        const int32_t i = e->component;
        const double t = (double)(e->tick * s->a + s->b) / (double)s->d;
        if ((result != ENGINE_CALL_FAILED && result != ENGINE_BACK_FAILED) || e->call != 0) return result;
        if (!asked_to_end(self, i, t, &whole)) return result;
        EngineComponent stepped = self->bound[i];
        stepped.fmi = P->components[i].version;
        result = whole ? engine_get(e, &stepped) : ENGINE_AT_END;
        engine_put_back_environment(e, &self->bound[i]);
        if (result) return result;
        const int64_t its_end = e->tick + (whole ? e->clocks[stepped.clock].period : 0);
        char text[1024];
        int32_t call = 0;
        if (its_end < s->ending) s->ends_by = container_culprit(self, i, &call, text, sizeof text);
        s->ending = earlier(s->ending, its_end);
        advances &= whole;
        if (i < P->n_discrete) result = engine_sample(e, t);
        if (!result && advances) result = engine_advance(e, t);
    }
}

/* After steps: traps too, which the engine does not look at after each of them; who it was is known of one only. */
static void restore_environment(FmuInstance *self, uint32_t before) {
    Component *foreign = NULL;
    int32_t n = 0;
    for (int32_t i = 0; i < P->n_components; i++)
        if (self->components[i].library) foreign = &self->components[i], n++;
    const uint32_t left = n ? environment_restore(before) : 0u;
    container_say_changes(self);
    if (n == 1) component_changed(foreign, left);
    else if (n && left & ~foreign->changed)
        foreign->changed |= left,
            (void)fmu_fail(self, FMU_WARNING, "a component changes floating-point arithmetic; that is restored");
}

FmuStatus fmu_do_step(FmuInstance *self, const char *function, double time, double step) {
    State *s = self->state;
    Engine *e = &self->engine;
    const double now = fmu_time(self), rounding = 4.0 * DBL_EPSILON * (fabs(time) + fabs(step));
    if (!isfinite(step) || step <= 0.0)
        return fmu_fail(self, FMU_ERROR, "%s: communicationStepSize %g is not a positive number", function, step);
    if (!isfinite(time))
        return fmu_fail(self, FMU_ERROR, "%s: currentCommunicationPoint %g is not finite", function, time);
    if (fabs(time - now) > WITHIN * (double)P->a / (double)P->d + rounding)
        return fmu_fail(
            self, FMU_ERROR, "%s: currentCommunicationPoint %.17g, but the instance is at %.17g", function, time, now);
    if (s->ended) return fmu_fail(self, FMU_ERROR, "%s: a component has ended the simulation", function);
    const int64_t n = ticks_in(self, "communicationStepSize", step, rounding);
    if (n < 0) return FMU_ERROR;
    if (n == 0 || (double)n > MOST_TICKS)
        return fmu_fail(self, FMU_ERROR, "%s: communicationStepSize %g s is %lld ticks", function, step, (long long)n);
    const int64_t end = s->tick + n;
    if (end > s->stop_tick)
        return fmu_fail(self, FMU_ERROR, "%s: the step ends at %.12g, after stopTime", function, time + step);
    if ((double)end * (double)s->a + fabs((double)s->b) >= (double)EXACT)
        return fmu_fail(self, FMU_ERROR, "%s: times from %.12g s on cannot be kept exactly", function, time);
    e->a = s->a;
    e->b = s->b;
    e->d = s->d;
    e->tick = s->tick;
    const uint32_t environment = e->environment = environment_bits();
    engine_look_up(e, s->tick); /* arrived already */
    FmuStatus status = outcome(self, run_to(self, end));
    restore_environment(self, environment);
    if (s->ended) return end_of_all(self, s->ends_by);
    if (status == FMU_OK) {
        e->tick = s->tick = earlier(end, s->ending);
        engine_look_up(e, s->tick);
        status = outcome(self, engine_arrive(e, fmu_time(self)));
        if (status == FMU_OK && s->tick == s->ending) status = end_of_all(self, s->ends_by);
    }
    if (status != FMU_OK && !s->ended) s->mode = MODE_ERROR;
    return status;
}
