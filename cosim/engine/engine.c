/* Executes a plan: see engine.h. */
#include "engine.h"

#include <string.h>

#if defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract(off)
#elif defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off")
#endif

enum { LARGEST_SUCCESS = 1 }; /* OK and Warning */

double engine_time(const Engine *e, int64_t tick) {
    return (double)(tick * e->a + e->b) / (double)e->d; /* both exact below 2^53, so the quotient is the nearest double */
}

/* ------------------------------------------------------------------ values */

void engine_gather(const Engine *e, const EngineMember *m, double t) {
    const double *values = e->values;
    double *u = m->u;
    for (size_t i = 0; i < m->n_inputs; i++) u[i] = values[m->index[i]];
    for (size_t i = 0; i < m->n_lines; i++) {
        const EngineLine *l = &m->lines[i];
        u[l->input] += (values[l->now] - values[l->before]) * ((t + l->shift - values[l->reached]) / l->period);
    }
    if (m->scale) {
        for (size_t i = 0; i < m->n_inputs; i++) u[i] *= m->scale[i];
        for (size_t i = 0; i < m->n_inputs; i++) u[i] += m->offset[i];
    }
}

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

static int failed(Engine *e, int32_t call, uint32_t status) {
    e->call = call;
    e->status = status;
    return 1;
}

static uint32_t move(const EngineMember *m, const EngineTransfer *s) {
    return m->fmi == 3 ? s->call3(m->instance, s->references, s->n_references, s->data, s->n_data)
                       : s->call2(m->instance, s->references, s->n_references, s->data);
}

int engine_set(Engine *e, const EngineMember *m) {
    for (int32_t k = 0; k < m->n_sets; k++) {
        const EngineTransfer *s = &m->sets[k];
        if (s->element) scatter(s, m->u);
        const uint32_t status = move(m, s);
        if (status > LARGEST_SUCCESS) return failed(e, k + 1, status);
    }
    return 0;
}

int engine_get(Engine *e, const EngineMember *m) {
    for (int32_t k = 0; k < m->n_gets; k++) {
        const EngineTransfer *s = &m->gets[k];
        const uint32_t status = move(m, s);
        if (status > LARGEST_SUCCESS) return failed(e, -k - 1, status);
        if (s->element) collect(s, m->y);
    }
    return 0;
}

/* ------------------------------------------------------------------ steps */

static int do_step(Engine *e, const EngineMember *m, double t) {
    if (m->fmi == 3) {
        bool *flags = m->flags;
        const uint32_t status =
            m->step3(m->instance, t, m->step, m->no_set_prior != 0, flags, flags + 2, flags + 3, m->last);
        return status > LARGEST_SUCCESS || flags[2] || flags[3] ? failed(e, 0, status) : 0;
    }
    const uint32_t status = m->step2(m->instance, t, m->step, m->no_set_prior);
    return status > LARGEST_SUCCESS ? failed(e, 0, status) : 0;
}

/* One communication step of member i: inputs as they stand, doStep, outputs. */
static int run_member(Engine *e, int32_t i, double t) {
    const EngineMember *m = &e->members[i];
    e->member = i;
    if (m->n_inputs) engine_gather(e, m, t);
    if (!m->fmi) return e->back(e->context, i, t) ? ENGINE_BACK_FAILED : ENGINE_AT_END;
    return engine_set(e, m) || do_step(e, m, t) || engine_get(e, m) ? ENGINE_CALL_FAILED : ENGINE_AT_END;
}

static bool all_finite(const double *y, size_t n) {
    const uint64_t exponent = UINT64_C(0x7ff) << 52;
    uint64_t found = 0;
    for (size_t i = 0; i < n; i++) {
        uint64_t bits;
        memcpy(&bits, &y[i], sizeof bits);
        found |= (bits & exponent) == exponent;
    }
    return !found;
}

/* Whether the outputs of the members from `first` to before `end` that are due are finite. */
static int look_at(Engine *e, int32_t first, int32_t end) {
    if (!e->look) return ENGINE_AT_END;
    for (int32_t i = first; i < end; i++) {
        const EngineMember *m = &e->members[i];
        if (e->due[m->clock] && !all_finite(m->y, m->n_outputs)) {
            e->member = i;
            return ENGINE_NOT_FINITE;
        }
    }
    return ENGINE_AT_END;
}

static void copy(double *values, const EngineCopy *c) {
    if (c->n == 1) values[c->to] = values[c->from];
    else memcpy(values + c->to, values + c->from, c->n * sizeof(double)); /* the pieces never overlap */
}

void engine_arrive(Engine *e, double t) {
    double *values = e->values;
    for (int32_t i = 0; i < e->n_members; i++) { /* what is remembered was visible until now */
        const EngineMember *m = &e->members[i];
        if (!e->due[m->clock]) continue;
        if (m->stamp >= 0) values[m->stamp] = t;
        for (int32_t k = 0; k < m->n_copies_before; k++) copy(values, &m->copies[k]);
    }
    for (int32_t i = e->n_discrete; i < e->n_members; i++) {
        const EngineMember *m = &e->members[i];
        if (!e->due[m->clock]) continue;
        for (size_t k = (size_t)m->n_copies_before; k < m->n_copies; k++) copy(values, &m->copies[k]);
    }
}

static bool holds(const EngineStop *s, const double *values) {
    const double value = s->scale * values[s->slot] + s->offset;
    switch (s->relation) {
        case ENGINE_GE: return value >= s->value;
        case ENGINE_GT: return value > s->value;
        case ENGINE_LE: return value <= s->value;
        default: return value < s->value;
    }
}

int engine_sample(Engine *e, double t) {
    for (int32_t i = 0; i < e->n_discrete; i++) {
        if (!e->due[e->members[i].clock]) continue;
        int result = run_member(e, i, t);
        if (!result) result = look_at(e, i, i + 1);
        if (result) return result;
    }
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
    return ENGINE_AT_END;
}

int engine_advance(Engine *e, double t) {
    int32_t first = e->n_discrete;
    for (int32_t i = first; i < e->n_members; i++) {
        const EngineMember *m = &e->members[i];
        if (!e->due[m->clock]) continue;
        int result = ENGINE_AT_END;
        if (m->look_before) {
            result = look_at(e, first, i);
            first = i;
        }
        if (!result) result = run_member(e, i, t);
        if (result) return result;
    }
    return look_at(e, first, e->n_members);
}

void engine_look_up(Engine *e, int64_t tick) {
    for (int32_t i = 0; i < e->n_clocks; i++) {
        const EngineClock *c = &e->clocks[i];
        const int64_t since = tick - c->offset;
        e->next[i] = since <= 0 ? c->offset : c->offset + (since + c->period - 1) / c->period * c->period;
        e->due[i] = e->next[i] == tick;
    }
}

int engine_run(Engine *e, int64_t end) {
    engine_look_up(e, e->tick);
    for (;;) {
        int64_t tick = INT64_MAX;
        for (int32_t i = 0; i < e->n_clocks; i++)
            if (e->next[i] < tick) tick = e->next[i];
        if (tick >= end) {
            e->tick = end;
            return ENGINE_AT_END;
        }
        e->tick = tick;
        for (int32_t i = 0; i < e->n_clocks; i++) {
            e->due[i] = e->next[i] == tick;
            if (e->due[i]) e->next[i] += e->clocks[i].period;
        }
        if (e->due[e->n_clocks - 1] && e->count == e->room) return ENGINE_FULL;
        const double t = engine_time(e, tick);
        engine_arrive(e, t);
        int result = engine_sample(e, t);
        if (!result) result = engine_advance(e, t);
        if (result) return result;
    }
}
