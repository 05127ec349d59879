/* Solves an algebraic loop: see engine.h. */
#include "engine.h"

#include "environment.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { MOST_ITERATIONS = 50, MOST_HALVINGS = 12, MOST_EVENTS = 100, WARNING = 1, DISCARD = 2, ERROR = 3 };
#define DIFFERENCE 0x1p-20   /* by which an unknown is changed for the Jacobian, relative to its size */
#define SUFFICIENT 1e-4      /* a step of Newton's method must reduce the residual by this share of what it promises */
#define POOR 0.1             /* a step that leaves a larger share of the residual outdates the Jacobian */

static double size_of(const EngineLoop *l, const double *z, int32_t k) {
    const double size = fabs(z[k]);
    return size > l->nominal[k] ? size : l->nominal[k];
}

/* The largest residual relative to the size of its unknown; infinite where one is not finite. */
static double largest(const EngineLoop *l, const double *z, const double *residual) {
    double found = 0.0;
    for (int32_t k = 0; k < l->n; k++) {
        const double relative = fabs(residual[k]) / size_of(l, z, k);
        if (!(relative <= DBL_MAX)) return INFINITY;
        if (relative > found) found = relative;
    }
    return found;
}

static void put(Engine *e, const EngineLoop *l, const double *z) {
    for (int32_t k = 0; k < l->n; k++) e->values[l->published[k]] = e->values[l->computed[k]] = z[k];
}

/* The derivatives of component `m`, number `i` of the loop, or NULL; one that repeats its steps has none. */
static const EngineDerivative *offered(const EngineLoop *l, const EngineComponent *m, int32_t i) {
    const EngineDerivative *d = l->derivatives && m->fmi ? &l->derivatives[i] : NULL;
    return d && (d->call2 || d->call3) ? d : NULL;
}

/* Inputs and outputs in the loop as the component has just computed them. */
static void keep(const EngineComponent *m, const EngineDerivative *d) {
    double *u = d->work, *y = u + d->n_knowns;
    for (uint32_t k = 0; k < d->n_knowns; k++) u[k] = m->u[d->inputs[k]];
    for (uint32_t k = 0; k < d->n_unknowns; k++) y[k] = m->y[d->outputs[k]];
}

/* Outputs in the loop by their derivative along the change of inputs since `keep`, which is `change` times a direction.
 * They are NaN where the component does not tell it. */
static int extrapolate(Engine *e, EngineLoop *l, const EngineComponent *m, const EngineDerivative *d, double change) {
    double *u = d->work, *y = u + d->n_knowns, *seed = y + d->n_unknowns, *slope = seed + d->n_knowns;
    engine_gather(e, m, NAN);
    for (uint32_t k = 0; k < d->n_knowns; k++) seed[k] = (m->u[d->inputs[k]] - u[k]) / change;
    l->n_derivatives++;
    const uint32_t status = d->call3
        ? d->call3(m->instance, d->unknowns, d->n_unknowns, d->knowns, d->n_knowns, seed, d->n_knowns, slope,
              d->n_unknowns)
        : d->call2(m->instance, d->unknowns, d->n_unknowns, d->knowns, d->n_knowns, seed, slope);
    engine_put_back_environment(e, m);
    if (status > ERROR) {
        e->component = (int32_t)(m - e->components);
        e->call = ENGINE_DERIVATIVE;
        e->status = status;
        return ENGINE_CALL_FAILED;
    }
    for (uint32_t k = 0; k < d->n_unknowns; k++)
        m->y[d->outputs[k]] = status > WARNING ? NAN : y[k] + slope[k] * change;
    return ENGINE_AT_END;
}

/* residual = G(z) - z, NaN where a component computes what is not finite; the unknowns are z afterward. With a `change`
 * by which z differs from the last point, along derivatives where there are any. A component that returns Discard at a
 * trial point has no value there, too. */
static int evaluate(Engine *e, EngineLoop *l, const double *z, double change, double *residual) {
    bool finite = true, evaluated = false;
    put(e, l, z);
    for (int32_t i = 0; i < l->n_components && finite; i++) {
        const EngineComponent *m = &e->components[l->components[i]];
        const EngineDerivative *d = offered(l, m, i);
        const bool along = d && change != 0.0;
        const int result = along ? extrapolate(e, l, m, d, change) : engine_exchange(e, m, NAN);
        evaluated |= !along;
        if (result == ENGINE_CALL_FAILED && e->status == DISCARD && z != l->work) {
            finite = false;
            break;
        }
        if (result) return result;
        if (d && !along) keep(m, d);
        finite = engine_finite(m->y, m->n_outputs);
        if (finite) engine_publish_outputs(e, m);
    }
    l->n_evaluations += evaluated;
    for (int32_t k = 0; k < l->n; k++) residual[k] = finite ? e->values[l->computed[k]] - z[k] : NAN;
    put(e, l, z);
    return ENGINE_AT_END;
}

