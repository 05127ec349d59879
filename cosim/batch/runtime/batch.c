/* Executes a plan for many copies, LANES of them at once, by the rule in instants.h.
 *
 * A group of copies is taken from the first instant to the last by one thread; groups share nothing, so the numbers do
 * not depend on the number of threads. Nothing is allocated. */
#include "batch.h"
#include "environment.h"
#include "hints.h"
#include "table.h"

typedef struct {
    Batch *b;
    int64_t group;
    lanes *values;
    unsigned alive; /* one bit for each copy */
    int64_t tick;   /* of the instant, where a copy ends */
} Group;

#ifdef TANGENTS
enum { PER_COPY = 1 + TANGENTS }; /* numbers that are recorded: the value and its derivatives */
#elif defined(ADJOINTS)
enum { PER_COPY = 2 }; /* the value and its index on the tape */
#else
enum { PER_COPY = 1 };
#endif

INLINE int64_t copy_of(const Group *g, int lane) { return g->group * LANES + lane; }

/* The copies in `failed` end here. */
static void end_copies(
    Group *g, unsigned failed, int32_t component, int32_t result, int32_t call, uint32_t status) {
    for (int i = 0; i < LANES; i++)
        if (failed >> i & 1u) {
            g->b->failures[copy_of(g, i)] = (BatchFailure){g->tick, component, result, call, status};
            g->b->alive[copy_of(g, i)] = 0;
        }
    g->alive &= ~failed;
}

/* An input that is no real number, as the FMI call takes it. */
static lanes as_type(lanes u, int type) {
    lanes r = lanes_all(0.0);
    for (int i = 0; i < LANES; i++) {
        if (type == 2) r[i] = u[i] != 0.0;
        else r[i] = fabs(u[i]) < 2147483648.0 ? (double)(int32_t)u[i] : NAN;
    }
    return r;
}

static void run_lanes(Group *g, const EngineComponent *of, int32_t number, BatchStep run, double t) {
    const BatchComponent *m = &g->b->components[number];
    lanes *const memory = (lanes *)(m->memory + m->stride * (size_t)g->group);
    const lanes *values = g->values;
    for (size_t i = 0; i < m->n_inputs; i++) memory[m->to[i]] = values[m->index[i]];
    for (size_t i = 0; i < of->n_extrapolations; i++) {
        const EngineExtrapolation *l = &of->extrapolations[i];
        memory[m->to[l->input]] +=
            (values[l->now] - values[l->before]) * ((t + l->shift - values[l->sample_time]) / l->period);
    }
    if (of->scale)
        for (size_t i = 0; i < m->n_inputs; i++) memory[m->to[i]] = memory[m->to[i]] * of->scale[i] + of->offset[i];
#if defined(TANGENTS) || defined(ADJOINTS)
    for (size_t i = 0; i < m->n_inputs && !m->followed; i++) memory[m->to[i]] = lanes_all(memory[m->to[i]].v);
#endif
    unsigned refused = 0;
    if (m->checked)
        for (size_t i = 0; i < m->n_inputs; i++) {
            lanes *const u = &memory[m->to[i]];
            if (m->to_type[i]) *u = as_type(*u, m->to_type[i]);
            const lanes_values value = lanes_value(*u);
            const unsigned now =
                lanes_bits(~((mask)(value >= m->least[i]) & (mask)(value <= m->most[i]))) & g->alive & ~refused;
            if (now) end_copies(g, now, number, BATCH_INPUT_REFUSED, (int32_t)i, 0);
            refused |= now;
        }
    const unsigned failed = run(memory, t, of->step, g->alive);
    if (failed) end_copies(g, failed, number, BATCH_LANE_FAILED, 0, 0);
    lanes *const y = g->values + of->first;
    for (uint32_t i = 0; i < of->n_outputs; i++) {
        y[i] = memory[m->from[i]];
        if (m->from_type[i]) y[i] = as_type(y[i], m->from_type[i]);
    }
}

INLINE const Table *table_of(const Group *g, int32_t number) {
    return (const Table *)g->b->components[number].alone[g->group]->components[number].instance;
}

#ifdef HAS_SIDES
/* Derivatives of the outputs of a table by its samples. */
static void follow_samples(Group *g, const EngineComponent *of, int32_t number) {
    const Table *const s = table_of(g, number);
    lanes *const samples = (lanes *)g->b->components[number].samples;
    lanes *const row = samples + ((size_t)g->group * s->rows + s->row) * s->width;
    for (size_t i = 0; i < s->n; i++) {
        lanes *const y = &g->values[of->first + s->places[i]];
        lanes *const x = &row[s->columns[i]];
        const int between = i < s->n_linear && s->weight > 0.0;
        note_moves(x, 1);
        if (between) note_moves(&x[s->width], 1);
        if (between) *y = chain(y->v, 1.0 - s->weight, x[0], s->weight, x[s->width]);
        else *y = moved(y->v, x[0]);
    }
}
#endif

