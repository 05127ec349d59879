/* A small FMU that owes nothing to this project but its descriptions (followers.py): FMI 2.0 or 3.0, from the
 * standard's headers alone.
 *
 * y follows u, dy/dt = rate (u - y), by implicit Euler with steps of 0.1 ms at most, as exported models do. Variables
 * of other types are handed through, so that every type is exchanged; `count` also counts steps, and `total` (FMI 3.0)
 * is an array that adds up the array `w`. With a negative rate reading a floating-point number is an error, below -1 a
 * fatal one. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi2Functions.h"
typedef fmi2Component Instance;
typedef fmi2Status Status;
typedef fmi2Boolean Flag;
#else
#include "fmi3Functions.h"
typedef fmi3Instance Instance;
typedef fmi3Status Status;
typedef fmi3Boolean Flag;
#endif

enum {
    U,
    Y,
    RATE,
    COUNT_IN,
    COUNT,
    ON,
    OFF,
    W,
    TOTAL,
    SMALL
}; /* value references; SMALL + 2 i and + 1: type i in and out */

typedef struct {
    double real[3], w[3], total[3];
    int32_t count_in, steps;
    bool on;
    float f32;
    int8_t i8;
    uint8_t u8;
    int16_t i16;
    uint16_t u16;
    uint32_t u32;
    int64_t i64;
    uint64_t u64;
} Model;

static void start(Model *m) {
    memset(m, 0, sizeof *m);
    m->real[RATE] = 1.0;
}

static void advance(Model *m, double h) {
    const int n = h > 1e-4 ? (int)(h / 1e-4 + 0.5) : 1;
    for (int i = 0; i < n; i++) {
        const double a = h / n * m->real[RATE];
        m->real[Y] = (m->real[Y] + a * m->real[U]) / (1.0 + a);
    }
    for (int i = 0; i < 3; i++) m->total[i] += h * m->w[i];
    m->steps++;
}

static void *copy_of(const Model *m, void *old) {
    void *state = old ? old : malloc(sizeof *m);
    if (state) memcpy(state, m, sizeof *m);
    return state;
}

