/* A system of FMUs as one instance: the functions of fmu_core.h, carried out by its components and the engine.
 *
 * The order of everything is that of a run (cosim/engine): initialization, one instant after the other,
 * arrival at the end of a step. What changes lies in one block without pointers, and in the components. */

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_base.h"
#include "fmu_core.h"
#include "fmu_math.h"
#include "environment.h"
#include "system.h"

#define STATE_MAGIC 0x53594d55u /* 'UMYS'; also tells a foreign byte order */
#define STATE_VERSION 2u
#define EXACT 9007199254740992 /* 2^53: integers below it are doubles */
#define WITHIN 1e-9            /* of a tick: how near to a whole number of them a time must be */
#define MOST_TICKS 10000000.0  /* in one step: beyond it the step size is a mistake */

static const Plan *const P = &plan;

/* Everything that changes, but for what is in the components. */
typedef struct {
    int64_t tick, stop_tick; /* stop_tick: INT64_MAX without a stop time */
    int64_t a, b, d;         /* time = (tick * a + b) / d */
    double start;
    int32_t mode;
    int32_t settled;         /* while initializing: outputs follow from inputs and parameters */
    int32_t ended;           /* a component has asked for the end */
    int32_t ends_by;         /* which one */
    int64_t ending;          /* tick at which it ends; INT64_MAX: none has asked */
    double v[];              /* values, inputs of components, buffers of calls */
} State;

typedef struct {
    uint32_t magic, version;
    uint64_t model, length, components; /* of the system, the state block and all components' states, in bytes */
    uint64_t checksum; /* once serialized; until then the address of this header, so that no bytes pass for a state */
} Header;

/* A saved state: header, state block, the components' states. */
typedef struct {
    Header header;
    void *components[];
} Saved;

/* The last step of a component that repeats it. */
typedef struct {
    void *state; /* at the beginning of the step; NULL if no step can be repeated */
    double t;
} LastStep;

struct FmuInstance {
    FmuBase base;
    State *state;
    double *values, *before; /* before: the values of a moment ago */
    double *old;             /* of variables that are being set: values of the components, then those that are shown */
    double *passed;                /* values of calculated parameters that were passed on */
    Engine engine;
    EngineComponent *bound;
    Component *components;
    EngineTransfer *transfers;
    EngineDerivative *derivatives; /* of all loops, one after the other */
    LastStep *repeated; /* by component */
    void *texts;                    /* memory of calls of texts, bytes and 64-bit integers */
    void *networks;                 /* memory of networks of clocks */
    bool *flags;
    double *last;
    int32_t logging;                /* the component that logs */
};

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }
static size_t n_numbers(void) { return (size_t)P->n_values + P->n_u + (P->n_buffer + 7u) / 8u; }
static size_t state_size(void) { return sizeof(State) + n_numbers() * sizeof(double); }

/* ------------------------------------------------------------------ life cycle */

static void from_component(void *context, int status, const char *message);
static int repeat(void *context, int32_t component, double t);
static void forget_last(FmuInstance *self, int32_t i);

typedef struct {
    FmuInstance *self;
    int32_t component;
} Source;

/* What calls of texts, bytes and 64-bit integers need. */
static size_t texts_room(void) {
    size_t n = 0;
    for (int32_t i = 0; P->texts && i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        for (int32_t k = 0; k < p->n_sets + p->n_gets; k++) {
            const PlanTransfer *t = k < p->n_sets ? &p->sets[k] : &p->gets[k - p->n_sets];
            n += t->exact ? P->texts->room(t) : 0;
        }
    }
    return n;
}

static size_t networks_room(int32_t n) {
    size_t size = 0;
    for (int32_t i = 0; i < n; i++) size += aligned(P->networks->room(&P->connected[i]));
    return size;
}

static void *network(const FmuInstance *self, int32_t i) { return (char *)self->networks + networks_room(i); }

static size_t n_transfers(void) {
    size_t n = 0;
    for (int32_t i = 0; i < P->n_components; i++) n += (size_t)(P->components[i].n_sets + P->components[i].n_gets);
    return n;
}

/* Directional derivatives of all loops, and doubles that the loops need. */
static size_t n_derivatives(void) {
    size_t n = 0;
    for (int32_t i = 0; i < P->n_loops; i++) n += P->loops[i].derivatives ? (size_t)P->loops[i].n_components : 0;
    return n;
}

static size_t derivative_work(const EngineDerivative *d) { return 2 * ((size_t)d->n_knowns + d->n_unknowns); }

static size_t loop_work(void) {
    size_t n = 0;
    for (int32_t i = 0; i < P->n_loops; i++) {
        const EngineLoop *l = &P->loops[i];
        n += engine_loop_work(l->n);
        for (int32_t k = 0; l->derivatives && k < l->n_components; k++) n += derivative_work(&l->derivatives[k]);
    }
    return n;
}

