/* Model Exchange FMUs as components that step: an integrator with the same step function as a Co-Simulation FMU.
 *
 * Between steps the FMU is in event mode, in which all inputs may be set and all values read. A step updates discrete
 * states, integrates to the end of the step with all its events, and enters event mode again. Dormand-Prince 5(4)
 * integrates, and RODAS, a Rosenbrock method of order 4(3), where the model is stiff. Nothing here allocates memory,
 * only integrator_why calls a library, and there are no globals. Lines that do not begin with # are also read by
 * cffi. */
#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Functions of the FMU, in the order of `integrator_function`. */
typedef enum {
    INTEGRATOR_SET_TIME, INTEGRATOR_SET_STATES, INTEGRATOR_GET_STATES, INTEGRATOR_GET_DERIVATIVES,
    INTEGRATOR_GET_INDICATORS, INTEGRATOR_GET_NOMINALS, INTEGRATOR_ENTER_EVENTS, INTEGRATOR_UPDATE,
    INTEGRATOR_ENTER_CONTINUOUS, INTEGRATOR_COMPLETED, INTEGRATOR_DIRECTIONAL,
    INTEGRATOR_COUNT_STATES, INTEGRATOR_COUNT_INDICATORS, /* of FMI 3.0, if there */
    INTEGRATOR_FUNCTIONS
} IntegratorFunction;

typedef enum { INTEGRATOR_AUTO, INTEGRATOR_EXPLICIT, INTEGRATOR_IMPLICIT } IntegratorMethod;

/* Why a step has failed. */
typedef enum {
    INTEGRATOR_FINE,
    INTEGRATOR_CALL_FAILED,      /* function number `index` returned `status` */
    INTEGRATOR_BAD_STATE,        /* state number `index` is NaN or infinite */
    INTEGRATOR_BAD_DERIVATIVE,   /* so is its derivative */
    INTEGRATOR_BAD_INDICATOR,    /* so is event indicator number `index` */
    INTEGRATOR_TOO_SMALL,        /* the error of state number `index` is too large even with the smallest step */
    INTEGRATOR_TOO_MANY_STEPS,
    INTEGRATOR_NOT_CONVERGED,    /* every update of discrete states requires another one */
    INTEGRATOR_TOO_MANY_EVENTS,
    INTEGRATOR_BAD_EVENT,        /* the next time event is at NaN */
    INTEGRATOR_TERMINATED,       /* the FMU asks for the end of the simulation */
    INTEGRATOR_OTHER_COUNT       /* function number `index` returns another number than the description has: `found` */
} IntegratorEnd;

typedef struct {
    uint32_t end, index, status;
    uint32_t found;
    double time;
    uint64_t steps, rejected, evaluations, events; /* since the start */
} IntegratorReport;

/* What is known about an FMU. The names of states and derivatives are value references, of whole arrays in FMI 3.0. */
typedef struct {
    uint32_t version, method;
    uint32_t n, n_indicators, n_references; /* states, event indicators, value references of the states */
    uint32_t completed;          /* fmiXCompletedIntegratorStep is needed */
    uint32_t directional;        /* directional derivatives are offered */
    uint32_t foreign;            /* its calls may change the floating-point environment */
    double tolerance;            /* relative; times a state's nominal value it is the absolute one */
} IntegratorSetup;

/* What continues from step to step beside the FMU's own state; saved with it. */
typedef struct {
    double time, h;
    int32_t implicit, stiff, not_stiff;
    int32_t directional;         /* directional derivatives: 0 not yet compared with differences, 1 right, 2 wrong */
    int32_t ends;                /* it has asked for the end: the next step ends the simulation */
} IntegratorMemory;

typedef struct {
    IntegratorSetup setup;
    void *instance;
    void *call[INTEGRATOR_FUNCTIONS]; /* the functions of the FMU; NULL where it lacks one */
    const uint32_t *states, *derivatives; /* value references */
    IntegratorMemory memory;
    IntegratorReport report;
    double next_event;
    uint32_t environment[2];     /* floating-point environment: environment_begin */
    bool no_set_prior, linearized; /* the matrix is that of the present step */
    double *x, *x1, *trial, *f, *f1, *error, *nominal, *z, *z1, *k[6], *dense[5], *slope, *seed, *matrix;
    uint32_t *pivot;
} Integrator;

/* Name of a function of the FMU without its prefix; NULL: there is none in this version. */
const char *integrator_function(uint32_t version, uint32_t number);
/* Why a step has failed, for people; `state`: the name of state number `index`, NULL: its number. */
void integrator_why(const IntegratorSetup *setup, const IntegratorReport *report, const char *state, char *text,
    size_t size);
/* Whether the FMU must have it. */
bool integrator_needs(const IntegratorSetup *setup, uint32_t number);
/* Bytes of memory for an integrator, its two lists of value references, and its work space; 0: too many. */
size_t integrator_size(const IntegratorSetup *setup);
/* An integrator in memory that is aligned as doubles are. `references`: of the states, then of the derivatives. */
Integrator *integrator_make(void *memory, const IntegratorSetup *setup, const uint32_t *references, void *instance,
    void *const *calls);
/* After initialization, in event mode at time t. Returns a status of FMI, and so do the steps; above 1 see `report`. */
uint32_t integrator_begin(void *integrator, double t);
/* A step at NaN takes no time: it updates discrete states alone, for inputs that were set. If the FMU asks for the end
 * there, the next step says so. */
uint32_t integrator_step2(void *integrator, double t, double h, int no_set_prior);
uint32_t integrator_step3(void *integrator, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last);

#endif