/* jacobian[i n + k] = d residual i / d z k, by forward differences from z and its residual, or along derivatives. */
static int differentiate(Engine *e, EngineLoop *l, bool derivatives, const double *z, const double *residual,
    double *other, double *there, double *jacobian) {
    memcpy(other, z, (size_t)l->n * sizeof(double));
    for (int32_t k = 0; k < l->n; k++) {
        other[k] = z[k] + DIFFERENCE * size_of(l, z, k);
        const double change = other[k] - z[k];
        const int result = evaluate(e, l, other, derivatives ? change : 0.0, there);
        if (result) return result;
        for (int32_t i = 0; i < l->n; i++) jacobian[i * l->n + k] = (there[i] - residual[i]) / change;
        other[k] = z[k];
    }
    return ENGINE_AT_END;
}

/* step = -jacobian^-1 residual, in unknowns of size 1, by elimination with the largest pivots. Returns whether there is
 * one. */
static bool newton_step(const EngineLoop *l, const double *z, const double *jacobian, const double *residual,
    double *matrix, double *step) {
    const int32_t n = l->n;
    for (int32_t i = 0; i < n; i++) {
        for (int32_t k = 0; k < n; k++)
            matrix[i * n + k] = jacobian[i * n + k] * size_of(l, z, k) / size_of(l, z, i);
        step[i] = -residual[i] / size_of(l, z, i);
    }
    for (int32_t k = 0; k < n; k++) {
        int32_t pivot = k;
        for (int32_t i = k + 1; i < n; i++)
            if (fabs(matrix[i * n + k]) > fabs(matrix[pivot * n + k])) pivot = i;
        if (!(fabs(matrix[pivot * n + k]) > DBL_EPSILON)) return false;
        if (pivot != k) {
            for (int32_t j = k; j < n; j++) {
                const double swapped = matrix[k * n + j];
                matrix[k * n + j] = matrix[pivot * n + j];
                matrix[pivot * n + j] = swapped;
            }
            const double swapped = step[k];
            step[k] = step[pivot];
            step[pivot] = swapped;
        }
        for (int32_t i = k + 1; i < n; i++) {
            const double factor = matrix[i * n + k] / matrix[k * n + k];
            for (int32_t j = k + 1; j < n; j++) matrix[i * n + j] -= factor * matrix[k * n + j];
            step[i] -= factor * step[k];
        }
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        for (int32_t j = i + 1; j < n; j++) step[i] -= matrix[i * n + j] * step[j];
        step[i] /= matrix[i * n + i];
    }
    for (int32_t k = 0; k < n; k++) step[k] *= size_of(l, z, k);
    return true;
}

/* Broyden's update of the Jacobian for a step from z to `other`, along which the residuals have changed. */
static void update(const EngineLoop *l, const double *z, const double *residual, const double *other,
    const double *there, double *jacobian) {
    double length = 0.0;
    for (int32_t k = 0; k < l->n; k++) {
        const double relative = (other[k] - z[k]) / size_of(l, z, k);
        length += relative * relative;
    }
    for (int32_t i = 0; i < l->n; i++) {
        double error = there[i] - residual[i];
        for (int32_t k = 0; k < l->n; k++) error -= jacobian[i * l->n + k] * (other[k] - z[k]);
        for (int32_t k = 0; k < l->n; k++) {
            const double size = size_of(l, z, k);
            jacobian[i * l->n + k] += error * ((other[k] - z[k]) / (size * size)) / length;
        }
    }
}

/* A step of Newton's method that reduces the residual, halved if need be and `halvings` allows. Returns the largest
 * residual that it reaches, or infinity. */
static int search(Engine *e, EngineLoop *l, double size, const double *z, const double *step, int32_t halvings,
    double *other, double *there, double *reached) {
    double factor = 1.0;
    for (int32_t i = 0; i <= halvings; i++, factor *= 0.5) {
        for (int32_t k = 0; k < l->n; k++) other[k] = z[k] + factor * step[k];
        const int result = evaluate(e, l, other, 0.0, there);
        if (result) return result;
        *reached = largest(l, other, there);
        if (*reached < size * (1.0 - SUFFICIENT * factor)) return ENGINE_AT_END;
    }
    *reached = INFINITY;
    return ENGINE_AT_END;
}

static int no_solution(Engine *e, const EngineLoop *l, int32_t loop) {
    put(e, l, l->work);
    e->component = loop;
    e->call = 0;
    return ENGINE_NO_SOLUTION;
}

size_t engine_loop_work(int32_t n) { return (size_t)n * (2 * (size_t)n + 5); }