FmuInstance *fmu_create(int is_co_simulation, size_t adapter_size, FmuLog log) {
    const size_t n = (size_t)P->n_components, c = (size_t)P->n_clocks;
    const size_t sizes[] = {
        aligned(sizeof(FmuInstance)),
        aligned(adapter_size),
        aligned(state_size()),
        aligned(P->n_values * sizeof(double)),
        aligned(2 * (size_t)P->n_variables * sizeof(double)),
        aligned(n * sizeof(EngineComponent)),
        aligned(n * sizeof(Component)),
        aligned(n_transfers() * sizeof(EngineTransfer)),
        aligned(n * 4 * sizeof(bool)),
        aligned(n * sizeof(double)),
        aligned(n * sizeof(Source)),
        aligned(c * sizeof(int64_t)),
        aligned(c * sizeof(bool)),
        aligned(n * sizeof(EngineComponent *)),
        aligned(P->n_published * sizeof(EngineCopy)),
        aligned(n * sizeof(EnginePiece)),
        aligned(n * (sizeof(Functions2) + sizeof(Functions3))),
        aligned((size_t)P->n_loops * sizeof(EngineLoop)),
        aligned(loop_work() * sizeof(double)),
        aligned(n_derivatives() * sizeof(EngineDerivative)),
        aligned(n * sizeof(LastStep)),
        aligned(texts_room()),
        aligned(P->n_passed * sizeof(double)),
        networks_room(P->n_connected),
    };
    size_t total = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) total += sizes[i];
    char *block = calloc(1, total);
    if (!block) return NULL;
    void *part[sizeof sizes / sizeof *sizes];
    for (size_t i = 0, offset = 0; i < sizeof sizes / sizeof *sizes; offset += sizes[i], i++) part[i] = block + offset;

    FmuInstance *self = part[0];
    self->state = part[2];
    fmu_base_use(&self->base, is_co_simulation, part[1], log, &self->state->mode);
    self->values = self->state->v;
    self->before = part[3];
    self->old = part[4];
    self->bound = part[5];
    self->components = part[6];
    self->transfers = part[7];
    self->flags = part[8];
    self->last = part[9];
    Source *sources = part[10];
    char *functions = part[16];
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        Component *m = &self->components[i];
        sources[i] = (Source){self, i};
        m->version = p->version;
        m->f2 = p->version != 2 ? NULL : p->functions ? p->functions : (Functions2 *)(void *)functions;
        m->f3 = p->version != 3 ? NULL : p->functions ? p->functions : (Functions3 *)(void *)functions;
        functions += sizeof(Functions2) + sizeof(Functions3);
        m->log = from_component;
        m->context = &sources[i];
    }
    self->engine = (Engine){.values = self->values, .components = self->bound, .n_components = P->n_components,
                            .n_discrete = P->n_discrete, .clocks = P->clocks, .n_clocks = P->n_clocks, .next = part[11],
                            .due = part[12], .list = part[13], .published = part[14], .computed = part[15],
                            .loops = part[17], .n_loops = P->n_loops, .check_finite = true,
                            .back = repeat, .context = self};
    self->repeated = part[20];
    self->texts = part[21];
    self->passed = part[22];
    self->networks = part[23];
    double *work = part[18];
    EngineDerivative *d = self->derivatives = part[19];
    for (int32_t i = 0; i < P->n_loops; i++) {
        EngineLoop *l = &self->engine.loops[i];
        *l = P->loops[i];
        l->work = work;
        work += engine_loop_work(l->n);
        if (!l->derivatives) continue;
        l->derivatives = d;
        for (int32_t k = 0; k < l->n_components; k++, d++) {
            *d = P->loops[i].derivatives[k];
            d->work = work;
            work += derivative_work(d);
        }
    }
    self->state->mode = MODE_INSTANTIATED;
    return self;
}

/* Of what a component says, errors and warnings are passed on. */
static void from_component(void *context, int status, const char *message) {
    const Source *source = context;
    if (status == (int)fmi3OK) return;
    (void)fmu_fail(source->self, status <= (int)fmi3Fatal ? (FmuStatus)status : FMU_ERROR, "%s: %s",
                   P->components[source->component].name, message);
}

/* What a component's call has returned, as this FMU's status, with a message. After a call that has changed nothing the
 * system continues, unless the component is lost. */
static FmuStatus component_refused(FmuInstance *self, int32_t i, const char *what, uint32_t status) {
    if (self->components[i].dead) self->state->mode = MODE_ERROR;
    const char *names[] = {"OK", "Warning", "Discard", "Error", "Fatal", "Pending"};
    const char *name = status < sizeof names / sizeof *names ? names[status] : "no FMI status";
    return fmu_fail(self, FMU_ERROR, "component '%s': %s returned %s at time %.9g s", P->components[i].name, what, name,
        fmu_time(self));
}

/* The same, and the end of this simulation: no step follows (FMI 2.0, 3.0: after an error). */
static FmuStatus component_failed(FmuInstance *self, int32_t i, const char *what, uint32_t status) {
    self->state->mode = MODE_ERROR;
    return component_refused(self, i, what, status);
}

/* The start values that the system gives. */
static FmuStatus set_starts(FmuInstance *self, int32_t i) {
    const PlanComponent *p = &P->components[i];
    for (uint32_t k = 0; k < p->n_starts; k++) {
        const PlanStart *s = &p->starts[k];
        const uint32_t status = s->text ? component_set_text(&self->components[i], s->reference, s->text)
                                : s->bytes ? component_set_bytes(&self->components[i], s->reference, s->bytes, s->n)
                                        : component_set(&self->components[i], s->kind, s->reference, s->values, s->n);
        if (status > fmi3Warning) return component_failed(self, i, "setting a start value", status);
    }
    return FMU_OK;
}

/* Path of the resources; FMI 2.0 gives a URI. */
static void resource_path(const char *given, char *path, size_t n) {
    const char *from = given ? given : "";
    const int is_uri = strncmp(from, "file:", 5) == 0;
    size_t k = 0;
    if (is_uri) {
        from += 5;
        if (strncmp(from, "//", 2) == 0)
            for (from += 2; *from && *from != '/'; from++) continue; /* a host */
#ifdef _WIN32
        if (from[0] == '/' && from[1] && from[2] == ':') from++;
#endif
    }
    for (; *from && k + 1 < n; from++) {
        unsigned code;
        if (is_uri && *from == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            path[k++] = (char)code;
            from += 2;
        } else {
            path[k++] = *from;
        }
    }
    while (k > 0 && (path[k - 1] == '/' || path[k - 1] == '\\')) k--;
    path[k] = '\0';
}

FmuStatus fmu_open(FmuInstance *self, const char *resources) {
    char path[4096], own[4096 + 256], reason[512];
    resource_path(resources, path, sizeof path);
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        Component *m = &self->components[i];
        (void)snprintf(own, sizeof own, "%s/%s/", path, p->resources);
        m->find = P->find;
        m->exchange = p->exchange;
        m->setup = p->setup;
        m->references = p->exchange_references;
        m->linked = p->exchange_calls;
        if (p->folder) {
            void *functions = p->version == 2 ? (void *)(uintptr_t)m->f2 : (void *)(uintptr_t)m->f3;
            m->close = P->close;
            m->library = P->open(path, p->folder, p->identifier, p->version, functions, p->integrated, reason,
                sizeof reason);
            if (!m->library) return fmu_fail(self, FMU_ERROR, "component '%s': %s", p->name, reason);
        }
        m->follows = p->follows;
        if (p->follows && !P->updates->make(m)) return fmu_fail(self, FMU_ERROR, "component '%s': no memory", p->name);
        if (!component_instantiate(m, p->name, p->token, own))
            return fmu_fail(self, FMU_ERROR, "component '%s' cannot be instantiated", p->name);
        const FmuStatus status = set_starts(self, i);
        if (status != FMU_OK) return status;
    }
    for (int32_t i = 0; i < P->n_connected; i++)
        P->networks->join(self->components, &P->connected[i], network(self, i));
    return FMU_OK;
}

