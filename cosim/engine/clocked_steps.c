/* Steps of FMUs with clocks: see clocked_steps.h. */
#include "clocked_steps.h"

#include "environment.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL };        /* statuses of FMI */
enum { NOT_YET_KNOWN, UNCHANGED, CHANGED };         /* fmi3IntervalQualifier */
enum { ITERATIONS = 1000 };                         /* of an event, and ticks at one instant */
#define EXACT 9007199254740992.0                    /* 2^53: integers below it are doubles */

typedef uint32_t (*GetClock)(void *, const uint32_t *, size_t, bool *);
typedef uint32_t (*SetClock)(void *, const uint32_t *, size_t, const bool *);
typedef uint32_t (*Update)(void *, bool *, bool *, bool *, bool *, bool *, double *);
typedef uint32_t (*Decimal)(void *, const uint32_t *, size_t, double *, int *);
typedef uint32_t (*Fraction)(void *, const uint32_t *, size_t, uint64_t *, uint64_t *, int *);
typedef uint32_t (*ShiftDecimal)(void *, const uint32_t *, size_t, double *);
typedef uint32_t (*ShiftFraction)(void *, const uint32_t *, size_t, uint64_t *, uint64_t *);

#define TRY(expression)                       \
    do {                                      \
        const uint32_t tried_ = (expression); \
        if (tried_) return tried_;            \
    } while (0)
#define CALL(f, number, type, ...) seen(f, number, ((type)(f)->call[number])((f)->values.instance, __VA_ARGS__))
#define PLAIN(f, number) seen(f, number, ((uint32_t(*)(void *))(f)->call[number])((f)->values.instance))

static const char *function_name(uint32_t number) {
    static const char *const names[] = {"DoStep", "EnterEventMode", "UpdateDiscreteStates", "EnterStepMode", "SetClock",
        "GetClock", "GetIntervalDecimal", "GetIntervalFraction", "GetShiftDecimal", "GetShiftFraction", "GetFMUState",
        "SetFMUState", "FreeFMUState"};
    return number < CLOCKED_VALUES ? names[number] : NULL;
}

/* ------------------------------------------------------------------ failures */

static uint32_t failed(ClockedFmu *f, ClockedEnd end, uint32_t function, uint32_t status) {
    ClockedReport *const r = &f->network->report;
    r->end = end;
    r->function = function;
    r->status = status;
    r->fmu = f;
    f->dead |= status == FATAL;
    return status > WARNING ? status : ERROR;
}

static uint32_t failed_with(ClockedFmu *f, ClockedEnd end, double value) {
    f->network->report.value = value;
    return failed(f, end, CLOCKED_UPDATE, ERROR);
}

/* After a call of an FMU, which may have changed the floating-point environment. */
static uint32_t seen(ClockedFmu *f, uint32_t function, uint32_t status) {
    if (f->foreign) f->changed |= environment_restore(f->network->environment);
    return status > WARNING ? failed(f, CLOCKED_CALL_FAILED, function, status) : OK;
}

static void look_at_environment(ClockedFmu *f) { f->network->environment = environment_bits(); }

static void why(const ClockedNetwork *n, char *text, size_t size) {
    static const char *const said[] = {"", "", "in event mode at %.9g s",
        "event iteration did not converge: every update of discrete states requires another one",
        "event iteration did not converge: clocks tick again after every update",
        "clocks tick, or FMUs return early, more than %.9g times from %.9g s to %.9g s",
        "a clock ticks at %.9g s, within a step from %.9g s to %.9g s, and the FMU takes no steps of other lengths "
        "(canHandleVariableCommunicationStepSize): give it a step so that every tick is at the beginning of a step",
        "it returned early at %.9g s, outside of the step from %.9g s to %.9g s",
        "the next event that it announces is at %.9g s", "its interval is %.9g s", "its shift is %.9g s"};
    const ClockedReport *const r = &n->report;
    const char *join = "; it goes through ";
    size_t used = 0;
    text[0] = 0;
#define SAY(...) used += (size_t)snprintf(text + used, size - used, __VA_ARGS__), used = used < size ? used : size - 1
    if (r->end >= CLOCKED_BAD_INTERVAL) SAY("clock '%s' cannot be driven: ", r->fmu->setup->clocks[r->clock].name);
    if (r->end == CLOCKED_CALL_FAILED)
        SAY(r->function || r->status > WARNING ? "%s failed" : "%s ended early, which is not allowed",
            r->function < CLOCKED_VALUES ? function_name(r->function) : "moving values");
    SAY(said[r->end], r->value, r->time, r->until);
    for (int32_t i = 0; r->end == CLOCKED_NOT_CONVERGED && n->n_fmus > 1 && i < n->n_fmus; i++)
        if (n->fmus[i]->inside) SAY("%s'%s'", join, n->fmus[i]->setup->name), join = ", ";
    if (r->end == CLOCKED_NOT_CONVERGED && n->n_fmus > 1) SAY(", whose clocks are connected");
    if (r->end && r->end != CLOCKED_TERMINATED && r->end < CLOCKED_BAD_TIME) SAY(" (at %.9g s)", r->fmu->memory.now);
}

