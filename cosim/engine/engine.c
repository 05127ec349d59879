/* Executes a plan: see engine.h. */
#include "engine.h"

#include "environment.h"
#include "hints.h"

#include <math.h>
#include <string.h>

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#define NOINLINE static __attribute__((noinline)) /* what only some systems need stays out of the way of what all do */
#else
#define INLINE static inline
#define NOINLINE static
#endif

enum { LARGEST_SUCCESS = 1, ERROR = 3 }; /* OK and Warning; not Fatal */

/* ------------------------------------------------------------------ values */

/* Extrapolate inputs (not where t is NaN), and convert them to their units. */
NOINLINE void convert(const double *values, const EngineComponent *m, double t) {
    double *u = m->u;
    for (size_t i = 0; i < m->n_extrapolations && !isnan(t); i++) {
        const EngineExtrapolation *l = &m->extrapolations[i];
        u[l->input] += (values[l->now] - values[l->before]) * ((t + l->shift - values[l->sample_time]) / l->period);
    }
    if (m->scale) {
        for (size_t i = 0; i < m->n_inputs; i++) u[i] *= m->scale[i];
        for (size_t i = 0; i < m->n_inputs; i++) u[i] += m->offset[i];
    }
}

INLINE void gather(const double *values, const EngineComponent *m, double t) {
    double *u = m->u;
    for (size_t i = 0; i < m->n_inputs; i++) u[i] = values[m->index[i]];
    if (m->n_extrapolations | (m->scale != NULL)) convert(values, m, t);
}

void engine_gather(const Engine *e, const EngineComponent *m, double t) { gather(e->values, m, t); }

#define FOR_ALL(type, to, from) \
    for (size_t i = 0; i < s->n; i++) to = (type)(from); \
    break

