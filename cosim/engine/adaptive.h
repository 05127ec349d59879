/* Communication steps of continuous components that follow the error of their exchange.
 *
 * The rule is written in exchange.py and adaptive.py, and again in tests/oracles/adaptive_rule.py. Lines that do not
 * begin with # are also read by cffi. */
#ifndef ENGINE_ADAPTIVE_H
#define ENGINE_ADAPTIVE_H

#include "engine.h"

/* How an output of a continuous component is used; flags. */
typedef enum {
    ENGINE_READ = 1, /* a continuous component reads it: its error counts */
    ENGINE_LAST = 2, /* outputs that follow in steps only depend directly on it: it ends a step with its last value */
    ENGINE_STEPWISE = 4 /* it is not extrapolated, and between communication points it keeps its value */
} EngineUse;

/* Where the steps stand [ticks], and what they have cost. */
typedef struct {
    int64_t begin, end;      /* of the present step; they are equal before the first one */
    int64_t tried;           /* length of the step that is or was tried last */
    int64_t over;            /* what slopes were measured over: the step before, or minus the rejected one; 0: none */
    int64_t far;             /* how long ago the third value is that tells the curves; 0: none */
    int64_t past;            /* length of the step before, over which `back` was measured; 0: none */
    int64_t next;            /* length that the error allows for the next step */
    int64_t jumps;           /* smallest steps in a row that exceeded the tolerance */
    int64_t changed;         /* inputs or parameters were set from outside */
    int64_t n_accepted, n_rejected;
    int64_t n_beyond;        /* accepted smallest steps that exceeded the tolerance */
    int64_t total, smallest, largest; /* of the accepted steps */
} EngineSteps;

/* All continuous components take the same steps. They are due by no clock of the engine. */
typedef struct {
    uint32_t n;                  /* outputs of continuous components */
    uint32_t published, computed; /* where they are: values[published + k] and values[computed + k] */
    const uint8_t *use;          /* of n: EngineUse */
    const int32_t *refreshed;    /* in order: components whose outputs follow their inputs without a step, or loops:
                                  * -1 - their number */
    int32_t n_refreshed;
    double tolerance;
    int64_t largest, stop;       /* [ticks]: largest step; the stop time if it is known, else 0 */
    int64_t internal;            /* [ticks]: halves of steps are multiples of this internal step; 0: any length */
    EngineStates *fmus;          /* FMUs whose states are saved here; `back` with component -2 saves all others */
    const int32_t *numbers;      /* of n_fmus: which components they are */
    void **states;               /* of n_fmus; they were saved once before */
    int32_t n_fmus;
    bool others;                 /* `back` saves and restores other states, as components -2 and -3 */
    double *begin, *size;        /* of n: value at the begin of the step; the largest magnitude so far */
    double *slope, *curve, *back; /* of n: first and second divided difference there, slope in the step before */
    double since, over;          /* begin of the step, EngineSteps.over [s] */
    EngineSteps *steps;
    uint32_t worst;              /* the output with the largest error in the last trial */
    double error;                /* relative to the tolerance */
} EngineAdaptive;

/* As engine_run, engine_arrive, engine_sample and engine_advance. */
int engine_adaptive_run(Engine *e, EngineAdaptive *a, int64_t end);
int engine_adaptive_arrive(Engine *e, EngineAdaptive *a, double t);
int engine_adaptive_sample(Engine *e, EngineAdaptive *a, double t);
int engine_adaptive_advance(Engine *e, EngineAdaptive *a, double t);
/* End the present step at `tick`, within it: its first part is repeated. */
int engine_adaptive_cut(Engine *e, EngineAdaptive *a, int64_t tick);

#endif