#if FMI == 2
const char *fmi2GetVersion(void) { return fmi2Version; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean log) {
    Model *m = malloc(sizeof *m);
    if (m) start(m);
    return m;
}
void fmi2FreeInstance(Instance m) { free(m); }
Status fmi2SetDebugLogging(Instance m, Flag on, size_t n, const fmi2String categories[]) { return fmi2OK; }
Status fmi2SetupExperiment(Instance m, Flag a, double tolerance, double begin, Flag b, double end) { return fmi2OK; }
Status fmi2EnterInitializationMode(Instance m) { return fmi2OK; }
Status fmi2ExitInitializationMode(Instance m) { return fmi2OK; }
Status fmi2Terminate(Instance m) { return fmi2OK; }
Status fmi2Reset(Instance m) { start(m); return fmi2OK; }
Status fmi2GetReal(Instance c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    const Model *m = c;
    if (m->real[RATE] < 0.0) return m->real[RATE] < -1.0 ? fmi2Fatal : fmi2Error;
    for (size_t i = 0; i < n; i++) value[i] = m->real[vr[i]];
    return fmi2OK;
}
Status fmi2SetReal(Instance c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) m->real[vr[i]] = value[i];
    return fmi2OK;
}
Status fmi2GetInteger(Instance c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    const Model *m = c;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == COUNT ? m->count_in + m->steps : m->count_in;
    return fmi2OK;
}
Status fmi2SetInteger(Instance c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->count_in = value[i];
    return fmi2OK;
}
Status fmi2GetBoolean(Instance c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) value[i] = (vr[i] == OFF) != ((const Model *)c)->on;
    return fmi2OK;
}
Status fmi2SetBoolean(Instance c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->on = value[i] != 0;
    return fmi2OK;
}
Status fmi2GetFMUstate(Instance m, fmi2FMUstate *state) { return (*state = copy_of(m, *state)) ? fmi2OK : fmi2Error; }
Status fmi2SetFMUstate(Instance m, fmi2FMUstate state) { memcpy(m, state, sizeof(Model)); return fmi2OK; }
Status fmi2FreeFMUstate(Instance m, fmi2FMUstate *state) { free(*state); *state = NULL; return fmi2OK; }
Status fmi2SerializedFMUstateSize(Instance m, fmi2FMUstate state, size_t *size) {
    *size = sizeof(Model);
    return fmi2OK;
}
Status fmi2SerializeFMUstate(Instance m, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    memcpy(bytes, state, sizeof(Model));
    return fmi2OK;
}
Status fmi2DeSerializeFMUstate(Instance m, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return size == sizeof(Model) && (*state = copy_of((const void *)bytes, *state)) ? fmi2OK : fmi2Error;
}
Status fmi2DoStep(Instance m, fmi2Real t, fmi2Real h, fmi2Boolean no_set_prior) { advance(m, h); return fmi2OK; }
Status fmi2GetRealStatus(Instance m, const fmi2StatusKind kind, fmi2Real *value) { return fmi2Discard; }
Status fmi2GetBooleanStatus(Instance m, const fmi2StatusKind kind, fmi2Boolean *value) { return fmi2Discard; }
#else
const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean log, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message, fmi3IntermediateUpdateCallback update) {
    Model *m = malloc(sizeof *m);
    if (m) start(m);
    return m;
}
void fmi3FreeInstance(Instance m) { free(m); }
Status fmi3SetDebugLogging(Instance m, Flag on, size_t n, const fmi3String categories[]) { return fmi3OK; }
Status fmi3EnterInitializationMode(Instance m, Flag a, double tolerance, double begin, Flag b, double end) {
    return fmi3OK;
}
Status fmi3ExitInitializationMode(Instance m) { return fmi3OK; }
Status fmi3Terminate(Instance m) { return fmi3OK; }
Status fmi3Reset(Instance m) { start(m); return fmi3OK; }
Status fmi3GetFloat64(Instance c, const fmi3ValueReference vr[], size_t n, double value[], size_t k) {
    const Model *m = c;
    if (m->real[RATE] < 0.0) return m->real[RATE] < -1.0 ? fmi3Fatal : fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 3) *value++ = m->real[vr[i]];
        else for (int j = 0; j < 3; j++) *value++ = (vr[i] == W ? m->w : m->total)[j];
    }
    return fmi3OK;
}
Status fmi3SetFloat64(Instance c, const fmi3ValueReference vr[], size_t n, const double value[], size_t k) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 3) m->real[vr[i]] = *value++;
        else for (int j = 0; j < 3; j++) m->w[j] = *value++;
    }
    return fmi3OK;
}
Status fmi3GetInt32(Instance c, const fmi3ValueReference vr[], size_t n, int32_t value[], size_t k) {
    const Model *m = c;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == COUNT ? m->count_in + m->steps : m->count_in;
    return fmi3OK;
}
Status fmi3SetInt32(Instance c, const fmi3ValueReference vr[], size_t n, const int32_t value[], size_t k) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->count_in = value[i];
    return fmi3OK;
}
Status fmi3GetBoolean(Instance c, const fmi3ValueReference vr[], size_t n, bool value[], size_t k) {
    for (size_t i = 0; i < n; i++) value[i] = (vr[i] == OFF) != ((const Model *)c)->on;
    return fmi3OK;
}
Status fmi3SetBoolean(Instance c, const fmi3ValueReference vr[], size_t n, const bool value[], size_t k) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->on = value[i];
    return fmi3OK;
}
#define ALIKE(NAME, TYPE, COMPONENT)                                                                                   \
    Status fmi3Get##NAME(Instance c, const fmi3ValueReference vr[], size_t n, TYPE value[], size_t k) {             \
        for (size_t i = 0; i < n; i++) value[i] = ((const Model *)c)->COMPONENT;                                       \
        return fmi3OK;                                                                                              \
    }                                                                                                               \
    Status fmi3Set##NAME(Instance c, const fmi3ValueReference vr[], size_t n, const TYPE value[], size_t k) {       \
        for (size_t i = 0; i < n; i++) ((Model *)c)->COMPONENT = value[i];                                             \
        return fmi3OK;                                                                                              \
    }
ALIKE(Float32, float, f32)
ALIKE(Int8, int8_t, i8)
ALIKE(UInt8, uint8_t, u8)
ALIKE(Int16, int16_t, i16)
ALIKE(UInt16, uint16_t, u16)
ALIKE(UInt32, uint32_t, u32)
ALIKE(Int64, int64_t, i64)
ALIKE(UInt64, uint64_t, u64)
Status fmi3GetFMUState(Instance m, fmi3FMUState *state) { return (*state = copy_of(m, *state)) ? fmi3OK : fmi3Error; }
Status fmi3SetFMUState(Instance m, fmi3FMUState state) { memcpy(m, state, sizeof(Model)); return fmi3OK; }
Status fmi3FreeFMUState(Instance m, fmi3FMUState *state) { free(*state); *state = NULL; return fmi3OK; }
Status fmi3SerializedFMUStateSize(Instance m, fmi3FMUState state, size_t *size) {
    *size = sizeof(Model);
    return fmi3OK;
}
Status fmi3SerializeFMUState(Instance m, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    memcpy(bytes, state, sizeof(Model));
    return fmi3OK;
}
Status fmi3DeserializeFMUState(Instance m, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return size == sizeof(Model) && (*state = copy_of((const void *)bytes, *state)) ? fmi3OK : fmi3Error;
}
Status fmi3DoStep(
    Instance m, double t, double h, Flag no_set_prior, Flag *event, Flag *terminate, Flag *early, double *last) {
    advance(m, h);
    *event = *terminate = *early = false;
    *last = t + h;
    return fmi3OK;
}
#endif
