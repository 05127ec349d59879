/* Components that the system integrates (Model Exchange): see component.h. */
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "integrator.h"

/* Function number `i` of the FMU, or NULL. */
static ExchangeCall function(const Component *m, uint32_t i, const char *name) {
    return m->linked ? m->linked[i] : m->find(m->library, m->version, name);
}

static bool make(Component *m, const char *name, const char *token, const char *resources) {
    const IntegratorSetup *const setup = m->setup;
    void *calls[INTEGRATOR_FUNCTIONS] = {NULL};
    for (uint32_t i = 0; i < INTEGRATOR_FUNCTIONS; i++) {
        const char *const found = integrator_function((uint32_t)m->version, i);
        const ExchangeCall call = found ? function(m, i, found) : NULL;
        memcpy(&calls[i], &call, sizeof call);
        if (found && !call && integrator_needs(setup, i)) return false;
    }
    if (m->version == 3) {
        const ExchangeCall call = function(m, INTEGRATOR_FUNCTIONS, "InstantiateModelExchange");
        if (!call) return false;
        m->instance = ((fmi3InstantiateModelExchangeTYPE *)call)(name, token, resources, false, false, m, m->say);
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
