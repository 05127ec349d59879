/* The integrator and the models of exchanged.c under sanitizers: every model, by every method, in steps of many
 * lengths, with the memory of the integrator replaced by arbitrary bytes now and then. Prints what happened. */
#include "../foreign/exchanged.c"
#include "integrator.h"

#include <stdio.h>

#define ADDRESS(name) (void *)F(name)

static uint64_t seed = 1;
static double chance(void) {
    seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(seed >> 11) * 0x1p-53;
}

int main(void) {
    const uint32_t references[4] = {X, V, DX, DV};
    void *calls[INTEGRATOR_FUNCTIONS] = {ADDRESS(SetTime), ADDRESS(SetContinuousStates), ADDRESS(GetContinuousStates),
#if FMI == 2
        ADDRESS(GetDerivatives), ADDRESS(GetEventIndicators), ADDRESS(GetNominalsOfContinuousStates),
        ADDRESS(EnterEventMode), ADDRESS(NewDiscreteStates), ADDRESS(EnterContinuousTimeMode),
#else
        ADDRESS(GetContinuousStateDerivatives), ADDRESS(GetEventIndicators), ADDRESS(GetNominalsOfContinuousStates),
        ADDRESS(EnterEventMode), ADDRESS(UpdateDiscreteStates), ADDRESS(EnterContinuousTimeMode),
#endif
        ADDRESS(CompletedIntegratorStep)};
    unsigned done = 0, failed = 0;
    for (uint32_t method = 0; method < 3; method++)
        for (int model = 0; model <= 14; model++)
            for (int hostile = 0; hostile < 2; hostile++) {
                const IntegratorSetup setup = {.version = FMI, .method = method, .n = 2, .n_indicators = 1,
                    .n_references = 2, .completed = 1, .tolerance = 1e-5};
                Model m;
                start(&m);
                m.value[KIND] = model;
                m.value[K] = 20.0;
                m.in_event = true;
                void *memory = malloc(integrator_size(&setup));
                Integrator *s = integrator_make(memory, &setup, references, &m, calls);
                uint32_t status = integrator_begin(s, 0.0);
                for (double t = 0.0, h; status < 2 && t < 1.2; t += h) {
                    h = 1e-6 + 0.1 * chance() * chance();
                    if (hostile && chance() < 0.2)
                        for (size_t i = 0; i < sizeof s->memory; i++)
                            if (chance() < 0.3) ((unsigned char *)&s->memory)[i] = (unsigned char)(256.0 * chance());
                    status = integrator_step2(s, t, h, 1);
                    if (!hostile && status < 2 && fabs(s->memory.time - (t + h)) > 1e-12) return 1;
                    done++;
                }
                failed += status > 1;
                if (status > 1 && s->report.end == INTEGRATOR_FINE) return 2;
                free(memory);
            }
    printf("%u steps, %u failures\n", done, failed);
    return 0;
}
