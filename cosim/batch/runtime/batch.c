/* Executes a plan for many copies, in the order of engine.c, of which this is the same rule for LANES copies at once.
 *
 * A group of copies is taken from the first instant to the last by one thread; groups share nothing, so the numbers do
 * not depend on the number of threads. Nothing is allocated. */
#include "lanes.h"

#include "batch.h"
#include "environment.h"

typedef struct {
    Batch *b;
    BatchWorker *w;
    int64_t group;
    lanes *values;
    unsigned alive; /* one bit for each copy */
    int32_t n_due, n_due_discrete;
} Group;

INLINE int64_t copy_of(const Group *g, int lane) { return g->group * LANES + lane; }

/* The copies in `failed` end here. */
static void end_copies(
    Group *g, unsigned failed, int32_t component, int64_t tick, int32_t result, int32_t call, uint32_t status) {
    for (int i = 0; i < LANES; i++)
        if (failed >> i & 1u) {
            g->b->failures[copy_of(g, i)] = (BatchFailure){tick, component, result, call, status};
            g->b->alive[copy_of(g, i)] = 0;
        }
    g->alive &= ~failed;
}

INLINE double time_of(const Batch *b, int64_t tick) { return (double)(tick * b->a + b->b) / (double)b->d; }

/* An input that is no real number, as the FMI call takes it. */
static lanes as_type(lanes u, int type) {
    for (int i = 0; i < LANES; i++) {
        if (type == 2) u[i] = u[i] != 0.0;
        else u[i] = fabs(u[i]) < 2147483648.0 ? (double)(int32_t)u[i] : NAN;
    }
    return u;
}

static void run_lanes(Group *g, int32_t number, BatchStep run, double t, int64_t tick) {
    const BatchComponent *m = &g->b->components[number];
    lanes *const memory = (lanes *)(m->memory + m->stride * (size_t)g->group);
    const lanes *values = g->values;
    for (size_t i = 0; i < m->n_inputs; i++) memory[m->to[i]] = values[m->index[i]];
    for (size_t i = 0; i < m->n_extrapolations; i++) {
        const EngineExtrapolation *l = &m->extrapolations[i];
        memory[m->to[l->input]] +=
            (values[l->now] - values[l->before]) * ((t + l->shift - values[l->sample_time]) / l->period);
    }
    if (m->scale)
        for (size_t i = 0; i < m->n_inputs; i++) memory[m->to[i]] = memory[m->to[i]] * m->scale[i] + m->offset[i];
    unsigned refused = 0;
    if (m->checked)
        for (size_t i = 0; i < m->n_inputs; i++) {
            lanes *const u = &memory[m->to[i]];
            if (m->to_type[i]) *u = as_type(*u, m->to_type[i]);
            const unsigned now =
                lanes_bits(~((mask)(*u >= m->least[i]) & (mask)(*u <= m->most[i]))) & g->alive & ~refused;
            if (now) end_copies(g, now, number, tick, BATCH_INPUT_REFUSED, (int32_t)i, 0);
            refused |= now;
        }
    const unsigned failed = run(memory, t, m->step, g->alive);
    if (failed) end_copies(g, failed, number, tick, BATCH_LANE_FAILED, 0, 0);
    lanes *const y = g->values + m->first;
    for (uint32_t i = 0; i < m->n_outputs; i++) {
        y[i] = memory[m->from[i]];
        if (m->from_type[i]) y[i] = as_type(y[i], m->from_type[i]);
    }
}

static void run_alone(Group *g, int32_t number, double t, int64_t tick) {
    const BatchComponent *m = &g->b->components[number];
    for (int i = 0; i < LANES; i++) {
        if (!(g->alive >> i & 1u)) continue;
        Engine *const e = m->alone[copy_of(g, i)];
        for (size_t k = 0; k < m->n_reads; k++) e->values[m->reads[k]] = ((const double *)&g->values[m->reads[k]])[i];
        e->environment = environment_bits();
        int result = engine_component(e, m->number, t);
        for (uint32_t k = 0; k < m->n_outputs; k++) {
            const double y = e->values[m->first + k];
            ((double *)&g->values[m->first + k])[i] = y;
            if (!result && !(fabs(y) <= DBL_MAX)) result = ENGINE_NOT_FINITE;
        }
        if (result) end_copies(g, 1u << i, number, tick, result, e->call, e->status);
    }
}