/* u to the buffer of a call. */
static void scatter(const EngineTransfer *s, const double *u) {
    const uint32_t *at = s->element, *place = s->place;
    switch (s->type) {
        case ENGINE_DOUBLE: FOR_ALL(double, ((double *)s->data)[at[i]], u[place[i]]);
        case ENGINE_FLOAT: FOR_ALL(float, ((float *)s->data)[at[i]], u[place[i]]);
        case ENGINE_INT8: FOR_ALL(int8_t, ((int8_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_UINT8: FOR_ALL(uint8_t, ((uint8_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_INT16: FOR_ALL(int16_t, ((int16_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_UINT16: FOR_ALL(uint16_t, ((uint16_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_INT32: FOR_ALL(int32_t, ((int32_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_UINT32: FOR_ALL(uint32_t, ((uint32_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_INT64: FOR_ALL(int64_t, ((int64_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_UINT64: FOR_ALL(uint64_t, ((uint64_t *)s->data)[at[i]], u[place[i]]);
        case ENGINE_BOOL: FOR_ALL(bool, ((bool *)s->data)[at[i]], u[place[i]] != 0.0);
    }
}

/* The buffer of a call to y. */
static void collect(const EngineTransfer *s, double *y) {
    const uint32_t *at = s->element, *place = s->place;
    switch (s->type) {
        case ENGINE_DOUBLE: FOR_ALL(double, y[place[i]], ((const double *)s->data)[at[i]]);
        case ENGINE_FLOAT: FOR_ALL(double, y[place[i]], ((const float *)s->data)[at[i]]);
        case ENGINE_INT8: FOR_ALL(double, y[place[i]], ((const int8_t *)s->data)[at[i]]);
        case ENGINE_UINT8: FOR_ALL(double, y[place[i]], ((const uint8_t *)s->data)[at[i]]);
        case ENGINE_INT16: FOR_ALL(double, y[place[i]], ((const int16_t *)s->data)[at[i]]);
        case ENGINE_UINT16: FOR_ALL(double, y[place[i]], ((const uint16_t *)s->data)[at[i]]);
        case ENGINE_INT32: FOR_ALL(double, y[place[i]], ((const int32_t *)s->data)[at[i]]);
        case ENGINE_UINT32: FOR_ALL(double, y[place[i]], ((const uint32_t *)s->data)[at[i]]);
        case ENGINE_INT64: FOR_ALL(double, y[place[i]], ((const int64_t *)s->data)[at[i]]);
        case ENGINE_UINT64: FOR_ALL(double, y[place[i]], ((const uint64_t *)s->data)[at[i]]);
        case ENGINE_BOOL: FOR_ALL(double, y[place[i]], ((const bool *)s->data)[at[i]]);
    }
}

COLD int failed(Engine *e, int32_t call, uint32_t status) {
    e->call = call;
    e->status = status;
    return ENGINE_CALL_FAILED;
}

/* The three calls of a component, once for each version of FMI: what differs are the arguments. */
#define CALL2(s) (s)->call2(m->instance, (s)->references, (s)->n_references, (s)->data)
#define CALL3(s) (s)->call3(m->instance, (s)->references, (s)->n_references, (s)->data, (s)->n_data)
#define SET_ALL(CALL)                                                   \
    for (const EngineTransfer *s = m->sets, *end = s + m->n_sets; s < end; s++) { \
        if (s->element) scatter(s, m->u);                               \
        const uint32_t status = CALL(s);                                \
        if (status > LARGEST_SUCCESS) return failed(e, (int32_t)(s - m->sets) + 1, status); \
    }
#define GET_ALL(CALL)                                                   \
    for (const EngineTransfer *s = m->gets, *end = s + m->n_gets; s < end; s++) { \
        const uint32_t status = CALL(s);                                \
        if (status > LARGEST_SUCCESS) return failed(e, (int32_t)(m->gets - s) - 1, status); \
        if (s->element) collect(s, m->y);                               \
    }

int engine_set(Engine *e, const EngineComponent *m) {
    if (m->fmi == 3) SET_ALL(CALL3)
    else SET_ALL(CALL2)
    return ENGINE_AT_END;
}

int engine_get(Engine *e, const EngineComponent *m) {
    if (m->fmi == 3) GET_ALL(CALL3)
    else GET_ALL(CALL2)
    return ENGINE_AT_END;
}

void engine_keep_outputs(Engine *e, const EngineComponent *m, const double *y, size_t n) {
    for (const EngineCopy *c = m->copies + m->n_copies_before; c < m->copies + m->n_copies; c++)
        for (uint32_t k = 0; k < c->n; k++) {
            double *const computed = e->values + c->from + k;
            if (computed >= y && computed < y + n) *computed = e->values[c->to + k];
        }
}

int engine_get_each(Engine *e, const EngineComponent *m) {
    static const uint8_t bytes[] = {8, 4, 1, 1, 2, 2, 4, 4, 8, 8, sizeof(bool)}; /* by EngineType */
    engine_keep_outputs(e, m, m->y, m->n_outputs);
    for (const EngineTransfer *s = m->gets, *end = s + m->n_gets; s < end; s++) {
        EngineTransfer one = *s;
        for (size_t k = 0, at = 0; k == 0 || k < s->n_references; k++, at += one.n_data) {
            if (s->n_references) { /* else the call knows its variables */
                one.references = s->references + k;
                one.n_references = 1;
                one.data = (char *)s->data + at * bytes[s->type];
                one.n_data = s->widths ? s->widths[k] : 1;
            }
            const uint32_t status = m->fmi == 3 ? CALL3(&one) : CALL2(&one);
            if (status > ERROR) return failed(e, (int32_t)(m->gets - s) - 1, status);
            if (status > LARGEST_SUCCESS && !s->element) engine_keep_outputs(e, m, one.data, one.n_data);
            for (size_t i = 0; i < s->n && status <= LARGEST_SUCCESS; i++) {
                const EngineTransfer value = {
                    .data = s->data, .type = s->type, .n = 1, .element = s->element + i, .place = s->place + i};
                if (s->element[i] >= at && s->element[i] < at + one.n_data) collect(&value, m->y);
            }
        }
    }
    return ENGINE_AT_END;
}

/* ------------------------------------------------------------------ steps */

INLINE int step2(Engine *e, const EngineComponent *m, double t) {
    const uint32_t status = m->step2(m->stepped, t, m->step, m->no_set_prior);
    return RARELY(status > LARGEST_SUCCESS) ? failed(e, 0, status) : ENGINE_AT_END;
}

INLINE int step3(Engine *e, const EngineComponent *m, double t) {
    bool *flags = m->flags;
    const uint32_t status = m->step3(m->stepped, t, m->step, m->no_set_prior, flags, flags + 2, flags + 3, m->last);
    return RARELY((status > LARGEST_SUCCESS) | flags[2] | flags[3]) ? failed(e, 0, status) : ENGINE_AT_END;
}

int engine_step(Engine *e, const EngineComponent *m, double t) { return m->fmi == 3 ? step3(e, m, t) : step2(e, m, t); }

/* Set, step and get of a component with any number of calls. */
NOINLINE int run_parts(Engine *e, const EngineComponent *m, double t) {
    int result = engine_set(e, m);
    if (!result) result = m->fmi == 3 ? step3(e, m, t) : step2(e, m, t);
    return result ? result : engine_get(e, m);
}

/* The same where there is one call of each. */
#define RUN(CALL, STEP)                                                 \
    uint32_t status = CALL(m->sets);                                    \
    if (RARELY(status > LARGEST_SUCCESS)) return failed(e, 1, status);  \
    const int result = STEP(e, m, t);                                   \
    if (RARELY(result)) return result;                                  \
    status = CALL(m->gets);                                             \
    return RARELY(status > LARGEST_SUCCESS) ? failed(e, -1, status) : ENGINE_AT_END

INLINE int run2(Engine *e, const EngineComponent *m, double t) { RUN(CALL2, step2); }
INLINE int run3(Engine *e, const EngineComponent *m, double t) { RUN(CALL3, step3); }

NOINLINE int run_back(Engine *e, const EngineComponent *m, double t) {
    return e->back(e->context, (int32_t)(m - e->components), t) == 0 ? ENGINE_AT_END : ENGINE_BACK_FAILED;
}

COLD void put_back(Engine *e, const EngineComponent *m) {
    e->components[m - e->components].changed |= environment_restore(e->environment);
}

void engine_put_back_environment(Engine *e, const EngineComponent *m) {
    if (m->foreign) put_back(e, m);
}

/* One communication step of a component: inputs as they stand, doStep, outputs. */
INLINE int run_component(Engine *e, const EngineComponent *m, double t) {
    gather(e->values, m, t);
    const int result = !m->direct    ? (m->fmi ? run_parts(e, m, t) : run_back(e, m, t))
                       : m->fmi == 3 ? run3(e, m, t)
                                     : run2(e, m, t);
    if (m->foreign && RARELY(environment_differs(e->environment))) put_back(e, m);
    if (RARELY(result)) e->component = (int32_t)(m - e->components);
    return result;
}

int engine_component(Engine *e, int32_t number, double t) { return run_component(e, &e->components[number], t); }

INLINE bool all_finite(const double *y, size_t n) {
    const uint64_t exponent = UINT64_C(0x7ff) << 52;
    uint64_t found = 0;
    for (size_t i = 0; i < n; i++) {
        uint64_t bits;
        memcpy(&bits, &y[i], sizeof bits);
        found |=
            (bits & exponent) + (UINT64_C(1) << 52); /* into the highest bit, where all bits of the exponent are set */
    }
    return !(found >> 63);
}

bool engine_finite(const double *y, size_t n) { return all_finite(y, n); }

/* Whether the outputs of the components that are due are finite, of those from number `first` to before `end` in their
 * list. */
COLD int check_outputs_finite(Engine *e, int32_t first, int32_t end) {
    if (!e->check_finite) return ENGINE_AT_END;
    for (int32_t k = first; k < end; k++) {
        const EngineComponent *m = e->list[k];
        if (!all_finite(m->y, m->n_outputs)) {
            e->component = (int32_t)(m - e->components);
            return ENGINE_NOT_FINITE;
        }
    }
    return ENGINE_AT_END;
}

/* The same for all continuous components that are due, piece by piece; who it is is looked up if something is found. */
INLINE int check_computed_finite(Engine *e) {
    if (!e->check_finite) return ENGINE_AT_END;
    for (int32_t k = 0; k < e->n_computed; k++)
        if (!all_finite(e->values + e->computed[k].from, e->computed[k].n))
            return check_outputs_finite(e, e->n_due_discrete, e->n_due);
    return ENGINE_AT_END;
}

/* Solve the loops that are due, or those of them that follow discrete components. */
COLD int solve_due(Engine *e, bool after_discrete) {
    for (int32_t i = 0; i < e->n_loops; i++) {
        if (!e->due[e->loops[i].clock] || (after_discrete && !e->loops[i].follows_discrete)) continue;
        const int result = engine_solve_events(e, i);
        if (result) return result;
    }
    return ENGINE_AT_END;
}

INLINE bool holds(const EngineStop *s, const double *values) {
    const double value = s->scale * values[s->slot] + s->offset;
    switch (s->relation) {
        case ENGINE_GE: return value >= s->value;
        case ENGINE_GT: return value > s->value;
        case ENGINE_LE: return value <= s->value;
        default: return value < s->value;
    }
}

/* Whether there is space for the sample of an instant. */
INLINE int begun(const Engine *e, int64_t tick) {
    (void)tick;
    return e->due[e->n_clocks - 1] && e->count == e->room ? ENGINE_FULL : ENGINE_AT_END;
}

/* Record, and see whether the run ends. */
INLINE int sampled(Engine *e, double t) {
    if (e->due[e->n_clocks - 1]) {
        double *row = e->rows + (size_t)e->count * e->n_recorded;
        e->times[e->count++] = t;
        for (size_t i = 0; i < e->n_recorded; i++) row[i] = e->values[e->recorded[i]];
    }
    for (int32_t i = 0; i < e->n_stops; i++)
        if (holds(&e->stops[i], e->values)) {
            e->call = i;
            return ENGINE_STOPPED;
        }
    if (RARELY(e->checks) && e->back(e->context, -1, t)) {
        e->component = -1;
        return ENGINE_BACK_FAILED;
    }
    return ENGINE_AT_END;
}

/* ------------------------------------------------------------------ instants */

typedef double EngineValue;
#define ENGINE_ALL(x) (x)
#include "instants.h"

int engine_run(Engine *e, int64_t end) {
    e->environment = environment_bits();
    return run_instants(e, end);
}

double engine_time(const Engine *e, int64_t tick) { return time_of(e, tick); }
void engine_look_up(Engine *e, int64_t tick) { look_up_due(e, tick); }
void engine_publish(Engine *e) { publish(e); }
int engine_arrive(Engine *e, double t) { return arrive(e, t); }
int engine_sample(Engine *e, double t) { return sample(e, t); }
int engine_advance(Engine *e, double t) { return advance(e, t); }

/* ------------------------------------------------------------------ initialization */

void engine_publish_outputs(Engine *e, const EngineComponent *m) {
    for (int32_t c = m->n_copies_before; c < m->n_copies; c++) copy(e->values, &m->copies[c]);
}

int engine_exchange(Engine *e, const EngineComponent *m, double t) {
    gather(e->values, m, t);
    int result = m->fmi ? engine_set(e, m) : run_back(e, m, NAN);
    if (m->fmi && !result) result = engine_get(e, m);
    engine_put_back_environment(e, m);
    if (result) e->component = (int32_t)(m - e->components);
    return result;
}

static bool is_in_loop(const Engine *e, int32_t first, int32_t end, int32_t component) {
    for (int32_t i = first; i < end; i++)
        for (int32_t k = 0; k < e->loops[i].n_components; k++)
            if (e->loops[i].components[k] == component) return true;
    return false;
}

/* The first guess of a loop, of unknowns whose components settle. */
static void begin_loop(Engine *e, const EngineLoop *l, const bool *settles) {
    for (int32_t i = 0; i < l->n_components; i++) {
        const EngineComponent *m = &e->components[l->components[i]];
        for (int32_t k = 0; k < l->n && (!settles || settles[l->components[i]]); k++)
            if (l->computed[k] >= m->first && l->computed[k] - m->first < m->n_outputs)
                e->values[l->published[k]] = e->values[l->computed[k]] = l->start[k];
    }
}

/* With loops from number `first` to before `end`. Values that have grown beyond all numbers, and not at once, do not
 * settle there. */
static int settle(Engine *e, const bool *settles, double *before, size_t n_values, int32_t first, int32_t end) {
    e->environment = environment_bits();
    for (int32_t i = first; i < end; i++) begin_loop(e, &e->loops[i], settles);
    bool grown = false;
    for (int32_t round = 0; round < 20 + e->n_components; round++) {
        memcpy(before, e->values, n_values * sizeof(double));
        for (int32_t i = 0; i < e->n_components; i++) {
            if ((settles && !settles[i]) || is_in_loop(e, first, end, i)) continue;
            const int result = engine_exchange(e, &e->components[i], 0.0);
            if (result) return result;
            engine_publish(e);
        }
        for (int32_t i = first; i < end; i++) {
            const int result = engine_solve(e, i);
            if (result) return result;
            engine_publish(e);
        }
        bool moved = false;
        for (size_t k = 0; k < n_values; k++) {
            const double was = before[k], size = fabs(was) > 1.0 ? fabs(was) : 1.0;
            before[k] = fabs(e->values[k] - was) > 1e-12 * size;
            if (before[k] != 0.0) moved = true;
            if (isinf(e->values[k]) && size > 1e150 && !isinf(was)) grown = true;
        }
        if (!moved && !grown) return ENGINE_AT_END;
        if (!moved) break;
    }
    for (size_t k = 0; grown && k < n_values; k++) before[k] = isinf(e->values[k]);
    return ENGINE_UNSETTLED;
}

int engine_settle_late(Engine *e, const bool *settles, double *before, size_t n_values) {
    const int32_t first = e->n_loops + e->n_initial;
    const int result = settle(e, settles, before, n_values, first, first + e->n_late);
    if (result != ENGINE_NO_SOLUTION) return result;
    const EngineLoop *l = &e->loops[e->component];
    memset(before, 0, n_values * sizeof(double));
    for (int32_t k = 0; k < l->n; k++) before[l->published[k]] = 1.0;
    return ENGINE_UNSETTLED;
}

int engine_settle(Engine *e, const bool *settles, double *before, size_t n_values) {
    const int result = settle(e, settles, before, n_values, 0, e->n_loops + e->n_initial);
    return result == ENGINE_UNSETTLED && e->n_late ? engine_settle_late(e, settles, before, n_values) : result;
}
