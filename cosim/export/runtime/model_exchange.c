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

static const char *why(const Component *m, uint32_t *number, double *time) {
    static const char *const texts[] = {"the call of a function failed, number", "a function failed, number",
        "a state is NaN or infinite, number", "a derivative is NaN or infinite, that of state number",
        "an event indicator is NaN or infinite, number",
        "the error exceeds the tolerance even with the smallest step, that of state number",
        "too many steps of the integrator in one communication step", "event iteration did not converge",
        "too many events in one communication step", "the next time event is at NaN", NULL};
    const IntegratorReport *const r = &((const Integrator *)m->integrator)->report;
    *number = r->index + 1;
    *time = r->time;
    return r->end < sizeof texts / sizeof *texts ? texts[r->end] : texts[0];
}

const Exchange exchange = {make, begin, NULL, NULL, NULL, why, integrator_step2, integrator_step3};
