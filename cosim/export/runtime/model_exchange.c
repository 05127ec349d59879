/* Components that the system integrates (Model Exchange): see component.h. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "integrator.h"

typedef fmi3InstantiateModelExchangeTYPE *Instantiate3;

static bool make(Component *m, const char *name, const char *token, const char *resources) {
    const IntegratorSetup *const setup = m->setup;
    void *calls[EXCHANGE_CALLS] = {NULL};
    for (uint32_t i = 0; i < EXCHANGE_CALLS; i++) {
        const char *const found = i < INTEGRATOR_FUNCTIONS ? integrator_function((uint32_t)m->version, i)
                                                           : "InstantiateModelExchange";
        if (!found) continue;
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
    if (!m->integrator || !integrator_make(m->integrator, setup, m->references, m->instance, calls)) return false;
    m->memory[0] = (ComponentMemory){&((Integrator *)m->integrator)->memory, sizeof(IntegratorMemory)};
    return true;
}

static uint32_t begin(Component *m) { return integrator_begin(m->integrator, m->begin); }

static bool why(const Component *m, double *time, char *text, size_t size) {
    const Integrator *const s = m->integrator;
    *time = s->report.time;
    integrator_why(&s->setup, &s->report, NULL, text, size);
    return s->report.end != INTEGRATOR_TERMINATED;
}

const Exchange exchange = {make, begin, NULL, NULL, NULL, why, integrator_step2, integrator_step3};