static void run_components(Group *g, int32_t first, int32_t end, double t, int64_t tick) {
    for (int32_t k = first; k < end; k++) {
        const int32_t number = g->w->list[k];
        const BatchStep run = g->b->components[number].run;
        if (run) run_lanes(g, number, run, t, tick);
        else run_alone(g, number, t, tick);
    }
}

static void arrive(Group *g, double t) {
    const Batch *b = g->b;
    lanes *const values = g->values;
    for (int32_t k = 0; k < g->n_due; k++) { /* what was visible until now */
        const BatchComponent *m = &b->components[g->w->list[k]];
        if (m->timestamp_slot >= 0) values[m->timestamp_slot] = lanes_all(t);
        for (int32_t c = 0; c < m->n_copies_before; c++)
            memcpy(values + m->copies[c].to, values + m->copies[c].from, m->copies[c].n * sizeof(lanes));
    }
    for (int32_t k = 0; k < g->n_due; k++) {
        const BatchComponent *m = &b->components[g->w->list[k]];
        for (int32_t c = m->n_copies_before; c < m->n_copies; c++)
            for (uint32_t i = 0; i < m->copies[c].n; i++) values[m->copies[c].to + i] = values[m->copies[c].from + i];
    }
}

static void record(const Group *g, int64_t tick) {
    const Batch *b = g->b;
    const EngineClock *c = &b->clocks[b->n_clocks - 1];
    const int64_t row = (tick - c->offset) / c->period - b->first_row;
    if (!b->n_recorded || row < 0 || row >= b->n_rows) return;
    for (int i = 0; i < LANES; i++) {
        const int64_t copy = copy_of(g, i);
        if (copy >= b->n_copies_of_system) break;
        double *const to = b->rows + ((size_t)copy * (size_t)b->n_rows + (size_t)row) * b->n_recorded;
        const int there = g->alive >> i & 1u;
        for (size_t k = 0; k < b->n_recorded; k++) {
            const double value = ((const double *)&g->values[b->recorded[k]])[i];
            to[k] = !there ? NAN : b->record_converted[k] ? value * b->record_scale[k] + b->record_offset[k] : value;
        }
    }
}

static void look_up_due(Group *g, int64_t tick) {
    const Batch *b = g->b;
    BatchWorker *w = g->w;
    for (int32_t i = 0; i < b->n_clocks; i++) {
        const EngineClock *c = &b->clocks[i];
        const int64_t since = tick - c->offset;
        w->next[i] = since <= 0 ? c->offset : c->offset + (since + c->period - 1) / c->period * c->period;
        w->due[i] = w->next[i] == tick;
    }
}

static void list_due(Group *g) {
    g->n_due = g->n_due_discrete = 0;
    for (int32_t i = 0; i < g->b->n_components; i++)
        if (g->w->due[g->b->components[i].clock]) {
            g->w->list[g->n_due++] = i;
            if (i < g->b->n_discrete) g->n_due_discrete = g->n_due;
        }
}

/* A copy that satisfies a stop condition ends. */
static void check_stops(Group *g, int64_t tick) {
    for (int32_t k = 0; k < g->b->n_stops; k++) {
        const EngineStop *s = &g->b->stops[k];
        const lanes value = s->scale * g->values[s->slot] + s->offset;
        const mask holds = s->relation == ENGINE_GE   ? (mask)(value >= s->value)
                           : s->relation == ENGINE_GT ? (mask)(value > s->value)
                           : s->relation == ENGINE_LE ? (mask)(value <= s->value)
                                                      : (mask)(value < s->value);
        const unsigned now = lanes_bits(holds) & g->alive;
        if (now) end_copies(g, now, -1, tick, BATCH_STOPPED, k, 0);
    }
}

/* Discrete components and the sample. */
static void sample(Group *g, double t, int64_t tick) {
    run_components(g, 0, g->n_due_discrete, t, tick);
    if (g->w->due[g->b->n_clocks - 1]) record(g, tick);
    check_stops(g, tick);
}

static void advance(Group *g, double t, int64_t tick) { run_components(g, g->n_due_discrete, g->n_due, t, tick); }