void fmu_free(FmuInstance *self) {
    for (int32_t i = P->n_components - 1; i >= 0; i--) {
        forget_last(self, i);
        component_free(&self->components[i]);
    }
    free(self);
}

void fmu_set_mode(FmuInstance *self, FmuMode mode) {
    if (mode == MODE_TERMINATED && self->state->mode == MODE_STEP)
        for (int32_t i = 0; i < P->n_components; i++)
            if (!self->components[i].dead) (void)component_terminate(&self->components[i]);
    self->state->mode = (int32_t)mode;
}

FmuStatus fmu_reset(FmuInstance *self) {
    memset(self->state, 0, state_size());
    self->state->mode = MODE_INSTANTIATED;
    for (int32_t i = 0; i < P->n_components; i++) {
        if (self->components[i].dead) {
            self->state->mode = MODE_ERROR;
            return fmu_fail(
                self, FMU_ERROR, "component '%s' has failed permanently: free this instance", P->components[i].name);
        }
        forget_last(self, i);
        const uint32_t status = component_reset(&self->components[i]);
        if (status > fmi3Warning) return component_failed(self, i, "Reset", status);
        if (set_starts(self, i) != FMU_OK) return FMU_ERROR;
    }
    return FMU_OK;
}

/* ------------------------------------------------------------------ time */

double fmu_time(const FmuInstance *self) {
    const State *s = self->state;
    return s->d ? (double)(s->tick * s->a + s->b) / (double)s->d : 0.0;
}

int fmu_ended(const FmuInstance *self) { return self->state->ended; }

/* A system has no clock that others could tick. */
void fmu_use_events(FmuInstance *self) { (void)self; }
int fmu_uses_events(const FmuInstance *self) {
    (void)self;
    return 0;
}
FmuStatus fmu_tick(FmuInstance *self, const char *function) {
    return fmu_fail(self, FMU_ERROR, "%s: there are no clocks", function);
}
FmuStatus fmu_take_sample(FmuInstance *self, const char *function) { return fmu_tick(self, function); }

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

/* ------------------------------------------------------------------ initialization */

/* Calls and buffers of a component for the engine, as far as they do not change. */
static FmuStatus bind(FmuInstance *self) {
    EngineTransfer *t = self->transfers;
    double *u = self->values + P->n_values;
    char *buffers = (char *)(u + P->n_u), *texts_at = self->texts;
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        Component *m = &self->components[i];
        double *own = p->in_place ? self->values + p->u : u + p->u, *y = self->values + p->first;
        EngineComponent *e = &self->bound[i];
        *e = (EngineComponent){.fmi = p->version,
            .clock = p->clock,
            .step = p->step,
            .check_before = p->check_before,
            .n_copies_before = p->n_copies_before,
            .copies = p->copies,
            .n_copies = p->n_copies,
            .timestamp_slot = p->timestamp_slot,
            .index = p->index,
            .n_inputs = p->in_place ? 0 : p->n_inputs,
            .scale = p->scale,
            .offset = p->offset,
            .extrapolations = p->extrapolations,
            .n_extrapolations = p->n_extrapolations,
            .u = own,
            .y = y,
            .first = p->first,
            .n_outputs = p->n_outputs,
            .instance = m->instance,
            .stepped = m->exchange ? m->integrator : m->instance,
            .flags = self->flags + 4 * i,
            .last = self->last + i,
            .foreign = p->folder != NULL,
            .no_set_prior = 0,
            .n_sets = p->n_sets,
            .n_gets = p->n_gets};
        if (m->exchange) e->step2 = m->exchange->step2, e->step3 = m->exchange->step3;
        else if (p->version == 2) e->step2 = (EngineStep2)m->f2->DoStep;
        else e->step3 = (EngineStep3)m->f3->DoStep;
        const bool waits = m->exchange && m->exchange->bind;
        if (waits) m->exchange->bind(m, self->state->mode == MODE_STEP);
        if (p->follows) {
            const uint32_t status = P->updates->bind(m, e, self->values);
            if (status > fmi3Warning) return component_failed(self, i, "getting inputs", status);
            if (!m->exchange) e->step3 = m->step, e->stepped = m->updates;
        }
        double *from_u = own, *to_y = y;
        if (m->exchange && m->exchange->values) m->exchange->values(m, &from_u, &to_y);
        bool direct = p->n_sets == 1 && p->n_gets == 1;
        for (int set = 1; set >= 0; set--) {
            if (set) e->sets = t;
            else e->gets = t;
            for (int32_t k = 0; k < (set ? p->n_sets : p->n_gets); k++, t++) {
                const PlanTransfer *from = set ? &p->sets[k] : &p->gets[k];
                void *data = from->element ? (void *)(buffers + from->buffer)
                                           : (void *)((set ? from_u : to_y) + from->at);
                *t = (EngineTransfer){.references = from->references,
                    .n_references = from->n_references,
                    .data = data,
                    .n_data = from->n_data,
                    .n = from->n,
                    .element = from->element,
                    .place = from->place};
                component_values(m, from->kind, set != 0, t);
                if (from->exact) {
                    P->texts->bind(m, from, set != 0, texts_at, t);
                    texts_at += P->texts->room(from);
                }
                if (waits && from->waits) m->exchange->wait(m, t);
                direct = direct && !from->element;
            }
        }
        if (m->exchange && m->exchange->attach) {
            m->exchange->attach(m, e, p->n_inputs);
            direct = e->n_sets == 1 && e->n_gets == 1;
        }
        e->direct = direct;
    }
    EngineDerivative *d = self->derivatives;
    for (int32_t i = 0; i < P->n_loops; i++)
        for (int32_t k = 0; P->loops[i].derivatives && k < P->loops[i].n_components; k++, d++) {
            const Component *m = &self->components[P->loops[i].components[k]];
            if (!d->n_knowns) continue;
            if (m->version == 2) d->call2 = (EngineDerivative2)m->f2->GetDirectionalDerivative;
            else d->call3 = (EngineDerivative3)m->f3->GetDirectionalDerivative;
        }
    return FMU_OK;
}

/* ------------------------------------------------------------------ steps that are repeated */

