/* Components with clocks: see component.h. */
#include <stdlib.h>
#include <string.h>

#include "clocked_steps.h"
#include "component.h"
#include "fmu_math.h"
#include "system.h"

static ClockedFmu *fmu_of(const Component *m) { return m->integrator; }

/* What the engine calls, behind the memory of the steps. */
static EngineTransfer *ports_of(const Component *m) {
    return (EngineTransfer *)(void *)((char *)m->integrator + clocked_calls.size(m->setup));
}

static bool make(Component *m, const char *name, const char *token, const char *resources) {
    const ClockedSetup *const setup = m->setup;
    m->instance = m->f3->InstantiateCoSimulation(
        name, token, resources, false, false, true, setup->returns_early, NULL, 0, m, m->say, NULL);
    m->integrator = calloc(1, clocked_calls.size(setup) + 2 * sizeof(EngineTransfer));
    if (!m->instance || !m->integrator) return false;
    ClockedFmu *const f = clocked_calls.make(m->integrator, setup, m->instance);
    f->owner = m;
    for (uint32_t i = 0; i < CLOCKED_VALUES; i++) {
        const ExchangeCall call = m->find(m->library, m->version, clocked_calls.function(i));
        memcpy(&f->call[i], &call, sizeof call);
    }
    m->memory[0] = (ComponentMemory){&f->memory, sizeof f->memory};
    m->memory[1] = (ComponentMemory){f->due, (size_t)((char *)(f->values.y + setup->n_y) - (char *)f->due)};
    return true;
}

static uint32_t leave(Component *m) { return clocked_calls.intervals(fmu_of(m), m->begin); }

static uint32_t begin(Component *m) {
    ClockedNetwork *const n = fmu_of(m)->network;
    return n->n_fmus > 1 ? (uint32_t)fmi3OK : clocked_calls.begin(n);
}

static void bind(Component *m, bool stepping) {
    ClockedFmu *const f = fmu_of(m);
    f->stepping = stepping;
    f->arrived = false;
    f->network->report = (ClockedReport){0};
}

static void values(const Component *m, double **u, double **y) {
    *u = fmu_of(m)->values.u;
    *y = fmu_of(m)->values.y;
}

static void attach(Component *m, EngineComponent *e, uint32_t n_inputs) {
    ClockedFmu *const f = fmu_of(m);
    EngineTransfer *const ports = ports_of(m);
    const uint32_t *const first = (const uint32_t *)(const void *)f;
    f->sets = e->sets;
    f->gets = e->gets;
    f->shown = e->y;
    f->flags = e->flags;
    f->last = e->last;
    f->foreign = e->foreign;
    ports[0] = (EngineTransfer){.call3 = clocked_calls.set, .references = first, .data = e->u, .n_data = n_inputs};
    ports[1] = (EngineTransfer){.call3 = clocked_calls.get, .references = first, .data = e->y, .n_data = e->n_outputs};
    e->sets = &ports[0];
    e->gets = &ports[1];
    e->n_sets = n_inputs > 0;
    e->n_gets = e->n_outputs > 0;
}

static uint32_t change(Component *m, bool begins, bool done) {
    ClockedFmu *const f = fmu_of(m);
    if (!f->stepping) return fmi3OK;
    f->tuned = done;
    return begins ? clocked_calls.enter(f) : clocked_calls.leave(f);
}

static bool later(Component *m, uint32_t reference, double *value, bool set) {
    ClockedFmu *const f = fmu_of(m);
    for (uint32_t i = 0; i < f->setup->n_inputs && f->stepping; i++) {
        const ClockedGroup *const g = &f->setup->inputs[i];
        const EngineTransfer *const t = &f->sets[g->first];
        if (g->waits < 0 || t->references[0] != reference) continue;
        double *const waiting = t->place ? &f->values.u[t->place[0]] : (double *)t->data;
        double *const waits = &f->values.u[g->waits];
        if (set) {
            *waiting = *value;
            *waits = !isnan(*value);
        } else {
            *value = *waits != 0.0 ? *waiting : NAN;
        }
        return true;
    }
    return false;
}

static bool why(const Component *m, double *time, char *text, size_t size) { /* `culprit` has the text */
    (void)size, *text = 0;
    *time = fmu_of(m)->memory.now;
    return fmu_of(m)->network->report.end != CLOCKED_TERMINATED;
}

static Component *culprit(const Component *m, int32_t *call, char *text, size_t size) {
    const ClockedReport *const r = &fmu_of(m)->network->report;
    clocked_calls.why(fmu_of(m)->network, text, size);
    if (r->end == CLOCKED_CALL_FAILED && r->function == CLOCKED_VALUES) *call = r->call;
    return r->fmu ? r->fmu->owner : fmu_of(m)->owner;
}

static uint32_t step(
    void *fmu, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    return clocked_calls.step(fmu, t, h, no_set_prior, event, terminate, early, last);
}

static uint32_t changed(const Component *m) { return fmu_of(m)->changed; }

const Exchange clocks = {
    make, begin, bind, NULL, change, why, NULL, step, leave, values, attach, later, culprit, changed};

static size_t room(const PlanNetwork *p) {
    return sizeof(ClockedNetwork) + 4 * (size_t)p->n_components * sizeof(ClockedFmu *);
}

static void join(Component *components, const PlanNetwork *p, void *memory) {
    ClockedNetwork *const n = memory;
    ClockedFmu **const fmus = (ClockedFmu **)(n + 1);
    n->ticks = p->ticks;
    n->n_ticks = p->n_ticks;
    n->wires = p->wires;
    n->n_wires = p->n_wires;
    for (int32_t i = 0; i < p->n_components; i++) fmus[i] = fmu_of(&components[p->components[i]]);
    clocked_calls.join(n, fmus, p->n_components);
}

static uint32_t begin_network(void *memory) { return clocked_calls.begin(memory); }

const Networks networks = {room, join, begin_network};