#ifdef TANGENTS
/* Derivatives of its outputs: differences of two others, which go through the run on either side of it. Their states
 * are those that the neighboring inputs lead to, so that nothing has to be known of them. */
static void run_probes(Group *g, const EngineComponent *of, int32_t number, double t) {
    const BatchComponent *m = &g->b->components[number];
    for (int k = 0; k < TANGENTS && g->alive; k++) {
        const size_t at = (size_t)g->group * TANGENTS + (size_t)k;
        const double apart = g->b->apart[at];
        if (apart == 0.0) continue;
        Engine **const both = &m->probes[2 * at];
        for (int side = 0; side < 2; side++) {
            for (size_t i = 0; i < m->n_reads; i++) {
                const Tangent *x = &g->values[m->reads[i]];
                both[side]->values[m->reads[i]] = x->v + (side ? -apart : apart) * slope_of(*x, k);
            }
            both[side]->environment = environment_bits();
            const int result = engine_component(both[side], number, t);
            if (result) {
                end_copies(g, 1u, number, BATCH_PROBE_FAILED, k, 0);
                return;
            }
        }
        for (uint32_t i = 0; i < of->n_outputs; i++)
            ((double *)g->values[of->first + i].d)[k] =
                (both[0]->values[of->first + i] - both[1]->values[of->first + i]) / (2.0 * apart);
    }
    note_moves(&g->values[of->first], of->n_outputs);
}
#endif

static void run_alone(Group *g, const EngineComponent *of, int32_t number, double t) {
    const BatchComponent *m = &g->b->components[number];
    for (int i = 0; i < LANES; i++) {
        if (!(g->alive >> i & 1u)) continue;
        Engine *const e = m->alone[copy_of(g, i)];
        for (size_t k = 0; k < m->n_reads; k++) e->values[m->reads[k]] = ((const double *)&g->values[m->reads[k]])[i];
        e->environment = environment_bits();
        int result = engine_component(e, number, t);
        for (uint32_t k = 0; k < of->n_outputs; k++) {
            const double y = e->values[of->first + k];
            ((double *)&g->values[of->first + k])[i] = y;
            if (!result && !(fabs(y) <= DBL_MAX)) result = ENGINE_NOT_FINITE;
        }
        if (result) end_copies(g, 1u << i, number, result, e->call, e->status);
    }
#ifdef HAS_SIDES
    if (m->samples) follow_samples(g, of, number);
#endif
#ifdef TANGENTS
    if (m->probes) run_probes(g, of, number, t);
#endif
}

/* Which sides each component has taken so far. */
static void record_sides(const Group *g, size_t at) {
    const Batch *b = g->b;
    for (size_t i = 0; b->sides && i < b->n_components; i++) {
        const BatchComponent *m = &b->components[i];
        if (!m->sides) continue;
        const void *const sides = m->memory + m->stride * (size_t)g->group + m->sides;
        b->sides[at * b->n_components + i] = ((const Sides *)sides)->all;
    }
}

static void record(const Group *g, const Engine *e) {
    const Batch *b = g->b;
    const EngineClock *c = &e->clocks[e->n_clocks - 1];
    const int64_t row = (g->tick - c->offset) / c->period - b->first_row;
    if (!b->n_recorded || row < 0 || row >= b->n_rows) return;
    for (int i = 0; i < LANES; i++) {
        const int64_t copy = copy_of(g, i);
        if (copy >= b->n_copies_of_system) break;
        const size_t at = (size_t)copy * (size_t)b->n_rows + (size_t)row;
        double *const to = b->rows + at * b->n_recorded * PER_COPY;
        const int there = g->alive >> i & 1u;
        for (size_t k = 0; k < b->n_recorded; k++) {
            const double *const values = (const double *)&g->values[b->recorded[k]] + i, scale = b->record_scale[k];
            double *const of = to + k * PER_COPY;
            of[0] = !there ? NAN : b->record_converted[k] ? values[0] * scale + b->record_offset[k] : values[0];
#ifdef ADJOINTS
            of[1] = (double)g->values[b->recorded[k]].index;
#elif defined(TANGENTS)
            for (int j = 0; j < TANGENTS; j++) of[1 + j] = there ? slope_of(g->values[b->recorded[k]], j) * scale : NAN;
#endif
        }
        record_sides(g, at);
    }
}

/* A copy that satisfies a stop condition ends. */
static void check_stops(Group *g, const Engine *e) {
    for (int32_t k = 0; k < e->n_stops; k++) {
        const EngineStop *s = &e->stops[k];
        const lanes_values value = s->scale * lanes_value(g->values[s->slot]) + s->offset;
        const mask holds = s->relation == ENGINE_GE   ? (mask)(value >= s->value)
                           : s->relation == ENGINE_GT ? (mask)(value > s->value)
                           : s->relation == ENGINE_LE ? (mask)(value <= s->value)
                                                      : (mask)(value < s->value);
        const unsigned now = lanes_bits(holds) & g->alive;
        if (now) end_copies(g, now, -1, BATCH_STOPPED, k, 0);
    }
}