enum { CALL_SAVE = INT32_MIN, CALL_RESTORE }; /* beside those of Engine.call */

static void forget_last(FmuInstance *self, int32_t i) {
    LastStep *last = &self->repeated[i];
    if (last->state && !self->components[i].dead) (void)component_forget(&self->components[i], &last->state);
    last->state = NULL;
}

/* From now on the engine calls back for components that repeat their steps. There is no last step. */
static void repeat_steps(FmuInstance *self) {
    for (int32_t i = 0; i < P->n_components && self->state->mode == MODE_STEP; i++)
        if (P->components[i].repeats) {
            forget_last(self, i);
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
        *whole = status <= fmi3Warning && !self->flags[4 * i + 3];
        return status <= fmi3Discard && self->flags[4 * i + 2];
    }
    const bool asked = status == fmi2Discard && component_asked_to_end(&self->components[i], &reached);
    *whole = reached >= t + step - 1e-6 * step;
    return asked;
}

/* The component that has failed or asked for the end in a step of component i, which others may have taken with it. */
static int32_t culprit_of(const FmuInstance *self, int32_t i, int32_t *call, char *text, size_t size) {
    const Component *m = &self->components[i];
    if (m->exchange && m->exchange->culprit) m = m->exchange->culprit(m, call, text, size);
    return (int32_t)(m - self->components);
}

static int state_failed(FmuInstance *self, int32_t call, uint32_t status) {
    self->engine.call = call;
    self->engine.status = status;
    return ENGINE_STATE_FAILED;
}

/* A step of a component from t on, or, where t is NaN, the last one again with the inputs as they are. */
static int repeat(void *context, int32_t i, double t) {
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
        forget_last(self, i);
        if ((status = component_save(m, &last->state)) > fmi3Warning)
            return state_failed(self, CALL_SAVE, status);
        last->t = t;
        result = engine_set(&self->engine, &e);
        if (!result) result = engine_step(&self->engine, &e, t);
    }
    return result ? result : engine_get(&self->engine, &e);
}

/* The calls of component i, first those that set. */
static const EngineTransfer *calls_of(const FmuInstance *self, int32_t i) {
    const EngineTransfer *t = self->transfers;
    for (int32_t k = 0; k < i; k++) t += P->components[k].n_sets + P->components[k].n_gets;
    return t;
}

/* A call of component i that the engine has made has failed. */
static FmuStatus call_failed(FmuInstance *self, int32_t i) {
    int32_t call = self->engine.call;
    const Component *m = &self->components[i];
    if (m->exchange && m->exchange->culprit) {
        char text[1024];
        i = culprit_of(self, i, &call, text, sizeof text);
        m = &self->components[i];
        (void)fmu_fail(self, FMU_ERROR, "component '%s': %s", P->components[i].name, text);
    }
    if (self->engine.status == fmi3Fatal) self->components[i].dead = true;
    if (m->exchange && !m->exchange->culprit && !call) {
        uint32_t number;
        double time;
        const char *why = m->exchange->why(m, &number, &time);
        (void)fmu_fail(self, FMU_ERROR, "component '%s': its %s failed at %.9g s: %s %u",
            P->components[i].name, P->components[i].integrated ? "integration" : "event mode", time,
            why ? why : "", (unsigned)number);
    }
    const PlanComponent *p = &P->components[i];
    double when;
    const char *const refused = p->follows && !call ? P->updates->why(m, &when) : NULL;
    if (refused) (void)fmu_fail(self, FMU_ERROR, "component '%s': it %s, at %.9g s", p->name, refused, when);
    const bool sets = call > 0 && call <= p->n_sets, gets = call < 0 && call >= -p->n_gets;
    const PlanTransfer *t = sets ? &p->sets[call - 1] : gets ? &p->gets[-call - 1] : NULL;
    if (t && t->exact) {
        uint32_t most = 0;
        const EngineTransfer *bound = calls_of(self, i) + (sets ? call - 1 : p->n_sets - call - 1);
        const uint64_t n = t->waits ? 0 : P->texts->too_long(bound->references, &most);
        if (n)
            (void)fmu_fail(self, FMU_ERROR, "component '%s': a value of at least %llu bytes is longer than its "
                "connection holds, %u: export the system with connect(..., max_size=...)",
                p->name, (unsigned long long)n, (unsigned)most);
    }
    return component_failed(self, i,
        call == CALL_SAVE           ? "GetFMUState"
        : call == CALL_RESTORE      ? "SetFMUState"
        : call == ENGINE_DERIVATIVE ? "GetDirectionalDerivative"
        : call > 0 ? "setting its inputs"
        : call < 0 ? "getting its outputs"
        : m->exchange && m->exchange->culprit ? "taking its step"
                                              : "DoStep",
        self->engine.status);
}

static FmuStatus step_failed(FmuInstance *self, int32_t i, uint32_t status) {
    self->engine.call = 0;
    self->engine.status = status;
    return call_failed(self, i);
}

static FmuStatus not_solved(FmuInstance *self) {
    const EngineLoop *l = &self->engine.loops[self->engine.component];
    self->state->mode = MODE_ERROR;
    return fmu_fail(self, FMU_ERROR,
        "the algebraic loop through %s has no solution at time %.9g s, or its solution jumps there "
        "(%.9g, residual %.3g)",
        P->owners[l->published[0]], fmu_time(self), l->work[0], l->work[l->n]);
}

/* Set parameters to those that other components calculate, until none changes: one may follow from another. */
static FmuStatus pass_parameters(FmuInstance *self) {
    double values[COMPONENT_LARGEST];
    for (uint32_t round = 0; round <= P->n_passed; round++) {
        bool changed = false;
        for (uint32_t k = 0; k < P->n_passed; k++) {
            const PlanPassed *p = &P->passed[k];
            Component *from = &self->components[p->from.component], *to = &self->components[p->to.component];
            uint32_t status = component_get(from, p->from.kind, p->from.reference, values, p->from.n);
            if (status > fmi3Warning)
                return component_failed(self, p->from.component, "getting a calculated parameter", status);
            const double x = p->scale * values[p->from.index] + p->offset;
            if (round && x == self->passed[k]) continue;
            const bool whole = p->to.kind != KIND_FLOAT64 && p->to.kind != KIND_FLOAT32;
            if (!(isfinite(x) && x >= p->min && x <= p->max && (!whole || x == floor(x)))) {
                self->state->mode = MODE_ERROR;
                return fmu_fail(self, FMU_ERROR, "%s would be %g, a value that it cannot have: change the parameters "
                    "that it is calculated from", p->name, x);
            }
            changed = true;
            self->passed[k] = x;
            status = p->to.n > 1 ? component_get(to, p->to.kind, p->to.reference, values, p->to.n) : fmi3OK;
            values[p->to.index] = x;
            if (status <= fmi3Warning) status = component_set(to, p->to.kind, p->to.reference, values, p->to.n);
            if (status > fmi3Warning) return component_failed(self, p->to.component, "setting a parameter", status);
        }
        if (!changed) return FMU_OK;
    }
    self->state->mode = MODE_ERROR;
    return fmu_fail(self, FMU_ERROR, "calculated parameters do not settle: some follow from each other");
}

