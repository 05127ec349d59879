/* Inputs that follow a straight line inside a step: for Co-Simulation FMUs of FMI 3.0 that call their importer back
 * (intermediate update).
 *
 * The step function computes the lines of the inputs that are extrapolated; the callback sets the inputs to their
 * values at the time that the FMU gives. Nothing here allocates memory, and there are no globals. Lines that do not
 * begin with # are also read by cffi. */
#ifndef INTERMEDIATE_H
#define INTERMEDIATE_H

#include "adaptive.h"

/* Why inputs were not set. */
typedef enum {
    INTERMEDIATE_FINE,
    INTERMEDIATE_BAD_TIME,     /* `time` is outside of the step */
    INTERMEDIATE_SET_FAILED    /* setting them at `time` returned `status` */
} IntermediateEnd;

typedef struct {
    uint32_t end, status;
    double time;
    int64_t requests;          /* how often the FMU has asked for inputs */
} IntermediateReport;

/* What the callback needs; the environment of the instance. */
typedef struct {
    void *instance;
    EngineValues3 set;         /* fmi3SetFloat64 */
    const uint32_t *references;
    uint32_t n_references, n;  /* inputs that follow, and all their elements */
    bool stepping, begins;     /* begins: they are set at the begin of the step too */
    double *line;              /* begin and end of the step [s]; of n: values at its begin, slopes, values set last */
    IntermediateReport report;
    uint32_t environment[2];   /* floating-point environment: environment_begin */
} IntermediateUpdate;

typedef struct {
    IntermediateUpdate update;
    EngineStep3 step;          /* of the FMU */
    const double *values, *scale, *offset;
    const EngineAdaptive *adaptive; /* in a run with a tolerance */
    const EngineExtrapolation *lines; /* of n_lines elements; `now`: an output of `adaptive`. Period 0: held */
    const uint32_t *element;   /* of n_lines: which of update.n they are; the others keep what `line` has of them */
    uint32_t n_lines;
} IntermediateStep;

/* A step begins, whose lines are known. */
void intermediate_begin(IntermediateUpdate *u);

/* fmi3IntermediateUpdateCallback; `environment` is the address of an `IntermediateUpdate`. */
void intermediate_update(void *environment, double t, bool asks, bool allows, bool finished, bool can_return,
    bool *returns, double *return_time);
/* The step function. */
uint32_t intermediate_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last);

#endif
