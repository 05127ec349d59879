/* A component of a system behind its FMI functions, whichever version, linked or loaded. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "engine.h"
#include "fmi2Functions.h"
#include "fmi3Functions.h"

/* Which function moves a value. FMI 2.0 knows Float64 (Real), Int32 (Integer), Boolean and String. */
typedef enum {
    KIND_FLOAT64,
    KIND_FLOAT32,
    KIND_INT8,
    KIND_UINT8,
    KIND_INT16,
    KIND_UINT16,
    KIND_INT32,
    KIND_UINT32,
    KIND_INT64,
    KIND_UINT64,
    KIND_BOOLEAN,
    KIND_STRING,
    KIND_BINARY
} Kind;

/* The functions that are called, without the part of their name that says the version; of the optional ones an FMU of
 * others has those of its types and capabilities. */
#define FMI2_CALLS(X)                                                                                                  \
    X(Instantiate)                                                                                                     \
    X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset)      \
        X(GetReal) X(SetReal) X(DoStep)
#define FMI2_OPTIONAL_CALLS(X)                                                                                         \
    X(GetInteger) X(GetBoolean) X(GetString) X(SetInteger) X(SetBoolean) X(SetString)                                  \
        X(GetRealStatus) X(GetBooleanStatus) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate)                             \
            X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate) X(GetDirectionalDerivative)
#define FMI3_CALLS(X)                                                                                                  \
    X(InstantiateCoSimulation)                                                                                         \
    X(FreeInstance) X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset) X(GetFloat64) \
        X(SetFloat64) X(DoStep)
#define FMI3_OPTIONAL_CALLS(X)                                                                                         \
    X(GetFloat32) X(GetInt8) X(GetUInt8) X(GetInt16) X(GetUInt16) X(GetInt32) X(GetUInt32) X(GetInt64)   \
        X(GetUInt64) X(GetBoolean) X(GetString) X(SetFloat32) X(SetInt8) X(SetUInt8) X(SetInt16) X(SetUInt16)         \
            X(SetInt32) X(SetUInt32) X(SetInt64) X(SetUInt64) X(SetBoolean) X(SetString) X(GetFMUState) X(SetFMUState) \
                X(FreeFMUState) X(SerializedFMUStateSize) X(SerializeFMUState) X(DeserializeFMUState)                  \
                    X(GetDirectionalDerivative)

#define POINTER2(name) fmi2##name##TYPE *name;
#define POINTER3(name) fmi3##name##TYPE *name;
typedef struct { FMI2_CALLS(POINTER2) FMI2_OPTIONAL_CALLS(POINTER2) } Functions2;
typedef struct { FMI3_CALLS(POINTER3) FMI3_OPTIONAL_CALLS(POINTER3) } Functions3;

/* Tables of linked components: the names have their prefixes where these are used. */
#define NAMED2(name) .name = fmi2##name,
#define NAMED3(name) .name = fmi3##name,
#define DECLARATION2(name) fmi2##name##TYPE fmi2##name;
#define DECLARATION3(name) fmi3##name##TYPE fmi3##name;
#define DECLARED2 FMI2_CALLS(DECLARATION2) FMI2_OPTIONAL_CALLS(DECLARATION2)
#define DECLARED3 FMI3_CALLS(DECLARATION3) FMI3_OPTIONAL_CALLS(DECLARATION3)
#define FUNCTIONS2 {FMI2_CALLS(NAMED2) FMI2_OPTIONAL_CALLS(NAMED2)}
#define FUNCTIONS3 {FMI3_CALLS(NAMED3) FMI3_OPTIONAL_CALLS(NAMED3)}

/* Any function. */
typedef void (*ExchangeCall)(void);

/* An FMU of others: its library below the resources of the system's FMU. Returns NULL, with the reason, where that
 * fails. */
void *foreign_open(const char *resources, const char *folder, const char *identifier, int version, void *functions,
    bool exchange, char *reason, size_t n_reason);
ExchangeCall foreign_find(void *library, int version, const char *name);
void foreign_close(void *library);

/* What is otherwise in components that are integrated (Model Exchange: model_exchange.c), that report events or return
 * early (events.c), or that have clocks (clocks.c); only systems with such have these. The step functions get the
 * integrator. What only some of them need may be NULL. */
typedef struct Component Component;
typedef struct {
    bool (*make)(Component *m, const char *name, const char *token, const char *resources);
    uint32_t (*begin)(Component *m);
    void (*bind)(Component *m, bool stepping);     /* no inputs wait; `stepping`: initialization is over */
    void (*wait)(Component *m, EngineTransfer *t); /* inputs of a call wait for event mode */
    uint32_t (*change)(Component *m, bool begins, bool done); /* before and after values are set between steps; `done`:
                                                               * they have been set */
    bool (*why)(const Component *m, double *time, char *text, size_t size); /* it failed; false: it asks to end */
    EngineStep2 step2;
    EngineStep3 step3;
    uint32_t (*leave)(Component *m);               /* before it leaves initialization */
    void (*values)(const Component *m, double **u, double **y); /* where its calls have inputs and outputs */
    void (*attach)(Component *m, EngineComponent *e, uint32_t n_inputs); /* after its calls are bound */
    bool (*later)(Component *m, uint32_t reference, double *value, bool set); /* component_later */
    Component *(*culprit)(const Component *m, int32_t *call, char *text, size_t size); /* of a failed step */
    uint32_t (*changed)(const Component *m);       /* bits for component_changed, beside those that the engine sees */
} Exchange;
extern const Exchange exchange, events, clocks;