/* Pass outputs to inputs until nothing changes any more. */
static FmuStatus settle(FmuInstance *self) {
    State *s = self->state;
    if (s->settled) return FMU_OK;
    const FmuStatus passed = pass_parameters(self);
    if (passed != FMU_OK) return passed;
    const int result = engine_settle(&self->engine, NULL, self->before, P->n_values);
    if (result == ENGINE_CALL_FAILED) return call_failed(self, self->engine.component);
    if (result == ENGINE_NO_SOLUTION) return not_solved(self);
    s->settled = 1;
    if (result == ENGINE_UNSETTLED)
        (void)fmu_fail(self, FMU_WARNING, "initial values do not settle, there is a loop among them");
    return FMU_OK;
}

FmuStatus fmu_enter_initialization(FmuInstance *self) {
    State *s = self->state;
    if (!s->d) { /* FMI 2.0 allows leaving out SetupExperiment */
        const FmuStatus status = fmu_setup(self, 0.0, 0, 0.0);
        if (status != FMU_OK) return status;
    }
    s->mode = MODE_INITIALIZATION;
    s->settled = 0;
    for (int32_t i = 0; i < P->n_components; i++) {
        const PlanComponent *p = &P->components[i];
        const EngineClock *clock = &P->clocks[p->clock];
        s->tick = clock->offset;
        const double begin = fmu_time(self);
        s->tick = s->stop_tick;
        const bool met = s->stop_tick != INT64_MAX && s->stop_tick > clock->offset &&
                         (s->stop_tick - clock->offset) % clock->period == 0;
        const double stop = met ? fmu_time(self) : 0.0;
        s->tick = 0;
        const uint32_t status = component_enter(&self->components[i], p->has_tolerance, p->tolerance, begin, met, stop);
        if (status > fmi3Warning) return component_failed(self, i, "EnterInitializationMode", status);
    }
    const FmuStatus bound = bind(self);
    if (bound != FMU_OK) return bound;
    for (int32_t i = 0; i < P->n_components; i++) /* elements that nobody drives */
        for (int32_t k = 0; k < P->components[i].n_sets; k++)
            if (P->components[i].sets[k].keeps) {
                EngineTransfer t = calls_of(self, i)[k];
                component_values(&self->components[i], P->components[i].sets[k].kind, false, &t);
                t.references = P->components[i].sets[k].references;
                t.element = NULL;
                EngineComponent e = self->bound[i];
                e.gets = &t;
                e.n_gets = 1;
                if (engine_get(&self->engine, &e)) return call_failed(self, i);
            }
    for (int32_t i = 0; i < P->n_variables; i++) { /* inputs and parameters that are shown as values too */
        const PlanVariable *v = &P->variables[i];
        if (v->slot >= 0 && (v->role == FMU_INPUT || v->role == FMU_PARAMETER)) {
            const uint32_t status =
                component_get(&self->components[v->component], v->kind, v->reference, self->values + v->slot, 1);
            if (status > fmi3Warning) return component_failed(self, v->component, "getting a value", status);
        }
    }
    engine_publish(&self->engine);
    return FMU_OK;
}

static FmuStatus check_finite(FmuInstance *self) {
    for (uint32_t k = 0; k < P->n_values; k++)
        if (!isfinite(self->values[k]))
            return fmu_fail(self, FMU_ERROR, "%s is %g at time %.9g s", P->owners[k], self->values[k], fmu_time(self));
    return FMU_OK;
}

FmuStatus fmu_exit_initialization(FmuInstance *self) {
    State *s = self->state;
    FmuStatus result = settle(self);
    for (int32_t i = 0; i < P->n_components && result == FMU_OK; i++) {
        const uint32_t status = component_exit(&self->components[i]);
        const Exchange *const steps = P->components[i].exchange;
        if (status > fmi3Warning)
            result = steps && steps->culprit ? step_failed(self, i, status)
                                             : component_failed(self, i, "ExitInitializationMode", status);
    }
    for (int32_t i = 0; i < P->n_connected && result == FMU_OK; i++) {
        const uint32_t status = P->networks->begin(network(self, i));
        if (status > fmi3Warning) result = step_failed(self, P->connected[i].components[0], status);
    }
    for (int32_t i = 0; i < P->n_components && result == FMU_OK; i++)
        if (engine_get(&self->engine, &self->bound[i])) result = call_failed(self, i);
    engine_publish(&self->engine);
    if (result == FMU_OK) result = check_finite(self);
    s->mode = result == FMU_OK ? MODE_STEP : MODE_ERROR;
    repeat_steps(self);
    if (result == FMU_OK) (void)fmu_fail(self, FMU_OK, "%s initialized at %.9g s", fmu_model.name, fmu_time(self));
    return result;
}

/* ------------------------------------------------------------------ values */

static double read_double(const void *values, size_t i) { return ((const double *)values)[i]; }
static void write_double(void *values, size_t i, double value) { ((double *)values)[i] = value; }

static const PlanVariable *lookup(FmuInstance *self, const char *function, FmuType type, unsigned reference) {
    if (reference >= (unsigned)P->n_variables) {
        (void)fmu_fail(self, FMU_ERROR, "%s: unknown value reference %u", function, reference);
        return NULL;
    }
    const PlanVariable *v = &P->variables[reference];
    if (v->type == type) return v;
    (void)fmu_fail(self, FMU_ERROR, "%s: variable %s is of type %s", function, v->name, fmu_type_name(v->type));
    return NULL;
}

