/* The functions of FMI 3.0 that the examples of this folder share: Co-Simulation with event mode.
 *
 * An FMU defines the type `Values` before this file, and behind it
 *     static void start(Values *v)                                  values at the begin
 *     static void *address(Values *v, fmi3ValueReference r)         where the variable with this value reference is
 *     static size_t count(const Values *v, fmi3ValueReference r)    how many elements it has
 *     static void step(Model *m, double h, bool *event, double *h_done)   a step from m->now
 *     static void enter(Values *v, double now)                      begin of an event: output clocks may tick
 *     static double update(Values *v, double now)                   the discrete states; returns when the next event is
 */
#ifndef SMALL_FMU_H
#define SMALL_FMU_H

#include "bytes.h"
#include "fmi3Functions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    Values v;
    double now;
    bool early; /* a step may end early */
    fmi3IntermediateUpdateCallback update; /* NULL: nobody sets inputs inside a step */
    fmi3InstanceEnvironment environment;
} Model;

static void start(Values *v);
static void *address(Values *v, fmi3ValueReference r);
static size_t count(const Values *v, fmi3ValueReference r);
static void step(Model *m, double h, bool *event, double *h_done);
static void enter(Values *v, double now);
static double update(Values *v, double now);

#define M ((Model *)instance)
#define MODE(NAME, DO) \
    fmi3Status fmi3##NAME(fmi3Instance instance) { DO; return fmi3OK; }

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean log, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message, fmi3IntermediateUpdateCallback intermediate) {
    Model *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->early = early;
    m->update = intermediate;
    m->environment = environment;
    start(&m->v);
    return m;
}
void fmi3FreeInstance(fmi3Instance instance) { free(instance); }
fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean a, double tolerance, double begin, fmi3Boolean b, double end) {
    M->now = begin;
    return fmi3OK;
}
MODE(ExitInitializationMode, )
MODE(EnterConfigurationMode, )
MODE(ExitConfigurationMode, )
MODE(EnterEventMode, enter(&M->v, M->now))
MODE(EnterStepMode, )
MODE(Terminate, )
MODE(Reset, memset(&M->v, 0, sizeof(Values)); start(&M->v))

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *has_next, double *next) {
    *again = *terminate = *nominals = *values = false;
    *next = update(&M->v, M->now);
    *has_next = isfinite(*next);
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance instance, double t, double h, fmi3Boolean no_set_prior, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, double *last) {
    double done = h;
    M->now = t;
    *event = *terminate = false;
    step(M, h, event, &done);
    *early = done < h;
    M->now = *last = t + done;
    return fmi3OK;
}

#define ACCESS(NAME, TYPE)                                                                              \
    fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, TYPE value[], size_t k) { \
        for (size_t i = 0; i < n; value += count(&M->v, vr[i++]))                                       \
            memcpy(value, address(&M->v, vr[i]), count(&M->v, vr[i]) * sizeof(TYPE));                   \
        return fmi3OK;                                                                                  \
    }                                                                                                   \
    fmi3Status fmi3Set##NAME(                                                                           \
        fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const TYPE value[], size_t k) { \
        for (size_t i = 0; i < n; value += count(&M->v, vr[i++]))                                       \
            memcpy(address(&M->v, vr[i]), value, count(&M->v, vr[i]) * sizeof(TYPE));                   \
        return fmi3OK;                                                                                  \
    }
ACCESS(Float64, double)
ACCESS(Int32, int32_t)
ACCESS(UInt32, uint32_t)
ACCESS(UInt64, uint64_t)
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock value[]) {
    for (size_t i = 0; i < n; i++) value[i] = *(bool *)address(&M->v, vr[i]);
    return fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[]) {
    for (size_t i = 0; i < n; i++) *(bool *)address(&M->v, vr[i]) = value[i];
    return fmi3OK;
}
fmi3Status fmi3GetBinary(
    fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[], size_t k) {
    for (size_t i = 0; i < n; i++) {
        const Bytes *b = address(&M->v, vr[i]);
        sizes[i] = b->size;
        values[i] = b->data;
    }
    return fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
    const fmi3Binary values[], size_t k) {
    for (size_t i = 0; i < n; i++) {
        Bytes *b = address(&M->v, vr[i]);
        if (sizes[i] > sizeof b->data) return fmi3Error;
        b->size = sizes[i];
        if (b->size) memcpy(b->data, values[i], b->size);
    }
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    if (!*state) *state = malloc(sizeof(Model));
    if (!*state) return fmi3Error;
    memcpy(*state, instance, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    memcpy(instance, state, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    free(*state);
    *state = NULL;
    return fmi3OK;
}

#endif