/* ------------------------------------------------------------------ exact times */

static int64_t gcd(int64_t a, int64_t b) {
    while (b) {
        const int64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a < 0 ? -a : a;
}

static bool exactly(double x, double n, double d, ClockedTime *time) {
    if (!(n < EXACT && d < EXACT) || n / d != fabs(x)) return false;
    const int64_t divisor = gcd((int64_t)n, (int64_t)d);
    *time = (ClockedTime){(x < 0.0 ? -(int64_t)n : (int64_t)n) / divisor, (int64_t)d / divisor, x};
    return true;
}

/* The simplest number that a double may stand for (cosim/core/time.py): a fraction with a denominator up to a million,
 * by its continued fraction, or a decimal. */
static ClockedTime rational(double x) {
    ClockedTime found = {0, 0, x};
    double rest = fabs(x), p[2] = {0.0, 1.0}, q[2] = {1.0, 0.0};
    for (;;) {
        if (!(rest < EXACT)) break;
        const double whole = (double)(int64_t)rest, n = whole * p[1] + p[0], d = whole * q[1] + q[0];
        if (!(d <= 1e6)) break;
        if (exactly(x, n, d, &found)) return found;
        if (rest == whole) break;
        rest = 1.0 / (rest - whole);
        p[0] = p[1], p[1] = n, q[0] = q[1], q[1] = d;
    }
    for (double d = 1e7; d <= 1e15 && fabs(x) * d < EXACT; d *= 10.0)
        if (exactly(x, (double)(int64_t)(fabs(x) * d + 0.5), d, &found)) return found;
    return found;
}

/* Gives both times one denominator and returns it; 0 if it is too large. */
static int64_t common(ClockedTime *a, ClockedTime *b) {
    if (!a->d || !b->d) return 0;
    const int64_t divisor = gcd(a->d, b->d), fa = b->d / divisor, fb = a->d / divisor;
    if (!((double)a->d * (double)fa < EXACT) || !(fabs((double)a->n * (double)fa) < EXACT) ||
        !(fabs((double)b->n * (double)fb) < EXACT))
        return 0;
    a->n *= fa;
    b->n *= fb;
    return a->d * fa;
}

static ClockedTime sum(ClockedTime a, ClockedTime b) {
    const double value = a.value + b.value;
    const int64_t d = common(&a, &b);
    if (!d) return (ClockedTime){0, 0, value};
    const int64_t n = a.n + b.n, divisor = gcd(n, d);
    return (ClockedTime){n / divisor, d / divisor, (double)n / (double)d};
}

static ClockDue every(ClockedTime interval, ClockedTime base) {
    ClockDue due = {.base_value = base.value, .interval_value = interval.value};
    due.d = common(&base, &interval);
    due.base = base.n;
    due.interval = interval.n;
    return due;
}

static double earlier(double a, double b) { return b < a ? b : a; }

static double time_of(const ClockDue *c) {
    if (c->interval_value == INFINITY) return INFINITY;
    if (!c->d || !(fabs((double)c->base + (double)c->count * (double)c->interval) < 512.0 * EXACT))
        return c->base_value + (double)c->count * c->interval_value;
    return (double)(c->base + c->count * c->interval) / (double)c->d;
}

/* ------------------------------------------------------------------ intervals of clocks */

static bool time_based(const ClockSetup *c) { return c->kind >= CLOCK_PERIODIC; }

/* Reads an interval or shift of a clock from the FMU; an interval that the FMU does not know yet is 0. */
static uint32_t ask(ClockedFmu *f, uint32_t clock, bool shift, ClockedTime *time, int *qualifier) {
    const ClockSetup *const c = &f->setup->clocks[clock];
    const uint32_t number = (uint32_t)(shift ? CLOCKED_SHIFT : CLOCKED_INTERVAL) + c->fractions;
    const uint32_t *const of = &c->reference;
    const ClockedEnd bad = shift ? CLOCKED_BAD_SHIFT : CLOCKED_BAD_INTERVAL;
    double value = 0.0;
    uint64_t counter = 0, resolution = 1;
    *qualifier = UNCHANGED;
    f->network->report.clock = clock;
    if (!f->call[number]) return failed(f, CLOCKED_CALL_FAILED, number, ERROR);
    TRY(shift && c->fractions ? CALL(f, number, ShiftFraction, of, 1, &counter, &resolution)
        : shift               ? CALL(f, number, ShiftDecimal, of, 1, &value)
        : c->fractions        ? CALL(f, number, Fraction, of, 1, &counter, &resolution, qualifier)
                              : CALL(f, number, Decimal, of, 1, &value, qualifier));
    if (*qualifier == NOT_YET_KNOWN) {
        *time = (ClockedTime){0, 1, 0.0};
    } else if (c->fractions) {
        value = (double)counter / (double)resolution;
        if (!exactly(value, (double)counter, (double)resolution, time)) *time = (ClockedTime){0, 0, value};
    } else {
        *time = rational(value);
    }
    return isfinite(time->value) && time->value >= 0.0 ? (uint32_t)OK : failed_with(f, bad, time->value);
}

static uint32_t positive(ClockedFmu *f, ClockedTime interval) {
    return interval.value > 0.0 ? (uint32_t)OK : failed_with(f, CLOCKED_BAD_INTERVAL, interval.value);
}

static uint32_t read_intervals(ClockedFmu *f, double t) {
    look_at_environment(f);
    for (uint32_t k = 0; k < CLOCKED_VALUES; k++)
        if (!f->call[k] && (k < CLOCKED_INTERVAL || (k >= CLOCKED_SAVE && f->setup->returns_early)))
            return failed(f, CLOCKED_CALL_FAILED, k, ERROR);
    const ClockedTime start = rational(t), none = {0, 0, INFINITY};
    f->memory = (ClockedMemory){.now = t, .next_event = INFINITY};
    f->stepping = false;
    for (uint32_t i = 0; i < f->setup->n_clocks; i++) {
        const ClockSetup *const c = &f->setup->clocks[i];
        ClockedTime interval = c->interval, shift = c->shift;
        int qualifier;
        if (!time_based(c)) continue;
        if (c->kind >= CLOCK_CHANGING) {
            TRY(ask(f, i, false, &interval, &qualifier));
            f->due[i] = qualifier == NOT_YET_KNOWN ? every(none, none) : every(interval, sum(start, interval));
            continue;
        }
        f->network->report.clock = i;
        if (!c->given) {
            TRY(ask(f, i, true, &shift, &qualifier));
            TRY(ask(f, i, false, &interval, &qualifier));
        }
        TRY(positive(f, interval));
        f->due[i] = every(interval, sum(start, shift));
    }
    return OK;
}

/* Intervals that the FMU tells in event mode: of countdowns; `ticking`: of changing clocks that tick; `tuned`: of
 * tunable ones, after a parameter was set. */
static uint32_t reschedule(ClockedFmu *f, bool ticking, bool tuned) {
    const ClockedTime none = {0, 0, INFINITY};
    for (uint32_t i = 0; i < f->setup->n_clocks; i++) {
        const ClockSetup *const c = &f->setup->clocks[i];
        const bool ticks = ticking && f->ticking[i], retunes = tuned && c->kind == CLOCK_TUNABLE && !c->given;
        ClockedTime interval;
        int qualifier;
        if (c->kind != CLOCK_COUNTDOWN && !(c->kind == CLOCK_CHANGING && ticks) && !retunes) continue;
        TRY(ask(f, i, false, &interval, &qualifier));
        if (retunes && qualifier == CHANGED) TRY(positive(f, interval));
        if (qualifier == CHANGED) f->due[i] = every(interval, sum(rational(f->memory.now), interval));
        else if (c->kind == CLOCK_COUNTDOWN && ticks) f->due[i] = every(none, none);
    }
    return OK;
}

/* When the FMU must be in event mode next. */
static double next_of(const ClockedFmu *f) {
    double next = f->memory.next_event;
    for (uint32_t i = 0; i < f->setup->n_clocks; i++)
        if (time_based(&f->setup->clocks[i])) next = earlier(next, time_of(&f->due[i]));
    return next;
}

/* ------------------------------------------------------------------ values */

static bool meet(const uint32_t *clocks, uint32_t n, const uint8_t *set) {
    for (uint32_t i = 0; i < n; i++)
        if (set[clocks[i]]) return true;
    return false;
}

static uint32_t move(ClockedFmu *f, const ClockedGroup *g, bool set) {
    Engine *const e = &f->network->engine;
    const int32_t first = (int32_t)g->first;
    if (set) f->values.sets = f->sets + first, f->values.n_sets = (int32_t)g->n;
    else f->values.gets = f->gets + first, f->values.n_gets = (int32_t)g->n;
    const int failure = set ? engine_set(e, &f->values) : engine_get(e, &f->values);
    f->network->report.call = e->call + (set ? first : -first);
    return seen(f, CLOCKED_VALUES, failure ? e->status : (uint32_t)OK);
}

/* Inputs of these clocks, those that are discrete without a clock, and all others. */
static uint32_t set_inputs(ClockedFmu *f, const uint8_t *clocks, bool discrete, bool others) {
    for (const ClockedGroup *g = f->setup->inputs, *end = g + f->setup->n_inputs; g < end; g++) {
        double *const waits = g->waits < 0 ? NULL : &f->values.u[g->waits];
        if (!(g->n_clocks ? meet(g->clocks, g->n_clocks, clocks) : g->at_events ? discrete : others)) continue;
        if (waits && *waits == 0.0) continue;
        TRY(move(f, g, true));
        if (waits) *waits = 0.0;
    }
    return OK;
}

/* Outputs of these clocks, and those without a clock. */
static uint32_t get_outputs(ClockedFmu *f, const uint8_t *clocks, bool others) {
    for (const ClockedGroup *g = f->setup->outputs, *end = g + f->setup->n_outputs; g < end; g++)
        if (g->n_clocks ? meet(g->clocks, g->n_clocks, clocks) : others) TRY(move(f, g, false));
    return OK;
}

#define NO_CLOCKS(f) ((f)->every + (f)->setup->n_clocks + 1) /* the set without any, behind that of all */

static uint32_t set_port(void *instance, const uint32_t *fmu, size_t n, void *u, size_t n_u) {
    ClockedFmu *const f = (ClockedFmu *)(uintptr_t)fmu;
    (void)instance, (void)n;
    memcpy(f->values.u, u, n_u * sizeof(double));
    look_at_environment(f);
    return set_inputs(f, f->stepping ? NO_CLOCKS(f) : f->every, !f->stepping, true);
}

static uint32_t get_port(void *instance, const uint32_t *fmu, size_t n, void *y, size_t n_y) {
    ClockedFmu *const f = (ClockedFmu *)(uintptr_t)fmu;
    (void)instance, (void)n;
    look_at_environment(f);
    if (f->stepping) {
        if (!f->arrived) TRY(get_outputs(f, NO_CLOCKS(f), true)); /* otherwise its step is still to be taken */
    } else {
        for (const ClockedGroup *g = f->setup->outputs, *end = g + f->setup->n_outputs; g < end; g++)
            if (g->at_first) TRY(move(f, g, false));
    }
    memcpy(y, f->values.y, n_y * sizeof(double));
    return OK;
}

/* ------------------------------------------------------------------ event mode */

static void add(const ClockedFmu *f, uint8_t *to, const uint8_t *more) {
    for (uint32_t i = 0; i < f->setup->n_clocks; i++) to[i] |= more[i];
}

static void clear(const ClockedFmu *f, uint8_t *set) { memset(set, 0, f->setup->n_clocks + 1); }

static uint32_t enter(ClockedFmu *f) {
    look_at_environment(f);
    TRY(PLAIN(f, CLOCKED_ENTER));
    f->flags[0] = false;
    return OK;
}

/* Inputs that another continuous component drives have their extrapolated value at the tick. */
static void follow(ClockedFmu *f) {
    const EngineAdaptive *const a = f->adaptive;
    for (const ClockWire *i = f->followed, *end = i + f->n_followed; i < end; i++) {
        const double s = f->memory.now - a->since;
        const double value = a->begin[i->from] + s * (a->slope[i->from] + a->curve[i->from] * (s + a->over));
        f->values.u[i->to] = i->scale * value + i->offset;
    }
}

/* These clocks tick: their inputs are set; `first`: discrete inputs without a clock too. */
static uint32_t tick(ClockedFmu *f, const uint8_t *clocks, bool first) {
    size_t n = 0;
    for (uint32_t i = 0; i < f->setup->n_clocks; i++)
        if (clocks[i]) f->references[n++] = f->setup->clocks[i].reference;
    if (n) TRY(CALL(f, CLOCKED_SET_CLOCK, SetClock, f->references, n, f->truths));
    follow(f);
    TRY(set_inputs(f, clocks, first, false));
    for (uint32_t i = 0; i < f->setup->n_clocks; i++) f->due[i].count += clocks[i];
    return OK;
}

/* Output clocks that tick, and in the first round time-based ones, as far as that is not known yet. */
static uint32_t find_fresh(ClockedFmu *f) {
    size_t n = 0;
    for (uint32_t i = 0; i < f->setup->n_clocks; i++)
        if (f->setup->clocks[i].kind == CLOCK_OUTPUT) f->references[n++] = f->setup->clocks[i].reference;
    if (n) TRY(CALL(f, CLOCKED_GET_CLOCK, GetClock, f->references, n, f->told));
    n = 0;
    for (uint32_t i = 0; i < f->setup->n_clocks; i++) {
        const bool told = f->setup->clocks[i].kind == CLOCK_OUTPUT && f->told[n++];
        f->fresh[i] = (told || f->ticking[i]) && !f->sent[i];
    }
    add(f, f->active, f->fresh);
    add(f, f->sent, f->fresh);
    return OK;
}

static bool concerns(const ClockWire *w, const ClockedNetwork *n, const ClockedFmu *target, const uint8_t *clocks) {
    return n->fmus[w->target] == target && meet(w->clocks, w->n_clocks, clocks);
}

/* Inputs of these clocks get what other FMUs have now; whether one of them has changed. */
static uint32_t pass_on(ClockedNetwork *n, ClockedFmu *target, const uint8_t *clocks, bool *changed) {
    const ClockWire *const end = n->wires + n->n_wires;
    *changed = false;
    for (const ClockWire *w = n->wires; w < end; w++) {
        bool known = false, plain = false;
        if (!concerns(w, n, target, clocks)) continue;
        for (const ClockWire *other = n->wires; other < end; other++)
            if (other->source == w->source && concerns(other, n, target, clocks)) {
                known |= other < w;
                plain |= other->plain;
            }
        if (!known) TRY(get_outputs(n->fmus[w->source], n->fmus[w->source]->active, plain));
    }
    for (const ClockWire *w = n->wires; w < end; w++) {
        if (!concerns(w, n, target, clocks)) continue;
        double *const u = target->values.u + w->to;
        const double *const y = n->fmus[w->source]->values.y + w->from;
        for (uint32_t k = 0; k < w->n; k++) {
            const double value = w->scale * y[k] + w->offset;
            *changed |= u[k] != value;
            u[k] = value;
        }
    }
    return OK;
}

static void list(ClockedNetwork *n, ClockedFmu *f) {
    if (f->listed) return;
    f->listed = true;
    n->order[n->n_order++] = f;
}

/* Clocks `fresh` of an FMU tick those of another one, which is number k of the ticks and the first of this pair. */
static uint32_t reach(ClockedNetwork *n, ClockedFmu *source, int32_t k, int32_t *n_queue) {
    ClockedFmu *const target = n->fmus[n->ticks[k].target];
    uint8_t *const now = target->hit + target->setup->n_clocks + 1; /* behind those that were hit before */
    bool changed;
    clear(target, now);
    for (int32_t i = 0; i < n->n_ticks; i++) {
        const ClockTick *const t = &n->ticks[i];
        if (n->fmus[t->source] != source || n->fmus[t->target] != target || !source->fresh[t->origin]) continue;
        if (i < k) return OK; /* done already */
        now[t->clock] = 1;
    }
    TRY(pass_on(n, target, now, &changed));
    if (!target->inside) {
        target->inside = true;
        TRY(enter(target));
    }
    TRY(tick(target, now, false));
    list(n, target);
    if (!memchr(target->hit, 1, target->setup->n_clocks))
        n->reached[n->n_reached++] = target;
    add(target, target->active, now);
    add(target, target->hit, now);
    if (!target->queued) n->queue[(*n_queue)++ % n->n_fmus] = target, target->queued = true;
    return OK;
}

/* Ticks reach what is connected to them. */
static uint32_t spread(ClockedNetwork *n) {
    int32_t n_queue = 0;
    n->n_reached = 0;
    for (int32_t i = 0; i < n->n_fmus; i++) {
        clear(n->fmus[i], n->fmus[i]->sent);
        clear(n->fmus[i], n->fmus[i]->hit);
        n->fmus[i]->queued = false;
    }
    for (; n_queue < n->n_order; n_queue++) n->queue[n_queue] = n->order[n_queue], n->order[n_queue]->queued = true;
    for (int32_t k = 0; k < n_queue; k++) { /* in one round a clock ticks once, so this ends */
        ClockedFmu *const source = n->queue[k % n->n_fmus];
        source->queued = false;
        TRY(find_fresh(source));
        for (int32_t i = 0; i < n->n_ticks; i++)
            if (n->fmus[n->ticks[i].source] == source && source->fresh[n->ticks[i].origin])
                TRY(reach(n, source, i, &n_queue));
    }
    for (int32_t k = 0; k < n->n_reached; k++) { /* what was computed after the tick */
        ClockedFmu *const target = n->reached[k];
        bool changed;
        TRY(pass_on(n, target, target->hit, &changed));
        if (changed) TRY(set_inputs(target, target->hit, false, false));
    }
    return OK;
}

/* Read outputs of active clocks and update discrete states; whether another update is required. */
static uint32_t update(ClockedFmu *f, bool *again) {
    bool terminate = false, nominals = false, states = false, has_next = false;
    double next = INFINITY;
    *again = false;
    TRY(get_outputs(f, f->active, false));
    TRY(reschedule(f, true, false));
    TRY(CALL(f, CLOCKED_UPDATE, Update, again, &terminate, &nominals, &states, &has_next, &next));
    f->memory.ends = terminate;
    if (terminate) return failed_with(f, CLOCKED_TERMINATED, f->memory.now);
    if (*again) return OK;
    TRY(reschedule(f, false, f->tuned));
    f->tuned = false;
    if (has_next && isnan(next)) return failed_with(f, CLOCKED_BAD_EVENT, next);
    f->memory.next_event = has_next ? next : INFINITY;
    return OK;
}

/* Let ticks spread and update discrete states until they stay. The FMUs in `order` are in event mode, with their
 * time-based clocks that tick. */
static uint32_t iterate(ClockedNetwork *n) {
    for (int32_t i = 0; i < n->n_fmus; i++) n->fmus[i]->inside = n->fmus[i]->listed = false;
    for (int32_t i = 0; i < n->n_order; i++) n->order[i]->inside = n->order[i]->listed = true;
    for (int32_t round = 0; round < ITERATIONS; round++) {
        for (int32_t i = 0; i < n->n_fmus; i++) {
            ClockedFmu *const f = n->fmus[i];
            if (round || !f->listed) clear(f, f->ticking);
            memcpy(f->active, f->ticking, f->setup->n_clocks);
        }
        TRY(spread(n));
        const int32_t updated = n->n_order;
        n->n_order = 0;
        for (int32_t k = 0; k < updated; k++) {
            ClockedFmu *const f = n->order[k];
            bool again;
            TRY(update(f, &again));
            f->listed = false;
            if (again) list(n, f);
        }
        if (n->n_order) continue;
        for (int32_t i = 0; i < n->n_fmus; i++)
            if (n->fmus[i]->inside) TRY(PLAIN(n->fmus[i], CLOCKED_LEAVE));
        return OK;
    }
    return failed_with(n->order[0], CLOCKED_NOT_CONVERGED, 0.0);
}

/* Event mode of the FMUs in `order`, with their time-based clocks that tick. */
static uint32_t process_event(ClockedNetwork *n, bool first) {
    for (int32_t i = 0; i < n->n_order; i++) {
        TRY(enter(n->order[i]));
        TRY(tick(n->order[i], n->order[i]->ticking, first));
    }
    return iterate(n);
}

static uint32_t begin(ClockedNetwork *n) {
    n->n_order = 0;
    for (int32_t i = 0; i < n->n_fmus; i++) {
        ClockedFmu *const f = n->fmus[i];
        clear(f, f->ticking);
        if (!f->stepping) n->order[n->n_order++] = f;
        f->stepping = true;
    }
    if (n->n_order) look_at_environment(n->order[0]);
    return iterate(n);
}

static uint32_t leave(ClockedFmu *f) {
    clear(f, f->ticking);
    f->network->order[0] = f;
    f->network->n_order = 1;
    return iterate(f->network);
}

/* Process all events at the present time; `first`: at the beginning of a step, where discrete inputs change. An FMU
 * that still announces an event between `now` and `now` + `near` is stepped to it. */
static uint32_t process_events(ClockedNetwork *n, double near, bool first) {
    for (int32_t k = 0; k < ITERATIONS; k++, first = false) {
        n->n_order = 0;
        for (int32_t i = 0; i < n->n_fmus; i++) {
            ClockedFmu *const f = n->fmus[i];
            const double until = f->memory.now + near;
            bool active = f->flags[0] || f->memory.next_event <= (k ? f->memory.now : until);
            for (uint32_t c = 0; c < f->setup->n_clocks; c++) {
                f->ticking[c] = time_based(&f->setup->clocks[c]) && time_of(&f->due[c]) <= until;
                active |= f->ticking[c];
            }
            for (uint32_t g = 0; g < f->setup->n_inputs && first; g++) active |= f->setup->inputs[g].at_events;
            if (active) n->order[n->n_order++] = f;
        }
        if (!n->n_order) return OK;
        TRY(process_event(n, first));
    }
    return failed_with(n->order[0], CLOCKED_TICKS_AGAIN, 0.0);
}

/* ------------------------------------------------------------------ steps */

/* `fmi3DoStep` from where it stands to `to`, or to where it returns early. */
static uint32_t advance(ClockedFmu *f, double to, double end) {
    ClockedReport *const r = &f->network->report;
    const double now = f->memory.now;
    bool *const flags = f->flags;
    r->time = now;
    r->until = to;
    const bool no_set_prior = f->no_set_prior && !f->state;
    const uint32_t status = ((EngineStep3)f->call[CLOCKED_DO_STEP])(
        f->values.instance, now, to - now, no_set_prior, flags, flags + 2, flags + 3, f->last);
    TRY(seen(f, CLOCKED_DO_STEP, status));
    const bool early = f->setup->returns_early && flags[3] && !flags[2];
    const bool whole = to >= end && ENGINE_IS_WHOLE(*f->last, now, to - now);
    if (!early && (flags[3] || (flags[2] && !whole))) return failed(f, CLOCKED_CALL_FAILED, CLOCKED_DO_STEP, status);
    if (early && !(now <= *f->last && *f->last <= to)) return failed_with(f, CLOCKED_BAD_TIME, *f->last);
    f->memory.now = early ? *f->last : to;
    return OK;
}

static uint32_t save(ClockedFmu *f) {
    f->saved = f->memory.now;
    return CALL(f, CLOCKED_SAVE, EngineState, &f->state);
}

static uint32_t go_back(ClockedFmu *f, double to, double end) {
    TRY(CALL(f, CLOCKED_RESTORE, EngineStateSet, f->state));
    f->memory.now = f->saved;
    return advance(f, to, end);
}

static uint32_t failed_between(ClockedFmu *f, ClockedEnd reason, double value, double t, double end) {
    f->network->report.time = t;
    f->network->report.until = end;
    return failed_with(f, reason, value);
}

/* All of them do a step to the same time: `to`, or where the first one returns early. */
static uint32_t advance_all(ClockedNetwork *n, double t, double *to, double end, double near) {
    int32_t early = 0, returns = 0;
    for (int32_t i = 0; i < n->n_fmus; i++) early += n->fmus[i]->setup->returns_early;
    for (int32_t i = 0; i < n->n_fmus; i++) {
        ClockedFmu *const f = n->fmus[i];
        if (!f->setup->returns_early) continue;
        if (early > 1) TRY(save(f));
        TRY(advance(f, *to, end));
        if (f->memory.now < *to - near) *to = f->memory.now;
    }
    for (int32_t i = 0; i < n->n_fmus; i++) { /* those that are beyond it go back; one may return even earlier then */
        ClockedFmu *const f = n->fmus[i];
        if (!f->state || !(f->memory.now > *to + near)) continue;
        TRY(go_back(f, *to, end));
        if (!(f->memory.now < *to - near)) continue;
        if (++returns == ITERATIONS) return failed_between(f, CLOCKED_TOO_MANY, ITERATIONS, t, end);
        *to = f->memory.now;
        i = -1;
    }
    for (int32_t i = 0; i < n->n_fmus; i++) {
        ClockedFmu *const f = n->fmus[i];
        if (f->setup->returns_early) continue;
        if (*to < end && !f->setup->variable_step) return failed_between(f, CLOCKED_FIXED_STEP, *to, t, end);
        TRY(advance(f, *to, end));
    }
    return OK;
}

static uint32_t take(ClockedNetwork *n, double t, double end, double near) {
    for (int32_t i = 0; i < n->n_fmus; i++) {
        n->fmus[i]->memory.now = t;
        if (n->fmus[i]->memory.ends) return failed_with(n->fmus[i], CLOCKED_TERMINATED, t);
    }
    TRY(process_events(n, near, true));
    for (int32_t k = 0; k < ITERATIONS; k++) {
        double to = INFINITY;
        for (int32_t i = 0; i < n->n_fmus; i++) to = earlier(to, next_of(n->fmus[i]));
        if (!(to < end - near)) to = end;
        const uint32_t status = advance_all(n, t, &to, end, near);
        for (int32_t i = 0; i < n->n_fmus; i++) {
            ClockedFmu *const f = n->fmus[i];
            if (f->state && !f->dead) (void)((EngineState)f->call[CLOCKED_FREE])(f->values.instance, &f->state);
            f->state = NULL;
        }
        TRY(status);
        if (to < end) {
            TRY(process_events(n, near, false));
            continue;
        }
        for (int32_t i = 0; i < n->n_fmus; i++)
            if (n->fmus[i]->flags[2]) return failed(n->fmus[i], CLOCKED_CALL_FAILED, CLOCKED_DO_STEP, OK);
        n->n_order = 0;
        for (int32_t i = 0; i < n->n_fmus; i++) {
            clear(n->fmus[i], n->fmus[i]->ticking);
            if (n->fmus[i]->flags[0]) n->order[n->n_order++] = n->fmus[i];
        }
        return process_event(n, false);
    }
    return failed_between(n->fmus[0], CLOCKED_TOO_MANY, ITERATIONS, t, end);
}

/* Whether a step has failed because an FMU asks for the end of the simulation. */
static bool asks_for_end(const ClockedReport *r) {
    const bool stepped = r->end == CLOCKED_CALL_FAILED && r->function == CLOCKED_DO_STEP;
    return r->end == CLOCKED_TERMINATED || (stepped && r->status <= DISCARD && r->fmu->flags[2]);
}

static uint32_t step(
    void *fmu, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    ClockedFmu *const f = fmu;
    ClockedNetwork *const n = f->network;
    if (f->arrived) /* an attempt that has failed */
        for (int32_t i = 0; i < n->n_fmus; i++) n->fmus[i]->arrived = false;
    f->arrived = true;
    f->no_set_prior = no_set_prior;
    *event = *terminate = *early = false;
    for (int32_t i = 0; i < n->n_fmus; i++)
        if (!n->fmus[i]->arrived) return OK;
    for (int32_t i = 0; i < n->n_fmus; i++) n->fmus[i]->arrived = false;
    look_at_environment(f);
    const double near = earlier(1e-9 * (1.0 + fabs(t)), 1e-3 * h);
    const uint32_t status = take(n, t, t + h, near);
    const bool ends = status && asks_for_end(&n->report);
    if (status && !ends) return status;
    double reached = t + h;
    for (int32_t i = 0; i < n->n_fmus; i++) reached = earlier(reached, n->fmus[i]->memory.now);
    const bool whole = !(reached < t + h - near);
    for (int32_t i = 0; i < n->n_fmus && whole; i++) {
        ClockedFmu *const other = n->fmus[i];
        if (other == f && !ends) continue; /* the caller reads its outputs */
        TRY(get_outputs(other, NO_CLOCKS(other), true));
        if (other->shown) memcpy(other->shown, other->values.y, other->setup->n_y * sizeof(double));
    }
    *event = false;
    *terminate = ends;
    *early = !whole;
    *last = whole ? t + h : reached;
    return OK;
}

/* ------------------------------------------------------------------ memory */

static size_t size_of(const ClockedSetup *s) {
    const size_t n = s->n_clocks + 1, n_values = (size_t)s->n_u + s->n_y;
    const size_t each = sizeof(ClockDue) + sizeof(uint32_t) + 2 * sizeof(bool) + 8 * sizeof(uint8_t);
    return (sizeof(ClockedFmu) + n * each + n_values * sizeof(double) + 15u) & ~(size_t)15u;
}

static void join(ClockedNetwork *network, ClockedFmu **pointers, int32_t n) {
    network->fmus = pointers;
    network->order = pointers + n;
    network->queue = pointers + 2 * (size_t)n;
    network->reached = pointers + 3 * (size_t)n;
    network->n_fmus = n;
    for (int32_t i = 0; i < n; i++) pointers[i]->network = network;
}

static ClockedFmu *make(void *memory, const ClockedSetup *s, void *instance) {
    const size_t n = s->n_clocks + 1;
    ClockedFmu *const f = memory;
    memset(memory, 0, size_of(s));
    f->setup = s;
    f->values = (EngineComponent){.fmi = 3, .instance = instance};
    f->due = (ClockDue *)(f + 1);
    f->values.u = (double *)(f->due + n);
    f->values.y = f->values.u + s->n_u;
    f->references = (uint32_t *)(f->values.y + s->n_y);
    f->told = (bool *)(f->references + n);
    f->truths = f->told + n;
    f->ticking = (uint8_t *)(f->truths + n);
    f->active = f->ticking + n;
    f->sent = f->active + n;
    f->fresh = f->sent + n;
    f->hit = f->fresh + n; /* of 2 n */
    f->every = f->hit + 2 * n; /* of 2 n */
    memset(f->truths, 1, n * sizeof(bool));
    memset(f->every, 1, n);
    f->self[0] = f;
    join(&f->own, f->self, 1);
    return f;
}

const ClockedCalls clocked_calls = {
    function_name, size_of, make, join, read_intervals, begin, enter, leave, set_port, get_port, step, why};