static FmuStatus value_of(FmuInstance *self, const PlanVariable *v, double *value) {
    if (v->role == FMU_TIME) {
        *value = fmu_time(self);
        return FMU_OK;
    }
    if (v->role == FMU_OUTPUT) {
        if (self->state->mode == MODE_INITIALIZATION) {
            const FmuStatus status = settle(self);
            if (status != FMU_OK) return status;
        }
        *value = self->values[v->slot];
        if (v->scale != 1.0 || v->shift != 0.0) *value = v->scale * *value + v->shift;
        return FMU_OK;
    }
    Component *m = &self->components[v->component];
    if (m->dead)
        return fmu_fail(self, FMU_ERROR, "component '%s' has failed permanently", P->components[v->component].name);
    const uint32_t status = component_get(m, v->kind, v->reference, value, 1);
    return status > fmi3Warning ? component_failed(self, v->component, "getting a value", status) : FMU_OK;
}

FmuStatus fmu_get_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
    void *values, size_t count, FmuWrite write) {
    FmuStatus status = fmu_check_arrays(self, function, refs, n_refs, values, count);
    if (status == FMU_OK && n_refs != count)
        status = fmu_fail(self, FMU_ERROR, "%s: nValues is %zu, the variables have %zu", function, count, n_refs);
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, type, refs[i]);
        if (!v) return FMU_ERROR;
        double value = 0.0;
        status = value_of(self, v, &value);
        if (status == FMU_OK) write(values, i, value);
    }
    return status;
}

FmuStatus fmu_get(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
    double *values, size_t count) {
    return fmu_get_as(self, function, type, refs, n_refs, values, count, write_double);
}

static FmuStatus check_settable(FmuInstance *self, const char *function, const PlanVariable *v, double value) {
    const unsigned before = MODE_INSTANTIATED | MODE_INITIALIZATION, mode = (unsigned)self->state->mode;
    const unsigned modes = v->role == FMU_INPUT       ? before | MODE_STEP
                           : v->role == FMU_PARAMETER ? before | (v->is_tunable ? (unsigned)MODE_STEP : 0u)
                                                      : 0u;
    if (!modes) return fmu_fail(self, FMU_ERROR, "%s: variable %s is calculated and cannot be set", function, v->name);
    if (!(modes & mode))
        return fmu_fail(self, FMU_ERROR, "%s: variable %s cannot be set in state '%s'", function, v->name,
            fmu_mode_name(self->state->mode));
    if (!isfinite(value))
        return fmu_fail(self, FMU_ERROR, "%s: value %g for %s is not finite", function, value, v->name);
    const bool is_signal = v->role == FMU_INPUT && v->type == FMU_FLOAT64; /* clipped by its component */
    if (!is_signal && !(value >= v->min && value <= v->max))
        return fmu_fail(self, FMU_ERROR, "%s: value %.9g for %s is outside its range [%.9g, %.9g]", function, value,
            v->name, v->min, v->max);
    return FMU_OK;
}

static uint32_t hand_over(FmuInstance *self, const PlanVariable *v, double value) {
    const uint32_t status = component_set(&self->components[v->component], v->kind, v->reference, &value, 1);
    if (status <= fmi3Warning && v->slot >= 0) self->values[v->slot] = value;
    return status;
}

/* The values of number k of the variables that are being set: in its component, or waiting for a tick, NaN if there is
 * none; and as it is shown. */
static void keep_old(FmuInstance *self, const PlanVariable *v, size_t k) {
    Component *m = &self->components[v->component];
    if (!component_later(m, v->reference, &self->old[k], false) &&
        component_get(m, v->kind, v->reference, &self->old[k], 1) > fmi3Warning)
        self->old[k] = NAN;
    if (v->slot >= 0) self->old[(size_t)P->n_variables + k] = self->values[v->slot];
}

static void put_back_old(FmuInstance *self, const PlanVariable *v, size_t k) {
    Component *m = &self->components[v->component];
    if (!component_later(m, v->reference, &self->old[k], true) && !isnan(self->old[k]) &&
        component_set(m, v->kind, v->reference, &self->old[k], 1) > fmi3Warning)
        self->state->mode = MODE_ERROR;
    if (v->slot >= 0) self->values[v->slot] = self->old[(size_t)P->n_variables + k];
}

FmuStatus fmu_set_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     const void *values, size_t count, FmuRead read) {
    FmuStatus status = fmu_check_arrays(self, function, refs, n_refs, values, count);
    if (status == FMU_OK && n_refs != count)
        status = fmu_fail(self, FMU_ERROR, "%s: nValues is %zu, the variables have %zu", function, count, n_refs);
    /* First look at everything, then set it: a call that fails changes nothing. */
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, type, refs[i]);
        status = v ? check_settable(self, function, v, read(values, i)) : FMU_ERROR;
    }
    if (status != FMU_OK) return status;
    /* Before initialization a component tells no values. */
    const bool kept = self->state->mode != MODE_INSTANTIATED && n_refs <= (size_t)P->n_variables;
    size_t done = 0;
    for (; done < n_refs; done++) {
        const PlanVariable *v = &P->variables[refs[done]];
        if (kept) keep_old(self, v, done);
        const uint32_t said = hand_over(self, v, read(values, done));
        if (said <= fmi3Warning) continue;
        status = component_refused(self, v->component, v->name, said);
        break;
    }
    if (status != FMU_OK && kept)
        while (done-- > 0) put_back_old(self, &P->variables[refs[done]], done);
    self->state->settled = 0;
    return status;
}

FmuStatus fmu_set(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                  const double *values, size_t count) {
    return fmu_set_as(self, function, type, refs, n_refs, values, count, read_double);
}

/* ------------------------------------------------------------------ stepping */

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
    if (result == ENGINE_NO_SOLUTION) return not_solved(self);
    if (result == ENGINE_NOT_FINITE) {
        const PlanComponent *p = &P->components[i];
        for (uint32_t k = p->first; k < p->first + p->n_outputs; k++)
            if (!isfinite(self->values[k]))
                return fmu_fail(self, FMU_ERROR, "%s is %g at time %.9g s", P->owners[k], self->values[k],
                                fmu_time(self) + (i < P->n_discrete ? 0.0 : p->step));
    }
    return call_failed(self, i);
}

static int64_t earlier(int64_t a, int64_t b) { return a < b ? a : b; }