/* One group from `tick`, whose values have arrived, to the arrival at `end`; `final`: to the sample there. */
static void run_group(Group *g, int64_t tick, int64_t end, bool final) {
    const Batch *b = g->b;
    BatchWorker *w = g->w;
    look_up_due(g, tick);
    list_due(g);
    sample(g, time_of(b, tick), tick);
    advance(g, time_of(b, tick), tick);
    while (g->alive) {
        bool changed = false;
        int64_t after = INT64_MAX;
        for (int32_t i = 0; i < b->n_clocks; i++) {
            if (w->next[i] <= tick) w->next[i] += b->clocks[i].period;
            if (w->next[i] < after) after = w->next[i];
        }
        if (after >= end) break;
        tick = after;
        for (int32_t i = 0; i < b->n_clocks; i++) {
            const bool due = w->next[i] == tick;
            changed |= due != w->due[i];
            w->due[i] = due;
        }
        if (changed) list_due(g);
        const double t = time_of(b, tick);
        arrive(g, t);
        sample(g, t, tick);
        advance(g, t, tick);
    }
    look_up_due(g, end);
    list_due(g);
    arrive(g, time_of(b, end));
    if (final) sample(g, time_of(b, end), end);
    else if (w->due[b->n_clocks - 1]) record(g, end);
}

/* Computed outputs become visible, and visible ones previous ones, of all components. */
static void publish(Group *g) {
    for (int pass = 0; pass < 2; pass++)
        for (int32_t i = 0; i < g->b->n_components; i++) {
            const BatchComponent *m = &g->b->components[i];
            for (int32_t c = pass ? 0 : m->n_copies_before; c < (pass ? m->n_copies_before : m->n_copies); c++)
                memcpy(g->values + m->copies[c].to, g->values + m->copies[c].from, m->copies[c].n * sizeof(lanes));
        }
}

/* Pass outputs to inputs until nothing changes except for rounding, as engine_settle. A copy that settles before others
 * of its group, but would still change by rounding, ends as unsettled: it can be initialized alone. */
static void settle(Group *g, lanes *before) {
    const Batch *b = g->b;
    for (int32_t round = 0; round < 20 + b->n_components && g->alive; round++) {
        memcpy(before, g->values, b->n_values * sizeof(lanes));
        for (int32_t i = 0; i < b->n_components; i++) {
            run_lanes(g, i, b->components[i].begin, 0.0, 0);
            publish(g);
        }
        mask moved = {0}, changed = {0};
        for (size_t k = 0; k < b->n_values; k++) {
            const lanes was = before[k], now = g->values[k];
            const lanes size = lanes_more(lanes_fabs(was), lanes_all(1.0));
            moved |= (mask)(lanes_fabs(now - was) > 1e-12 * size);
            changed |= (mask)((mask)now != (mask)was);
        }
        const unsigned moving = lanes_bits(moved) & g->alive, rounding = lanes_bits(changed) & ~moving & g->alive;
        if (!moving) return;
        if (rounding) end_copies(g, rounding, -1, 0, BATCH_UNSETTLED, 0, 0);
    }
    end_copies(g, g->alive, -1, 0, BATCH_UNSETTLED, 0, 0);
}

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Take groups that nobody has taken, until there are none. */
EXPORT void cosim_batch_run(Batch *b, BatchWorker *w, int64_t tick, int64_t end, bool final) {
    for (;;) {
        const int64_t group = __atomic_fetch_add(&b->next_group, 1, __ATOMIC_RELAXED);
        if (group >= b->n_groups) return;
        Group g = {.b = b, .w = w, .group = group, .values = (lanes *)b->values + (size_t)group * b->n_values};
        for (int i = 0; i < LANES; i++) g.alive |= (unsigned)b->alive[group * LANES + i] << i;
        if (g.alive) run_group(&g, tick, end, final);
    }
}

/* Initialize all groups whose components are all in lanes. */
EXPORT void cosim_batch_settle(Batch *b, BatchWorker *w) {
    for (int64_t group = 0; group < b->n_groups; group++) {
        Group g = {.b = b, .w = w, .group = group, .values = (lanes *)b->values + (size_t)group * b->n_values};
        for (int i = 0; i < LANES; i++) g.alive |= (unsigned)b->alive[group * LANES + i] << i;
        settle(&g, (lanes *)w->before);
    }
}

#if LANES_TARGET && defined(__clang__)
#pragma clang attribute pop
#endif
