/* Memory and life of a system, and the functions of fmu_core.h that it does not offer: see container.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "container.h"
#include "environment.h"

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }

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

void *container_network(const FmuInstance *self, int32_t i) { return (char *)self->networks + networks_room(i); }

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
        aligned(P->n_passed * sizeof(uint64_t)),
        networks_room(P->n_connected),
        aligned((size_t)P->n_variables * sizeof(char *)),
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
        m->log = container_log;
        m->context = &sources[i];
    }
    self->engine = (Engine){.values = self->values, .components = self->bound, .n_components = P->n_components,
                            .n_discrete = P->n_discrete, .clocks = P->clocks, .n_clocks = P->n_clocks, .next = part[11],
                            .due = part[12], .list = part[13], .published = part[14], .computed = part[15],
                            .loops = part[17], .n_loops = P->n_running, .n_late = P->n_late,
                            .n_initial = P->n_loops - P->n_running - P->n_late,
                            .followers = P->followers, .n_followers = P->n_followers,
                            .check_finite = true, .back = container_repeat, .context = self};
    self->repeated = part[20];
    self->texts = part[21];
    self->passed = part[22];
    self->networks = part[23];
    self->shown = part[24];
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

/* The start values that the system gives. */
static FmuStatus set_starts(FmuInstance *self, int32_t i) {
    const PlanComponent *p = &P->components[i];
    for (uint32_t k = 0; k < p->n_starts; k++) {
        const PlanStart *s = &p->starts[k];
        Component *m = &self->components[i];
        const uint32_t status = s->text    ? component_set_text(m, s->reference, s->text)
                                : s->bytes ? component_set_bytes(m, s->reference, s->bytes, s->n)
                                : s->wide  ? component_move_wide(
                                              m, s->kind, s->reference, (uint64_t *)(uintptr_t)s->wide, s->n, true)
                                           : component_set(m, s->kind, s->reference, s->values, s->n);
        if (status > fmi3Warning) return container_failed(self, i, "setting a start value", status);
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
            m->environment = environment_bits();
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
        P->networks->join(self->components, &P->connected[i], container_network(self, i));
    return FMU_OK;
}

void fmu_free(FmuInstance *self) {
    for (int32_t i = P->n_components - 1; i >= 0; i--) {
        container_forget_last(self, i);
        component_free(&self->components[i]);
    }
    for (int32_t i = 0; i < P->n_variables; i++) free(self->shown[i]);
    free(self);
}

void fmu_set_mode(FmuInstance *self, FmuMode mode) {
    if (mode == MODE_TERMINATED && self->state->mode == MODE_STEP)
        for (int32_t i = 0; i < P->n_components; i++) {
            Component *m = &self->components[i];
            const uint32_t status = m->dead ? (uint32_t)fmi3OK : component_terminate(m);
            if (status > fmi3Warning)
                (void)fmu_fail(self, FMU_WARNING, "component '%s': fmi%dTerminate returned %s; the results of the run "
                    "are complete, but files that the FMU writes at its end may not be",
                    P->components[i].name, m->version, container_status(status));
        }
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
        container_forget_last(self, i);
        const uint32_t status = component_reset(&self->components[i]);
        if (status > fmi3Warning) return container_failed(self, i, "Reset", status);
        if (set_starts(self, i) != FMU_OK) return FMU_ERROR;
    }
    return FMU_OK;
}

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