/* From the present instant, which has arrived, to the end. Where a component asks for the end after its step, all
 * others go on until that step ends; where it did not take it, only what is left of its sample is done. */
static int run_to(FmuInstance *self, int64_t end) {
    State *const s = self->state;
    Engine *const e = &self->engine;
    bool advances = true, whole = false;
    int result = engine_sample(e, fmu_time(self));
    if (!result) result = engine_advance(e, fmu_time(self));
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
        if (result) return result;
        const int64_t its_end = e->tick + (whole ? e->clocks[stepped.clock].period : 0);
        char text[1024];
        int32_t call = 0;
        if (its_end < s->ending) s->ends_by = culprit_of(self, i, &call, text, sizeof text);
        s->ending = earlier(s->ending, its_end);
        advances &= whole;
        if (i < P->n_discrete) result = engine_sample(e, t);
        if (!result && advances) result = engine_advance(e, t);
    }
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
    e->environment = environment_bits();
    engine_look_up(e, s->tick); /* arrived already */
    FmuStatus status = outcome(self, run_to(self, end));
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

/* ------------------------------------------------------------------ what a system does not offer */

FmuStatus fmu_partial_derivative(FmuInstance *self, const char *function, const FmuPartial *of, double *sensitivity,
    size_t n_sensitivity) {
    (void)of, (void)sensitivity, (void)n_sensitivity;
    return fmu_fail(self, FMU_ERROR, "%s: a system of FMUs offers no partial derivatives", function);
}

static FmuStatus no_model_exchange(FmuInstance *self, const char *function) {
    return fmu_fail(self, FMU_ERROR, "%s: a system of FMUs offers Co-Simulation only", function);
}

FmuStatus fmu_set_time(FmuInstance *self, const char *function, double time) {
    (void)time;
    return no_model_exchange(self, function);
}

FmuStatus fmu_set_states(FmuInstance *self, const char *function, const double *x, size_t n) {
    (void)x, (void)n;
    return no_model_exchange(self, function);
}

FmuStatus fmu_get_states(FmuInstance *self, const char *function, double *x, size_t n) {
    (void)x, (void)n;
    return no_model_exchange(self, function);
}

FmuStatus fmu_get_derivatives(FmuInstance *self, const char *function, double *dx, size_t n) {
    (void)dx, (void)n;
    return no_model_exchange(self, function);
}

FmuStatus fmu_get_nominals(FmuInstance *self, const char *function, double *nominals, size_t n) {
    (void)nominals, (void)n;
    return no_model_exchange(self, function);
}

/* ------------------------------------------------------------------ saved states */

static State *state_in(const void *saved) {
    return (State *)((char *)(uintptr_t)saved + sizeof(Saved) + (size_t)P->n_components * sizeof(void *));
}
static size_t saved_size(void) { return sizeof(Saved) + (size_t)P->n_components * sizeof(void *) + state_size(); }
static uint64_t identity(void) { return fmu_hash(fmu_model.token, strlen(fmu_model.token)); }

static FmuStatus check_can_save(FmuInstance *self, const char *function) {
    return P->can_save
               ? FMU_OK
               : fmu_fail(
                     self, FMU_ERROR, "%s: not all components of %s can save their state", function, fmu_model.name);
}

/* Of a state in memory or, when `bytes`, of a serialized one. */
static FmuStatus check_header_of(FmuInstance *self, const char *function, const void *saved, int bytes) {
    Header h;
    FmuStatus status = check_can_save(self, function);
    if (status != FMU_OK) return status;
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: the FMU state is NULL", function);
    memcpy(&h, saved, sizeof h);
    if (h.magic != STATE_MAGIC || (!bytes && h.checksum != (uint64_t)(uintptr_t)saved))
        return fmu_fail(self, FMU_ERROR, "%s: this is not a state of this FMU", function);
    if (h.version != STATE_VERSION)
        return fmu_fail(self, FMU_ERROR, "%s: state format %u, this FMU reads %u", function, h.version, STATE_VERSION);
    if (h.model != identity() || h.length != state_size())
        return fmu_fail(
            self, FMU_ERROR, "%s: the state belongs to another system or build than %s", function, fmu_model.name);
    return FMU_OK;
}

static FmuStatus check_header(FmuInstance *self, const char *function, const void *saved) {
    return check_header_of(self, function, saved, 0);
}

/* What of a state block cannot be of this system; NULL when there is nothing. */
static const char *wrong_in(const State *s) {
    const unsigned mode = (unsigned)s->mode,
                   modes = MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_STEP | MODE_TERMINATED | MODE_ERROR;
    if (!mode || mode & (mode - 1u) || mode & ~modes) return "its mode";
    if ((s->settled | s->ended) & ~1) return "its flags";
    if (s->tick < 0 || s->tick >= EXACT || s->stop_tick < 0 || s->tick > s->stop_tick) return "its time";
    if (s->ending < s->tick || s->ends_by < 0 || s->ends_by >= P->n_components) return "its end";
    if (!isfinite(s->start) || s->d < 0 || s->d >= EXACT || s->a < 0 || s->a >= EXACT || s->b <= -EXACT ||
        s->b >= EXACT)
        return "its start time";
    if ((mode == MODE_STEP || mode == MODE_TERMINATED) &&
        (!s->d || !s->a || !((double)s->tick * (double)s->a + fabs((double)s->b) < (double)EXACT)))
        return "its start time";
    if (s->d && (s->d % P->d || s->a != P->a * (s->d / P->d) || (double)s->b / (double)s->d != s->start))
        return "its start time";
    if (mode == MODE_STEP)
        for (uint32_t k = 0; k < P->n_values + P->n_u; k++)
            if (!isfinite(s->v[k])) return k < P->n_values ? P->owners[k] : "an input of a component";
    return NULL;
}

static void forget_components(FmuInstance *self, Saved *saved) {
    for (int32_t i = 0; i < P->n_components; i++)
        if (saved->components[i] && !self->components[i].dead)
            (void)component_forget(&self->components[i], &saved->components[i]);
}

static FmuStatus check_alive(FmuInstance *self, const char *function) {
    for (int32_t i = 0; i < P->n_components; i++)
        if (self->components[i].dead)
            return fmu_fail(
                self, FMU_ERROR, "%s: component '%s' has failed permanently", function, P->components[i].name);
    return FMU_OK;
}

