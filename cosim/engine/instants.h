/* The rule of exchange (exchange.py), over numbers of one run, or of copies side by side (batch.c). Who includes it
 * defines before: EngineValue and ENGINE_ALL, a number for all copies; and
 *     begun(e, tick)                whether an instant can begin: a result, AT_END if it can;
 *     run_component(e, m, t)        one communication step of a component,
 *     check_outputs_finite(e, first, end), check_computed_finite(e),
 *     solve_due(e, after_discrete)  algebraic loops,
 *     sampled(e, t)                 what is done where discrete components have had their steps.
 *
 * An instant is one function without calls but those of the components. What calls save on the stack are stores, and a
 * processor whose store buffer is full waits, instead of computing one component while it finishes another: a
 * third of the time of a chain of small FMUs. */

INLINE double time_of(const Engine *e, int64_t tick) {
    return (double)(tick * e->a + e->b) /
           (double)e->d; /* both exact below 2^53, so the quotient is the nearest double */
}

/* A few values are copied by scalar stores: what was stored as doubles a moment ago and is loaded in larger pieces has
 * to wait until it has left the processor's store buffer. */
INLINE void copy(EngineValue *values, const EngineCopy *c) {
    if (c->n > 32) memcpy(values + c->to, values + c->from, c->n * sizeof(EngineValue)); /* the two never overlap */
    else
        for (uint32_t i = 0; i < c->n; i++) values[c->to + i] = values[c->from + i];
}

INLINE int arrive(Engine *e, double t) {
    EngineValue *values = (EngineValue *)e->values;
    if (e->saves_previous)
        for (int32_t k = 0; k < e->n_due; k++) { /* what was visible until now */
            const EngineComponent *m = e->list[k];
            if (m->timestamp_slot >= 0) values[m->timestamp_slot] = ENGINE_ALL(t);
            for (int32_t c = 0; c < m->n_copies_before; c++) copy(values, &m->copies[c]);
        }
    for (int32_t k = 0; k < e->n_published; k++) copy(values, &e->published[k]);
    return RARELY(e->n_loops) ? solve_due(e, false) : ENGINE_AT_END;
}

/* The step of component number `k` in the list has failed: continue behind it, if at all. */
COLD int failed_at(Engine *e, int32_t k, int result) {
    e->n_stepped = k + 1;
    return result;
}

INLINE int sample(Engine *e, double t) {
    if (RARELY(e->n_stepped)) {
        const int result = check_outputs_finite(e, e->n_stepped - 1, e->n_stepped);
        if (result) return result;
    }
    for (int32_t k = e->n_stepped; k < e->n_due_discrete; k++) {
        int result = run_component(e, e->list[k], t);
        if (!result) result = check_outputs_finite(e, k, k + 1);
        if (RARELY(result)) return failed_at(e, k, result);
    }
    if (RARELY(e->n_loops) && e->n_due_discrete) {
        const int result = solve_due(e, true);
        if (result) return failed_at(e, e->n_due_discrete - 1, result);
    }
    return sampled(e, t);
}

INLINE int advance(Engine *e, double t) {
    const int32_t n = e->n_due;
    int32_t first = e->n_due_discrete;
    const int32_t from = RARELY(e->n_stepped > first) ? e->n_stepped : first;
    if (e->sequential) {
        for (int32_t k = from; k < n; k++) {
            int result = ENGINE_AT_END;
            if (e->list[k]->check_before) {
                result = check_outputs_finite(e, first, k);
                first = k;
            }
            if (!result) result = run_component(e, e->list[k], t);
            if (RARELY(result)) return failed_at(e, k, result);
        }
        return check_outputs_finite(e, first, n);
    }
    for (int32_t k = from; k < n; k++) {
        const int result = run_component(e, e->list[k], t);
        if (RARELY(result)) return failed_at(e, k, result);
    }
    return check_computed_finite(e);
}

/* Of all components: what was computed is published, and what is published becomes the previous value. */
static void publish(Engine *e) {
    for (int pass = 0; pass < 2; pass++)
        for (int32_t i = 0; i < e->n_components; i++) {
            const EngineComponent *m = &e->components[i];
            const int32_t end = pass ? m->n_copies_before : m->n_copies;
            for (int32_t c = pass ? 0 : m->n_copies_before; c < end; c++) copy((EngineValue *)e->values, &m->copies[c]);
        }
}

/* What a continuous component shows at its arrival, and where its outputs are, behind what others have. */
static void append(Engine *e, const EngineComponent *m) {
    for (int32_t c = m->n_copies_before; c < m->n_copies; c++) {
        const EngineCopy added = m->copies[c];
        EngineCopy *last = e->published + e->n_published - 1;
        if (e->n_published && last->to + last->n == added.to && last->from + last->n == added.from) last->n += added.n;
        else e->published[e->n_published++] = added;
    }
    EnginePiece *last = e->computed + e->n_computed - 1;
    if (e->n_computed && last->from + last->n == m->first) last->n += m->n_outputs;
    else e->computed[e->n_computed++] = (EnginePiece){m->first, m->n_outputs};
}

/* List the components that are due, and what that means. */
static void list_due(Engine *e) {
    e->n_due = e->n_due_discrete = e->n_published = e->n_computed = 0;
    e->saves_previous = e->sequential = false;
    for (int32_t i = 0; i < e->n_components; i++) {
        const EngineComponent *m = &e->components[i];
        if (!e->due[m->clock]) continue;
        e->list[e->n_due++] = m;
        if (m->timestamp_slot >= 0 || m->n_copies_before) e->saves_previous = true;
        if (i < e->n_discrete) {
            e->n_due_discrete++;
            continue;
        }
        if (m->check_before) e->sequential = true;
        append(e, m);
    }
}

/* Find what is due at `tick`, and when everything is due next. */
static void look_up_due(Engine *e, int64_t tick) {
    for (int32_t i = 0; i < e->n_clocks; i++) {
        const EngineClock *c = &e->clocks[i];
        const int64_t since = tick - c->offset;
        e->next[i] = since <= 0 ? c->offset : c->offset + (since + c->period - 1) / c->period * c->period;
        e->due[i] = e->next[i] == tick;
    }
    e->n_stepped = 0;
    list_due(e);
}

/* Begin the instant at a tick; returns the tick of the one after it. */
INLINE int64_t begin_instant(Engine *e, int64_t tick) {
    bool changed = false;
    int64_t after = INT64_MAX;
    for (int32_t i = 0; i < e->n_clocks; i++) {
        int64_t next = e->next[i];
        const bool due = next == tick;
        if (due) e->next[i] = next += e->clocks[i].period;
        if (next < after) after = next;
        changed |= due != e->due[i];
        e->due[i] = due;
    }
    e->n_stepped = 0;
    if (changed) list_due(e);
    return after;
}

/* See engine_run. */
INLINE int run_instants(Engine *e, int64_t end) {
    look_up_due(e, e->tick);
    int64_t tick = INT64_MAX;
    for (int32_t i = 0; i < e->n_clocks; i++)
        if (e->next[i] < tick) tick = e->next[i];
    while (tick < end) {
        const int64_t after = begin_instant(e, tick);
        int result = begun(e, tick);
        if (!result) {
            const double t = time_of(e, tick);
            result = arrive(e, t);
            if (!result) result = sample(e, t);
            if (!result) result = advance(e, t);
        }
        if (result) {
            e->tick = tick;
            return result;
        }
        tick = after;
    }
    e->tick = end;
    return ENGINE_AT_END;
}