int engine_solve(Engine *e, int32_t loop) {
    EngineLoop *l = &e->loops[loop];
    const size_t n = (size_t)l->n;
    double *z = l->work, *residual = z + n, *step = residual + n, *other = step + n, *there = other + n,
           *jacobian = there + n, *matrix = jacobian + n * n;
    const int64_t before = l->n_evaluations;
    for (size_t k = 0; k < n; k++) z[k] = e->values[l->published[k]];
    int result = evaluate(e, l, z, 0.0, residual);
    if (result) return result;
    double size = largest(l, z, residual);
    bool outdated = true; /* the Jacobian */
    for (int32_t i = 0; size > l->tolerance; i++) {
        if (i == MOST_ITERATIONS || isinf(size)) return no_solution(e, l, loop);
        const bool derivatives = i == 0 && l->derivatives, fresh = outdated && !derivatives;
        if (outdated && (result = differentiate(e, l, derivatives, z, residual, other, there, jacobian))) return result;
        double reached = INFINITY;
        if (newton_step(l, z, jacobian, residual, matrix, step)) {
            result = search(e, l, size, z, step, fresh ? MOST_HALVINGS : 0, other, there, &reached);
            if (result) return result;
        }
        outdated = reached > POOR * size;
        if (isinf(reached)) {
            if (fresh) return no_solution(e, l, loop);
            continue;
        }
        update(l, z, residual, other, there, jacobian);
        memcpy(z, other, n * sizeof(double));
        memcpy(residual, there, n * sizeof(double));
        size = reached;
    }
    l->n_solutions++;
    if (l->n_evaluations - before > l->most_evaluations) l->most_evaluations = l->n_evaluations - before;
    return ENGINE_AT_END;
}

/* Discrete states follow the inputs. */
static int update_discrete(Engine *e, const EngineLoop *l) {
    for (int32_t i = 0; i < l->n_components; i++) {
        const EngineComponent *m = &e->components[l->components[i]];
        if (!m->integrated || !m->fmi) continue;
        const int result = engine_step(e, m, NAN);
        engine_put_back_environment(e, m);
        if (!result) continue;
        e->component = l->components[i];
        return result;
    }
    return ENGINE_AT_END;
}

/* A sum that changes, but for rounding, as soon as a value does that the loop's components read of each other: weights
 * between 1 and 2 keep changes from canceling. `size`: of its terms. */
static double weighted_sum(const Engine *e, const EngineLoop *l, double *size) {
    double sum = 0.0, weight = 1.0;
    *size = 1.0;
    for (uint32_t k = 0; k < l->n_read; k++) {
        const double term = weight * e->values[l->read[k]];
        sum += term;
        *size += fabs(term);
        weight += weight < 1.4 ? 0.6180339887498949 : -0.3819660112501051;
    }
    return sum;
}

int engine_solve_events(Engine *e, int32_t loop) {
    const EngineLoop *l = &e->loops[loop];
    int result = engine_solve(e, loop);
    if (result || !l->n_read) return result;
    for (int32_t i = 0; i < MOST_EVENTS; i++) {
        double size;
        const double before = weighted_sum(e, l, &size);
        result = update_discrete(e, l);
        if (!result) result = engine_solve(e, loop);
        if (result || !(fabs(weighted_sum(e, l, &size) - before) > 1e-12 * size)) return result;
    }
    e->component = loop;
    e->call = 1;
    return ENGINE_NO_SOLUTION;
}

/* Whether what it reads has changed since `before`; not where that is not finite, which ends the run. */
static bool has_changed(const Engine *e, const EngineFollower *f, const double *before) {
    bool found = false;
    for (uint32_t k = 0; k < f->n_read; k++) {
        const double value = e->values[f->read[k]];
        if (e->check_finite && !engine_finite(&value, 1)) return false;
        if (value != before[f->read[k]]) found = true;
    }
    return found;
}

/* A component computes its outputs of its inputs as they are. A Co-Simulation FMU that refuses to do so without a step
 * keeps those that it refuses, all of them if it refuses inputs: if an input is the reason, its step says so. */
static int compute(Engine *e, const EngineComponent *m) {
    int result = engine_exchange(e, m, NAN);
    if (result == ENGINE_CALL_FAILED && !m->integrated && e->status <= ERROR) {
        result = ENGINE_AT_END;
        if (e->call < 0) result = engine_get_each(e, m);
        else engine_keep_outputs(e, m, m->y, m->n_outputs);
        engine_put_back_environment(e, m);
    }
    if (!result) engine_publish_outputs(e, m);
    return result;
}

int engine_follow_events(Engine *e, double *before) {
    e->environment = environment_bits();
    for (const EngineComponent *m = e->components; m < e->components + e->n_components; m++) {
        if (!m->begins_with_events) memcpy(before + m->first, m->y, m->n_outputs * sizeof(double));
        engine_publish_outputs(e, m);
    }
    for (const EngineFollower *f = e->followers; f < e->followers + e->n_followers; f++) {
        const bool whole = f->component < 0, changed = has_changed(e, f, before);
        int result = ENGINE_AT_END;
        if (changed || (whole && e->loops[f->loop].n_read))
            result = whole          ? engine_solve_events(e, f->loop)
                     : f->loop >= 0 ? engine_solve(e, f->loop)
                                    : compute(e, &e->components[f->component]);
        if (result) return result;
    }
    engine_publish(e);
    return ENGINE_AT_END;
}