FmuStatus fmu_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    FmuStatus status = check_can_save(self, function);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status == FMU_OK && !snapshot) status = fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (status == FMU_OK && *snapshot) status = check_header(self, function, *snapshot);
    if (status != FMU_OK) return status;
    Saved *saved = *snapshot ? *snapshot : calloc(1, saved_size());
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    for (int32_t i = 0; i < P->n_components; i++) {
        const uint32_t said = component_save(&self->components[i], &saved->components[i]);
        if (said <= fmi3Warning) continue;
        if (!*snapshot) {
            forget_components(self, saved);
            free(saved);
        }
        return component_refused(self, i, "GetFMUState", said);
    }
    saved->header = (Header){.magic = STATE_MAGIC,
        .version = STATE_VERSION,
        .model = identity(),
        .length = state_size(),
        .checksum = (uint64_t)(uintptr_t)saved};
    memcpy(state_in(saved), self->state, state_size());
    *snapshot = saved;
    return FMU_OK;
}

FmuStatus fmu_restore(FmuInstance *self, const char *function, const void *snapshot) {
    FmuStatus status = check_header(self, function, snapshot);
    if (status == FMU_OK) status = check_alive(self, function);
    const char *wrong = status == FMU_OK ? wrong_in(state_in(snapshot)) : NULL;
    if (wrong)
        status = fmu_fail(self, FMU_ERROR, "%s: this cannot be a state of %s: %s", function, fmu_model.name, wrong);
    const Saved *saved = snapshot;
    for (int32_t i = 0; i < P->n_components && status == FMU_OK; i++) {
        const uint32_t said = component_restore(&self->components[i], saved->components[i]);
        if (said > fmi3Warning)
            status = component_failed(self, i, "SetFMUState", said); /* components before it have been restored */
    }
    if (status != FMU_OK) return status;
    memcpy(self->state, state_in(snapshot), state_size());
    status = bind(self);
    repeat_steps(self);
    return status;
}

FmuStatus fmu_free_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    if (!snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (!*snapshot) return FMU_OK;
    const FmuStatus status = check_header(self, function, *snapshot);
    if (status != FMU_OK) return status;
    forget_components(self, *snapshot);
    free(*snapshot);
    *snapshot = NULL;
    return FMU_OK;
}

/* Bytes: header, state block, and for each component the number of its bytes and these. */
FmuStatus fmu_serialized_size(FmuInstance *self, const char *function, const void *snapshot, size_t *size) {
    FmuStatus status = check_header(self, function, snapshot);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status == FMU_OK && !size) status = fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (status != FMU_OK) return status;
    const Saved *saved = snapshot;
    size_t total = sizeof(Header) + state_size();
    for (int32_t i = 0; i < P->n_components; i++) {
        size_t own = 0;
        const uint32_t said = component_size(&self->components[i], saved->components[i], &own);
        if (said > fmi3Warning) return component_refused(self, i, "SerializedFMUStateSize", said);
        total += sizeof(uint64_t) + own;
    }
    *size = total;
    return FMU_OK;
}

FmuStatus fmu_serialize(
    FmuInstance *self, const char *function, const void *snapshot, unsigned char *bytes, size_t size) {
    size_t need = 0;
    FmuStatus status = fmu_serialized_size(self, function, snapshot, &need);
    if (status != FMU_OK) return status;
    if (!bytes || size < need)
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are too few, need %zu", function, bytes ? size : 0, need);
    const Saved *saved = snapshot;
    unsigned char *to = bytes + sizeof(Header);
    memcpy(to, state_in(snapshot), state_size());
    to += state_size();
    for (int32_t i = 0; i < P->n_components; i++) {
        size_t own = 0;
        uint32_t said = component_size(&self->components[i], saved->components[i], &own);
        const uint64_t length = own;
        memcpy(to, &length, sizeof length);
        to += sizeof length;
        if (said <= fmi3Warning) said = component_serialize(&self->components[i], saved->components[i], to, own);
        if (said > fmi3Warning) return component_refused(self, i, "SerializeFMUState", said);
        to += own;
    }
    Header h = saved->header;
    h.components = need - sizeof(Header) - state_size();
    h.checksum = fmu_hash(bytes + sizeof(Header), need - sizeof(Header));
    memcpy(bytes, &h, sizeof h);
    return FMU_OK;
}

FmuStatus fmu_deserialize(
    FmuInstance *self, const char *function, const unsigned char *bytes, size_t size, void **snapshot) {
    if (!bytes || !snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (size < sizeof(Header))
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are not a serialized state", function, size);
    FmuStatus status = check_header_of(self, function, bytes, 1);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status != FMU_OK) return status;
    Header h;
    memcpy(&h, bytes, sizeof h);
    if (size - sizeof h < state_size() || h.components != size - sizeof h - state_size() ||
        h.checksum != fmu_hash(bytes + sizeof h, size - sizeof h))
        return fmu_fail(self, FMU_ERROR, "%s: the serialized state of %s is damaged", function, fmu_model.name);
    Saved *saved = calloc(1, saved_size());
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    saved->header = (Header){.magic = h.magic, .version = h.version, .model = h.model, .length = h.length,
                             .checksum = (uint64_t)(uintptr_t)saved};
    memcpy(state_in(saved), bytes + sizeof h, state_size());
    const unsigned char *from = bytes + sizeof h + state_size(), *end = bytes + size;
    const char *wrong = wrong_in(state_in(saved));
    if (wrong)
        status = fmu_fail(self, FMU_ERROR, "%s: this cannot be a state of %s: %s", function, fmu_model.name, wrong);
    for (int32_t i = 0; i < P->n_components && status == FMU_OK; i++) {
        uint64_t own = 0;
        if ((size_t)(end - from) >= sizeof own) memcpy(&own, from, sizeof own);
        if ((size_t)(end - from) < sizeof own || own > (uint64_t)(end - from) - sizeof own) {
            status = fmu_fail(self, FMU_ERROR, "%s: the serialized state of %s is damaged", function, fmu_model.name);
            break;
        }
        const uint32_t said =
            component_deserialize(&self->components[i], from + sizeof own, (size_t)own, &saved->components[i]);
        if (said > fmi3Warning) status = component_refused(self, i, "DeserializeFMUState", said);
        from += sizeof own + own;
    }
    if (status == FMU_OK) {
        *snapshot = saved;
        return FMU_OK;
    }
    forget_components(self, saved);
    free(saved);
    return status;
}
