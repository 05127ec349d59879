/* FMI 2.0 or 3.0 (-DFMI=2, -DFMI=3) under one set of names, from the standard's headers alone. */
#ifndef FMI_NAMES_H
#define FMI_NAMES_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi2Functions.h"
#define F(NAME) fmi2##NAME
#define STATE(VERB, OF) fmi2##VERB##FMUstate##OF
#define DESERIALIZE fmi2DeSerializeFMUstate
#define REAL Real
#define INTEGER Integer
typedef fmi2FMUstate Saved;
typedef fmi2Integer Whole;
typedef const fmi2CallbackFunctions *Logger;
#else
#include "fmi3Functions.h"
#define F(NAME) fmi3##NAME
#define STATE(VERB, OF) fmi3##VERB##FMUState##OF
#define DESERIALIZE fmi3DeserializeFMUState
#define REAL Float64
#define INTEGER Int32
typedef fmi3FMUState Saved;
typedef fmi3Int32 Whole;
typedef fmi3LogMessageCallback Logger;
typedef fmi3Instance fmi3Component;
#endif
typedef F(Component) Instance;
typedef F(Status) Status;
typedef F(Boolean) Flag;
typedef F(ValueReference) Reference;
typedef F(String) Text;
typedef F(Byte) Byte;

/* Functions whose arguments differ, by what they return. The expressions see the arguments `name`, `logger`, `begin`
 * [s], `vr`, `n`, `value`, `t` and `h` [s], `no_rollback`; a step sets `end` if it asks for the end, and `last` [s] if
 * that is not t + h. */
#if FMI == 2
#define FMI2_OR_3(TWO, THREE) TWO
#define INSTANTIATE(MADE)                                                                                              \
    const char *fmi2GetVersion(void) { return fmi2Version; }                                                           \
    const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }                                               \
    Instance fmi2Instantiate(                                                                                          \
        Text name, fmi2Type type, Text token, Text resources, Logger logger, Flag visible, Flag logging) {             \
        return MADE;                                                                                                   \
    }
#define SETUP(READY, ENTERED)                                                                                          \
    Status fmi2SetupExperiment(Instance c, Flag a, double tolerance, double begin, Flag b, double stop) {              \
        return READY;                                                                                                  \
    }                                                                                                                  \
    Status fmi2EnterInitializationMode(Instance c) { return ENTERED; }
#define DO_STEP(DONE)                                                                                                  \
    Status fmi2DoStep(Instance c, double t, double h, Flag no_rollback) {                                              \
        bool end = false;                                                                                              \
        double last = t + h;                                                                                           \
        const Status returned = DONE;                                                                                  \
        return end ? fmi2Discard : returned; /* FMI 2.0 has no other way to ask for the end */                         \
    }
#else
#define FMI2_OR_3(TWO, THREE) THREE
#define INSTANTIATE(MADE)                                                                                              \
    const char *fmi3GetVersion(void) { return fmi3Version; }                                                           \
    Instance fmi3InstantiateCoSimulation(Text name, Text token, Text resources, Flag visible, Flag logging,            \
        Flag events, Flag early, const Reference required[], size_t n, fmi3InstanceEnvironment environment,            \
        Logger logger, fmi3IntermediateUpdateCallback update) {                                                        \
        return MADE;                                                                                                   \
    }
#define SETUP(READY, ENTERED)                                                                                          \
    Status fmi3EnterInitializationMode(Instance c, Flag a, double tolerance, double begin, Flag b, double stop) {      \
        const Status ready = READY;                                                                                    \
        return ready == fmi3OK ? ENTERED : ready;                                                                      \
    }
#define DO_STEP(DONE)                                                                                                  \
    Status fmi3DoStep(Instance c, double t, double h, Flag no_rollback, Flag *event, Flag *ends, Flag *early,          \
        double *at) {                                                                                                  \
        bool end = false;                                                                                              \
        double last = t + h;                                                                                           \
        const Status returned = DONE;                                                                                  \
        *event = *early = false, *ends = end, *at = last;                                                              \
        return returned;                                                                                               \
    }
#endif
#define ACCESS(NAME, TYPE, GET, SET) ACCESS_(NAME, TYPE, GET, SET)
#define ACCESS_(NAME, TYPE, GET, SET)                                                                                  \
    Status F(Get##NAME)(Instance c, const Reference vr[], size_t n, TYPE value[] FMI2_OR_3(, COMMA size_t k)) { GET; } \
    Status F(Set##NAME)(Instance c, const Reference vr[], size_t n, const TYPE value[] FMI2_OR_3(, COMMA size_t k)) {  \
        SET;                                                                                                           \
    }
#define COMMA ,
#define EACH(DO)                                                                                                       \
    for (size_t i = 0; i < n; i++) DO;                                                                                 \
    return F(OK)

/* States of a model whose memory, OF(instance), is a TYPE without pointers: saved as it is. */
#define COPIED_STATES(TYPE, OF)                                                                                        \
    static Status copied(const void *from, Saved *to) {                                                                \
        if (!*to) *to = malloc(sizeof(TYPE));                                                                          \
        return *to ? memcpy(*to, from, sizeof(TYPE)), F(OK) : F(Error);                                                \
    }                                                                                                                  \
    Status STATE(Get, )(Instance c, Saved *s) { return copied(OF(c), s); }                                             \
    Status STATE(Set, )(Instance c, Saved s) { return memcpy(OF(c), s, sizeof(TYPE)), F(OK); }                         \
    Status STATE(Free, )(Instance c, Saved *s) { return free(*s), *s = NULL, F(OK); }                                  \
    Status STATE(Serialized, Size)(Instance c, Saved s, size_t *n) { return *n = sizeof(TYPE), F(OK); }                \
    Status STATE(Serialize, )(Instance c, Saved s, Byte b[], size_t n) { return memcpy(b, s, n), F(OK); }              \
    Status DESERIALIZE(Instance c, const Byte b[], size_t n, Saved *s) {                                               \
        return n == sizeof(TYPE) ? copied(b, s) : F(Error);                                                            \
    }

#endif