/* ------------------------------------------------------------------ instants */

INLINE int run_component(Engine *e, const EngineComponent *m, double t) {
    Group *const g = (Group *)e->context;
    const int32_t number = (int32_t)(m - e->components);
    const BatchStep run = g->b->components[number].run;
#ifdef ADJOINTS /* the engine has run all of them before */
    if (!g->b->components[number].followed) return 0;
#endif
    if (run) run_lanes(g, m, number, run, t);
    else run_alone(g, m, number, t);
    return 0;
}

/* A copy that fails ends by itself, and systems with loops have no copies. */
INLINE int check_outputs_finite(Engine *e, int32_t first, int32_t end) { return (void)e, (void)first, (void)end, 0; }
INLINE int check_computed_finite(Engine *e) { return (void)e, 0; }
INLINE int solve_due(Engine *e, bool after_discrete) { return (void)e, (void)after_discrete, 0; }

INLINE int sampled(Engine *e, double t) {
    Group *const g = (Group *)e->context;
    (void)t;
    if (e->due[e->n_clocks - 1]) record(g, e);
    check_stops(g, e);
    return 0;
}

INLINE int begun(Engine *e, int64_t tick) {
    Group *const g = (Group *)e->context;
    g->tick = tick;
    return g->alive ? ENGINE_AT_END : ENGINE_STOPPED;
}

typedef lanes EngineValue;
#define ENGINE_ALL(x) lanes_all(x)
#include "instants.h"

/* One group from `tick`, whose values have arrived, to the arrival at `end`; `final`: to the sample there. */
static void run_group(Group *g, Engine *e, int64_t tick, int64_t end, bool final) {
    look_up_due(e, g->tick = tick);
    sample(e, time_of(e, tick));
    advance(e, time_of(e, tick));
    e->tick = tick + 1;
    run_instants(e, end);
    look_up_due(e, g->tick = end);
    arrive(e, time_of(e, end));
    if (final) sample(e, time_of(e, end));
    else if (e->due[e->n_clocks - 1]) record(g, e);
}

/* Pass outputs to inputs until nothing changes except for rounding, as engine_settle. A copy that settles before others
 * of its group, but would still change by rounding, ends as unsettled: it can be initialized alone. */
static void settle(Group *g, Engine *e, lanes *before) {
    const Batch *b = g->b;
    for (int32_t round = 0; round < 20 + e->n_components && g->alive; round++) {
        memcpy(before, g->values, b->n_values * sizeof(lanes));
        for (int32_t i = 0; i < e->n_components; i++) {
            const BatchComponent *const m = &b->components[i];
            if (m->begin) run_lanes(g, &e->components[i], i, m->begin, 0.0);
            else if (m->samples) run_alone(g, &e->components[i], i, *table_of(g, i)->now);
            publish(e);
        }
        mask moved = {0}, changed = {0};
        for (size_t k = 0; k < b->n_values; k++) {
            moved |= lanes_moved(before[k], g->values[k]);
            changed |= lanes_changed(before[k], g->values[k]);
        }
        const unsigned moving = lanes_bits(moved) & g->alive, rounding = lanes_bits(changed) & ~moving & g->alive;
#ifdef ADJOINTS
        if (!moving && round < 10 + e->n_components) continue; /* all that was not moved may yet depend on more */
#endif
        if (!moving) return;
        if (rounding) end_copies(g, rounding, -1, BATCH_UNSETTLED, 0, 0);
    }
    end_copies(g, g->alive, -1, BATCH_UNSETTLED, 0, 0);
}

static Group group_at(Batch *b, BatchWorker *w, int64_t number) {
    Group g = {.b = b, .group = number, .values = (lanes *)b->values + (size_t)number * b->n_values};
    for (int i = 0; i < LANES; i++) g.alive |= (unsigned)b->alive[number * LANES + i] << i;
    w->engine.values = (double *)g.values;
    return g;
}

/* Take groups that nobody has taken, until there are none. */
EXPORT void cosim_batch_run(Batch *b, BatchWorker *w, int64_t tick, int64_t end, bool final) {
    for (;;) {
        const int64_t number = __atomic_fetch_add(&b->next_group, 1, __ATOMIC_RELAXED);
        if (number >= b->n_groups) return;
        Group g = group_at(b, w, number);
        w->engine.context = &g;
        if (g.alive) run_group(&g, &w->engine, tick, end, final);
    }
}

/* Initialize all groups whose components are all in lanes. */
EXPORT void cosim_batch_settle(Batch *b, BatchWorker *w) {
    for (int64_t number = 0; number < b->n_groups; number++) {
        Group g = group_at(b, w, number);
        w->engine.context = &g;
#ifdef HAS_SIDES
        note_moves(g.values, b->n_values);
#endif
        settle(&g, &w->engine, (lanes *)w->before);
    }
}

#if LANES_TARGET && defined(__clang__)
#pragma clang attribute pop
#endif
