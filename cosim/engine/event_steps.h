/* Co-Simulation FMUs of FMI 3.0 that report events or return early, as components that step to the end.
 *
 * A step begins in event mode if discrete inputs have changed; it ends early at events, which are processed in event
 * mode, and the rest of it follows. Without event mode only early returns are completed. Nothing here allocates memory,
 * and there are no globals. Lines that do not begin with # are also read by cffi. */
#ifndef EVENT_STEPS_H
#define EVENT_STEPS_H

#include "engine.h"

/* Functions of the FMU, in the order of `EventSteps.call`. */
typedef enum {
    EVENT_DO_STEP, EVENT_ENTER, EVENT_UPDATE, EVENT_LEAVE, EVENT_SET, EVENT_FUNCTIONS
} EventFunction;

/* Why a step has failed. */
typedef enum {
    EVENT_FINE,
    EVENT_CALL_FAILED,     /* function number `index` returned `status` */
    EVENT_NOT_CONVERGED,   /* every update of discrete states requires another one */
    EVENT_TOO_MANY,        /* events and early returns in one communication step */
    EVENT_BAD_TIME,        /* it returned early at `time`, outside of the step */
    EVENT_BAD_EVENT,       /* the next event that it announces is at NaN */
    EVENT_TERMINATED       /* it asks for the end of the simulation in event mode */
} EventEnd;

typedef struct {
    uint32_t end, index, status, reserved;
    double time;
} EventReport;

/* What continues from step to step beside the FMU's own state. */
typedef struct {
    double next_event;         /* infinite: none is announced */
    int32_t ends, reserved;    /* it has asked for the end in event mode, where it stays: it takes no step */
} EventMemory;

typedef struct EventSteps EventSteps;

/* Discrete inputs of one type: in step mode they wait for event mode. */
typedef struct {
    EventSteps *steps;
    EngineValues3 call;
    const uint32_t *references;
    size_t n_references;
    void *data;
    size_t n_data;
    void *before;                /* what was set last */
    size_t size;                 /* bytes of both */
} EventInputs;

struct EventSteps {
    void *instance;
    void *stepped;               /* what EVENT_DO_STEP gets: the instance, or what sets its inputs inside the step */
    void *call[4];               /* of EVENT_DO_STEP to EVENT_LEAVE */
    EventInputs *inputs;
    int32_t n_inputs;
    bool event_mode, variable_step, stepping;
    double internal;             /* length of the FMU's internal steps [s], 0: not known */
    EventMemory memory;
    EventReport report;
    uint32_t environment[2];     /* floating-point environment: environment_begin */
};

/* The setter of discrete inputs; `inputs` is the address of an `EventInputs`. */
uint32_t event_steps_set(void *instance, const uint32_t *inputs, size_t n, void *data, size_t n_data);
/* After initialization, at time t; then in step mode, unless it asks for the end. Returns a status of FMI; above 1 see
 * `report`. */
uint32_t event_steps_begin(EventSteps *s, double t);
/* Enter event mode, or update discrete states and go back to step mode, at time t; neither after a request for the
 * end. */
uint32_t event_steps_enter(EventSteps *s, double t);
uint32_t event_steps_leave(EventSteps *s, double t);
/* Why a step or event mode has failed, for people; empty where fmi3DoStep itself has. */
const char *event_steps_why(const EventReport *report);
/* The step function of a Co-Simulation FMU that never returns early, unless it asks for the end of the simulation. */
uint32_t event_steps_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early,
    double *last);

#endif