/* Setup of a component with events. */
typedef struct {
    bool event_mode, variable_step;
    double internal;      /* length of its internal steps [s]; 0: not known */
    uint32_t n, n_values; /* calls that set discrete inputs, and their values */
} EventSetup;

/* Inputs that follow inside the steps of a component: one call sets `n` elements of `references`. Of these n_lines are
 * extrapolated or held, and n_free, each with `index` in an array of n, are driven by nobody. */
typedef struct {
    uint32_t element, reference, n, index;
} UpdateFree;
typedef struct {
    const uint32_t *required; /* value references of all inputs that could follow */
    uint32_t n_required;
    const uint32_t *references;
    uint32_t n_references, n;
    const EngineExtrapolation *lines;
    const uint32_t *element;
    uint32_t n_lines;
    const UpdateFree *free;
    uint32_t n_free;
} UpdateSetup;

/* What steps such components (updates.c); only systems with such have this. */
typedef struct {
    bool (*make)(Component *m); /* before it is instantiated */
    uint32_t (*bind)(Component *m, const EngineComponent *e, const double *values);
    const char *(*why)(const Component *m, double *time); /* inputs could not be set in the last step; or NULL */
} Updates;
extern const Updates updates;

/* What is saved beside the state of an FMU. */
typedef struct {
    void *at;
    size_t n;
} ComponentMemory;

typedef void (*ComponentLog)(void *context, int status, const char *message);

struct Component {
    int version;
    const Functions2 *f2;
    const Functions3 *f3;
    void *instance;
    void *library;  /* of others, and what closes it */
    void (*close)(void *library);
    bool dead;      /* it has returned Fatal, and nothing of it may be called any more */
    ComponentLog log;
    void *context;
    fmi2CallbackFunctions callbacks;
    const Exchange *exchange; /* NULL: it steps itself */
    const void *setup;        /* IntegratorSetup, EventSetup or ClockedSetup */
    const uint32_t *references;
    const ExchangeCall *linked; /* functions of the integrator, then InstantiateModelExchange of FMI 3.0 */
    ExchangeCall (*find)(void *library, int version, const char *name);
    void *integrator;         /* or EventSteps or ClockedFmu */
    ComponentMemory memory[2]; /* of it */
    double begin;
    fmi3LogMessageCallback say;
    const UpdateSetup *follows; /* NULL: no input follows inside its steps */
    fmi3IntermediateUpdateCallback update;
    uint32_t environment, changed; /* before a call of an FMU of others, and what calls have changed (environment.h) */
    void *updates;              /* what `step` gets then */
    EngineStep3 step;
};

/* Arguments `requiredIntermediateVariables` and their number. */
#define REQUIRED(m) ((m)->follows ? (m)->follows->required : NULL), ((m)->follows ? (m)->follows->n_required : 0)

/* It is about to be called, or loaded; and a call has changed these bits of the floating-point environment, which is
 * said once (environment.h). */
void component_watch(Component *m);
void component_changed(Component *m, uint32_t bits);

bool component_instantiate(Component *m, const char *name, const char *token, const char *resources);
void component_free(Component *m);

/* Each returns the status that the FMU has returned; a larger one than 1 (Warning) is a failure. */
uint32_t component_enter(Component *m, bool has_tolerance, double tolerance, double start, bool has_stop, double stop);
uint32_t component_exit(Component *m);
uint32_t component_begin(Component *m); /* the first event iteration, after it */
uint32_t component_reset(Component *m);
uint32_t component_terminate(Component *m);
uint32_t component_save(Component *m, void **state);
uint32_t component_restore(Component *m, void *state);
uint32_t component_forget(Component *m, void **state);
uint32_t component_size(Component *m, void *state, size_t *size);
uint32_t component_serialize(Component *m, void *state, void *bytes, size_t size);
uint32_t component_deserialize(Component *m, const void *bytes, size_t size, void **state);

/* All elements of a variable, from or to doubles; at most COMPONENT_LARGEST of them. */
enum { COMPONENT_LARGEST = 1024 };
uint32_t component_set(Component *m, Kind kind, uint32_t reference, const double *values, size_t n);
uint32_t component_get(Component *m, Kind kind, uint32_t reference, double *values, size_t n);
uint32_t component_set_text(Component *m, uint32_t reference, const char *text);
uint32_t component_set_bytes(Component *m, uint32_t reference, const unsigned char *bytes, size_t n);
/* What they return is valid until the next call of the component. */
uint32_t component_get_text(Component *m, uint32_t reference, const char **text);
uint32_t component_get_bytes(Component *m, uint32_t reference, const unsigned char **bytes, size_t *n);
/* 64-bit integers, bit by bit. */
uint32_t component_move_wide(Component *m, Kind kind, uint32_t reference, uint64_t *values, size_t n, bool set);

/* Whether the values of an input wait for a tick: gets, or sets, the one that waits, NaN if none does. */
bool component_later(Component *m, uint32_t reference, double *value, bool set);

/* What the engine calls for a kind; 0 where the version has no such function. */
void component_values(const Component *m, Kind kind, bool set, EngineTransfer *transfer);
/* Whether one of FMI 2.0, or that is integrated, did in its last step, or any one in its first event iteration;
 * *reached: the time [s] until which that step was taken, if it says so. */
bool component_asked_to_end(Component *m, double *reached);

#endif
