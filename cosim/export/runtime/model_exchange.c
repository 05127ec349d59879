/* Components that the system integrates (Model Exchange), and what is saved of their integrators: see component.h. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "integrator.h"

#define CALL(two, three) ((uint32_t)(m->version == 2 ? m->f2->two : m->f3->three))

typedef fmi3InstantiateModelExchangeTYPE *Instantiate3;

typedef struct {
    void *state;
    IntegratorMemory memory;
} Saved;

static bool make(Component *m, const char *name, const char *token, const char *resources) {
    const IntegratorSetup *const setup = m->setup;
    void *calls[EXCHANGE_CALLS] = {NULL};
    for (uint32_t i = 0; i < EXCHANGE_CALLS; i++) {
        const char *const found = i < INTEGRATOR_FUNCTIONS ? integrator_function((uint32_t)m->version, i)
                                                           : "InstantiateModelExchange";
        const ExchangeCall call = m->linked ? m->linked[i] : m->find(m->library, m->version, found);
        memcpy(&calls[i], &call, sizeof call);
        if (i < INTEGRATOR_FUNCTIONS && !call && integrator_needs(setup, i)) return false;
    }
    if (m->version == 3) {
        Instantiate3 instantiate;
        memcpy(&instantiate, &calls[INTEGRATOR_FUNCTIONS], sizeof instantiate);
        if (!instantiate) return false;
        m->instance = instantiate(name, token, resources, false, false, m, m->say);
    }
    if (!m->instance) return false;
    m->integrator = malloc(integrator_size(setup));
    return m->integrator && integrator_make(m->integrator, setup, m->references, m->instance, calls);
}

static uint32_t begin(Component *m) { return integrator_begin(m->integrator, m->begin); }

static uint32_t save(Component *m, void **state) {
    Saved *const s = *state ? *state : calloc(1, sizeof *s);
    if (!s) return fmi3Error;
    const uint32_t status = CALL(GetFMUstate(m->instance, &s->state), GetFMUState(m->instance, &s->state));
    s->memory = ((const Integrator *)m->integrator)->memory;
    if (status > fmi3Warning && !*state) free(s);
    else *state = s;
    return status;
}

static uint32_t restore(Component *m, const void *state) {
    const Saved *const s = state;
    ((Integrator *)m->integrator)->memory = s->memory;
    return CALL(SetFMUstate(m->instance, s->state), SetFMUState(m->instance, s->state));
}

static uint32_t forget(Component *m, void **state) {
    Saved *const s = *state;
    const uint32_t status = CALL(FreeFMUstate(m->instance, &s->state), FreeFMUState(m->instance, &s->state));
    free(s);
    *state = NULL;
    return status;
}

static uint32_t size_of_state(Component *m, const void *state, size_t *size) {
    void *const own = ((const Saved *)state)->state;
    const uint32_t status =
        CALL(SerializedFMUstateSize(m->instance, own, size), SerializedFMUStateSize(m->instance, own, size));
    *size += sizeof(IntegratorMemory);
    return status;
}

static uint32_t serialize(Component *m, const void *state, unsigned char *bytes, size_t size) {
    const Saved *const s = state;
    const size_t own = size - sizeof s->memory;
    memcpy(bytes + own, &s->memory, sizeof s->memory);
    return CALL(SerializeFMUstate(m->instance, s->state, (fmi2Byte *)bytes, own),
        SerializeFMUState(m->instance, s->state, bytes, own));
}

static uint32_t deserialize(Component *m, const unsigned char *bytes, size_t size, void **state) {
    Saved *const s = size < sizeof s->memory ? NULL : calloc(1, sizeof *s);
    if (!s) return fmi3Error;
    const size_t own = size - sizeof s->memory;
    memcpy(&s->memory, bytes + own, sizeof s->memory);
    const uint32_t status = CALL(DeSerializeFMUstate(m->instance, (const fmi2Byte *)bytes, own, &s->state),
        DeserializeFMUState(m->instance, bytes, own, &s->state));
    if (status > fmi3Warning) free(s);
    else *state = s;
    return status;
}

static const char *why(const Component *m, uint32_t *number, double *time) {
    static const char *const texts[] = {"the call of a function failed, number", "a function failed, number",
        "a state is NaN or infinite, number", "a derivative is NaN or infinite, that of state number",
        "an event indicator is NaN or infinite, number",
        "the error exceeds the tolerance even with the smallest step, that of state number",
        "too many steps of the integrator in one communication step", "event iteration did not converge",
        "too many events in one communication step", NULL};
    const IntegratorReport *const r = &((const Integrator *)m->integrator)->report;
    *number = r->index + 1;
    *time = r->time;
    return r->end < sizeof texts / sizeof *texts ? texts[r->end] : texts[0];
}

const Exchange exchange = {make, begin, save, restore, forget, size_of_state, serialize, deserialize, why,
    integrator_step2, integrator_step3};
