/* A system of FMUs as one instance: what the files of it have in common. All of them refer to the plan of one system.
 *
 * The order of everything is that of a run (cosim/engine): initialization, one instant after the other,
 * arrival at the end of a step. What changes lies in one block without pointers, and in the components. */
#ifndef CONTAINER_H
#define CONTAINER_H

#include "fmu_base.h"
#include "fmu_core.h"
#include "system.h"

#define EXACT 9007199254740992 /* 2^53: integers below it are doubles */

static const Plan *const P = &plan;

/* Everything that changes, but for what is in the components. */
typedef struct {
    int64_t tick, stop_tick; /* stop_tick: INT64_MAX without a stop time */
    int64_t a, b, d;         /* time = (tick * a + b) / d */
    double start;
    int32_t mode;
    int32_t settled;         /* while initializing: outputs follow from inputs and parameters */
    int32_t ended;           /* a component has asked for the end */
    int32_t ends_by;         /* which one */
    int64_t ending;          /* tick at which it ends; INT64_MAX: none has asked */
    double v[];              /* values, inputs of components, buffers of calls */
} State;

/* The last step of a component that repeats it. */
typedef struct {
    void *state; /* at the beginning of the step; NULL if no step can be repeated */
    double t;
} LastStep;

struct FmuInstance {
    FmuBase base;
    State *state;
    double *values, *before; /* before: the values of a moment ago */
    double *old;             /* of variables that are being set: values of the components, then those that are shown */
    uint64_t *passed;        /* calculated parameters that were passed on: their numbers, bit by bit, or hashes */
    char **shown;            /* by variable: its text as it was told last */
    Engine engine;
    EngineComponent *bound;
    Component *components;
    EngineTransfer *transfers;
    EngineDerivative *derivatives; /* of all loops, one after the other */
    LastStep *repeated; /* by component */
    void *texts;                    /* memory of calls of texts, bytes and 64-bit integers */
    void *networks;                 /* memory of networks of clocks */
    bool *flags;
    double *last;
};

/* Which component logs. */
typedef struct {
    FmuInstance *self;
    int32_t component;
} Source;

static inline size_t state_size(void) {
    return sizeof(State) + ((size_t)P->n_values + P->n_u + (P->n_buffer + 7u) / 8u) * sizeof(double);
}

/* container.c: the memory of network number i of clocks. */
void *container_network(const FmuInstance *self, int32_t i);

/* container_binding.c: calls and buffers of all components for the engine, as far as they do not change; the calls of
 * component i, first those that set. */
FmuStatus container_bind(FmuInstance *self);
const EngineTransfer *container_calls_of(const FmuInstance *self, int32_t i);

/* container_initialization.c: pass outputs to inputs until nothing changes any more. */
FmuStatus container_settle(FmuInstance *self);

/* container_steps.c: what the engine calls for components that repeat their steps; from now on it does, and there is no
 * last step; the last step of component i is forgotten. */
int container_repeat(void *context, int32_t component, double t);
void container_repeat_steps(FmuInstance *self);
void container_forget_last(FmuInstance *self, int32_t i);

/* container_failures.c. */
enum { CALL_SAVE = INT32_MIN, CALL_RESTORE }; /* beside those of Engine.call */
void container_log(void *context, int status, const char *message); /* context: a Source */
const char *container_status(uint32_t status); /* its name */
FmuStatus container_refused(FmuInstance *self, int32_t i, const char *what, uint32_t status);
FmuStatus container_failed(FmuInstance *self, int32_t i, const char *what, uint32_t status);
FmuStatus container_call_failed(FmuInstance *self, int32_t i);
FmuStatus container_step_failed(FmuInstance *self, int32_t i, uint32_t status);
FmuStatus container_not_solved(FmuInstance *self);
void container_say_changes(FmuInstance *self); /* of the floating-point environment, by calls of the engine */
int32_t container_culprit(const FmuInstance *self, int32_t i, int32_t *call, char *text, size_t size);

#endif
