/* The plan of a system's exchange as flat arrays, and the engine that executes it.
 *
 * The rule of exchange is written in exchange.py, and again in tests/oracles/exchange_rule.py, to which this engine
 * is bit-identical. All exchanged values lie in one vector of doubles. Nothing here allocates memory, and
 * there are no globals. Lines that do not begin with # are also read by cffi. */
#ifndef ENGINE_H
#define ENGINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract(off)
#elif defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off")
#endif

/* Whether a step from t of length h was taken whole if it reached that time, as in cosim/core/component.py. */
#define ENGINE_IS_WHOLE(reached, t, h) ((reached) >= (t) + (h) - 1e-6 * (h))

/* C types of the values that FMI functions move. */
typedef enum {
    ENGINE_DOUBLE, ENGINE_FLOAT, ENGINE_INT8, ENGINE_UINT8, ENGINE_INT16, ENGINE_UINT16, ENGINE_INT32, ENGINE_UINT32,
    ENGINE_INT64, ENGINE_UINT64, ENGINE_BOOL
} EngineType;

/* Why engine_run returned. */
typedef enum {
    ENGINE_AT_END,      /* all instants before the requested end are done */
    ENGINE_FULL,        /* no space for the sample of the next instant, which has not begun */
    ENGINE_STOPPED,     /* a stop condition is fulfilled; steps of continuous components are still to be done */
    ENGINE_NOT_FINITE,  /* an output of the component is NaN or infinite */
    ENGINE_CALL_FAILED, /* `call` of the component returned `status`, or its step ended early or requests termination */
    ENGINE_UNSETTLED,   /* initial values still change after many rounds: there is a loop among them */
    ENGINE_BACK_FAILED, /* `back` returned another value than 0, called for a component or for a check (-1) */
    ENGINE_NO_SOLUTION, /* no values solve algebraic loop number `component` */
    ENGINE_NO_STEP,     /* adaptive.h: the smallest steps exceed the tolerance */
    ENGINE_STATE_FAILED /* adaptive.h: the state of the component was not saved (`call` 0) or not restored (1) */
} EngineResult;

/* Statuses that are no failure are 0 and 1 in FMI 2.0 and 3.0; as unsigned numbers all others are larger. */
typedef uint32_t (*EngineValues2)(void *instance, const uint32_t *references, size_t n, void *values);
typedef uint32_t (*EngineValues3)(void *instance, const uint32_t *references, size_t n, void *values, size_t n_values);
typedef uint32_t (*EngineStep2)(void *instance, double t, double h, int no_set_prior);
typedef uint32_t (*EngineStep3)(
    void *instance, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last);
/* A step of the component at time t; where t is NaN, inputs and outputs without a step. Component -1: see `checks`. */
typedef int (*EngineBack)(void *context, int32_t component, double t);

/* One call that sets or gets all connected variables of one type. */
typedef struct {
    EngineValues2 call2;
    EngineValues3 call3;
    const uint32_t *references;
    size_t n_references;
    void *data;
    size_t n_data;
    EngineType type;
    size_t n;                        /* values that are moved */
    const uint32_t *element,
        *place; /* data[element[i]] belongs to u[place[i]] or y[place[i]]; NULL: data is a part of u or y */
    const uint32_t *widths;          /* of n_references: elements of each variable; NULL: one */
} EngineTransfer;

/* values[to + i] = values[from + i] for i < n. */
typedef struct {
    uint32_t to, from, n;
} EngineCopy;

/* An input that is extrapolated:
 * u[input] += (values[now] - values[before]) * ((t + shift - values[sample_time]) / period). */
typedef struct {
    uint32_t input, now, before, sample_time;
    double period, shift;
} EngineExtrapolation;

/* A component with its bound calls. */
typedef struct {
    int32_t fmi;                /* 2, 3, or 0: called back */
    int32_t clock;
    double step;                /* [s] */
    int32_t check_before;        /* continuous: it reads what those before it have just reached */
    int32_t n_copies_before;    /* of `copies`: into previous values; the others publish outputs */
    const EngineCopy *copies;   /* at an arrival */
    int32_t n_copies;
    int64_t timestamp_slot;     /* slot of the time of the last arrival, or -1 */
    const uint32_t *index;      /* u[i] = values[index[i]] * scale[i] + offset[i] */
    size_t n_inputs;            /* 0: there are none, or they are where u points to already */
    const double *scale, *offset; /* NULL: none is converted */
    const EngineExtrapolation *extrapolations;
    size_t n_extrapolations;
    double *u, *y;
    uint32_t first, n_outputs;  /* slots of the outputs, y = values + first */
    void *instance;
    void *stepped;              /* what its step function gets: the instance, or its integrator */
    EngineStep2 step2;
    EngineStep3 step3;
    int32_t no_set_prior;
    bool *flags;                /* FMI 3.0: event, (not used), terminate, early */
    double *last;
    const EngineTransfer *sets, *gets;
    int32_t n_sets, n_gets;
    int32_t direct;             /* there is one of each, and their data are u and y */
    int32_t foreign;            /* the floating-point environment is restored after its calls */
    int32_t integrated;         /* a step at NaN updates its discrete states alone: integrator.h */
    int32_t begins_with_events; /* its outputs may change in a first event iteration, after initialization */
    uint32_t changed;           /* what it has changed there (environment.h) */
} EngineComponent;

enum { ENGINE_DERIVATIVE = 0x7fffffff }; /* `call` that failed: the one of EngineDerivative */

/* fmiXGetDirectionalDerivative of a component of a loop, of its outputs in the loop by its inputs there. */
typedef uint32_t (*EngineDerivative2)(void *instance, const uint32_t *unknowns, size_t n_unknowns,
    const uint32_t *knowns, size_t n_knowns, const double *seed, double *slope);
typedef uint32_t (*EngineDerivative3)(void *instance, const uint32_t *unknowns, size_t n_unknowns,
    const uint32_t *knowns, size_t n_knowns, const double *seed, size_t n_seed, double *slope, size_t n_slope);
typedef struct {
    EngineDerivative2 call2;    /* both NULL: the component does not offer it */
    EngineDerivative3 call3;
    const uint32_t *knowns, *inputs;    /* of n_knowns: value references, and their places in u */
    uint32_t n_knowns;
    const uint32_t *unknowns, *outputs; /* of n_unknowns: value references, and their places in y */
    uint32_t n_unknowns;
    double *work;               /* 2 (n_knowns + n_unknowns): u and y as evaluated last, seed, slope */
} EngineDerivative;

/* Components whose outputs depend directly on each other: an algebraic loop. Its unknowns z are the outputs at which it
 * is cut: the components, computed in their order from z, give G(z), and z = G(z) is solved. */
typedef struct {
    const int32_t *components;
    int32_t n_components;
    int32_t clock;              /* of all its components */
    bool follows_discrete;      /* a discrete component drives it: it is solved again after those */
    bool repeats;               /* some of its components repeat their last step: it is solved after steps only */
    int32_t n;                  /* unknowns */
    const uint32_t *published, *computed; /* of n: their slots */
    const double *nominal;      /* of n */
    const double *start;        /* of n: the first guess at initialization, from start values of driven inputs */
    double tolerance;           /* of |G(z) - z| / max(nominal, |z|) */
    const uint32_t *read;       /* of n_read: slots of all outputs that its components read of each other, if one of */
    uint32_t n_read;            /* these is integrated; they tell whether discrete states have changed */
    const EngineDerivative *derivatives; /* of n_components; NULL: none offers them */
    double *work;               /* of engine_loop_work(n); first the unknowns, then their residuals */
    int64_t n_solutions, n_evaluations, n_derivatives;
    int64_t most_evaluations;   /* for one solution */
} EngineLoop;

/* Where outputs that they read directly have changed in first event iterations, components compute their outputs again,
 * and loops are solved. */
typedef struct {
    int32_t component;          /* -1: all of the loop */
    int32_t loop;               /* which to solve instead, since the component is in it; -1: none */
    const uint32_t *read;       /* of n_read: slots of these outputs */
    uint32_t n_read;
} EngineFollower;

/* Calls of an FMU that save, restore and free its state; the same in FMI 2.0 and 3.0. */
typedef uint32_t (*EngineState)(void *instance, void **state);
typedef uint32_t (*EngineStateSet)(void *instance, void *state);
typedef struct {
    void *instance;
    EngineState get, free;
    EngineStateSet set;
} EngineStates;

/* Outputs of components that lie side by side: values[from] to values[from + n - 1]. */
typedef struct {
    uint32_t from, n;
} EnginePiece;

/* Due at offset, offset + period, ... [ticks]. */
typedef struct {
    int64_t period, offset;
} EngineClock;

typedef enum { ENGINE_GE, ENGINE_GT, ENGINE_LE, ENGINE_LT } EngineRelation;

/* Stop when scale * values[slot] + offset compares so with value. */
typedef struct {
    uint32_t slot;
    EngineRelation relation;
    double scale, offset, value;
} EngineStop;

typedef struct {
    double *values;
    EngineComponent *components;      /* discrete ones in order of execution, then continuous ones group by group */
    int32_t n_components, n_discrete;
    const EngineClock *clocks;  /* the last one is the recorder's */
    int32_t n_clocks;
    int64_t *next;              /* of n_clocks: when each is due next */
    bool *due;                  /* of n_clocks: which are due now */
    const EngineComponent **list;  /* of n_components: those that are due, in their order */
    int32_t n_due, n_due_discrete;
    int32_t n_stepped;          /* how many of them have had their step, where an instant is resumed after a failure */
    bool saves_previous;        /* some of them save previous values at their arrival */
    bool sequential;            /* some of the continuous ones read what those before them have just reached */
    EngineCopy *published;      /* of all copies: the outputs that are published at an arrival */
    int32_t n_published;
    EnginePiece *computed;      /* of n_components: where the outputs are that continuous ones compute */
    int32_t n_computed;
    EngineLoop *loops;          /* in the order in which they are solved */
    int32_t n_loops, n_initial; /* those of each exchange, and behind them those of initialization only */
    int32_t n_late;             /* behind these, in the place of all of them where initial values do not settle */
    const EngineFollower *followers; /* each after those that it depends on */
    int32_t n_followers;
    int64_t a, b, d;            /* time = (tick * a + b) / d [s] */
    uint32_t environment;       /* the floating-point environment at the begin of engine_run */
    bool check_finite;          /* an output that is NaN or infinite ends the run */
    const uint32_t *recorded;   /* slots */
    size_t n_recorded;
    double *times, *rows;       /* of samples, row by row */
    int64_t count, room;        /* samples taken, and the capacity */
    const EngineStop *stops;
    int32_t n_stops;
    bool checks;                /* `back` is called with component -1 after every sample */
    EngineBack back;
    void *context;
    int64_t tick;               /* where it stands */
    int32_t component, call; /* what failed; call: 0 its step, k > 0 sets[k - 1], k < 0 gets[-k - 1]; or which stop */
    uint32_t status;
} Engine;

/* All instants from `tick`, of which nothing is done yet, up to but not including `end`. Returns why it came back, with
 * `tick` at the instant where that happened, or at `end`. */
int engine_run(Engine *e, int64_t end);

/* The parts of an instant at time t, for those that are due (`due` by clock): 1; 2 and 3; 4 of the rule. When sample or
 * advance is called again after a component has failed, it continues behind that component. Algebraic loops are solved
 * at the end of an arrival, and again where discrete components have changed what drives them. */
int engine_arrive(Engine *e, double t);
int engine_sample(Engine *e, double t);
int engine_advance(Engine *e, double t);

/* Find what is due at `tick`, and when everything is due next. */
void engine_look_up(Engine *e, int64_t tick);
/* Hand inputs over, step at time t, or fetch outputs. Returns 0, or what engine_run returns for a failure. */
int engine_set(Engine *e, const EngineComponent *m);
int engine_step(Engine *e, const EngineComponent *m, double t);
int engine_get(Engine *e, const EngineComponent *m);
/* Fetch outputs of a continuous component variable by variable; those that it refuses to tell stay as published. */
int engine_get_each(Engine *e, const EngineComponent *m);
/* What is published of n outputs, of which `y` are the first, is what was computed. */
void engine_keep_outputs(Engine *e, const EngineComponent *m, const double *y, size_t n);
/* The inputs of a component as they are published, into u; where t is NaN, none is extrapolated. */
void engine_gather(const Engine *e, const EngineComponent *m, double t);
/* Set inputs and get outputs of a component without a step; where t is NaN, no input is extrapolated. */
int engine_exchange(Engine *e, const EngineComponent *m, double t);
/* Put back the floating-point environment after a call into a third-party FMU. */
void engine_put_back_environment(Engine *e, const EngineComponent *m);
/* What a continuous component has computed is published. */
void engine_publish_outputs(Engine *e, const EngineComponent *m);
bool engine_finite(const double *y, size_t n);
/* Solve a loop by Newton's method from the published values on. Its first Jacobian is that of directional derivatives
 * where components offer them and of differences elsewhere; if its step does not reduce the residual, and where the
 * Jacobian is outdated, another one is of differences alone. Between them are Broyden's updates. NaN or Discard at a
 * trial point halves the step. Published values that solve the loop are left as they are. */
int engine_solve(Engine *e, int32_t loop);
/* The same after initialization, and again as long as discrete states of integrated components follow the values. */
int engine_solve_events(Engine *e, int32_t loop);
/* After first event iterations: outputs are published, and followers follow, once each and without further updates of
 * discrete states, but for loops with integrated components. Inputs with a delay have the values of initialization
 * until then. `before`: all values before the iterations, overwritten. */
int engine_follow_events(Engine *e, double *before);
size_t engine_loop_work(int32_t n);
/* Of all components: what was computed is published, and what is published becomes the previous value. */
void engine_publish(Engine *e);
/* Initialization: pass outputs to inputs, in order of execution, until no value changes but for rounding. Only those of
 * the components that `settles` says, NULL: all. Of values that still change, ENGINE_UNSETTLED, `before` is 1, else 0;
 * it has as many elements as there are values. Loops are solved from the start values of those outputs whose components
 * settle, and from the published values of the others. If values do not settle, the late loops are solved instead. */
int engine_settle(Engine *e, const bool *settles, double *before, size_t n_values);
int engine_settle_late(Engine *e, const bool *settles, double *before, size_t n_values);
/* One communication step of component number `number`. A failure is described by `call` and `status`. */
int engine_component(Engine *e, int32_t number, double t);
double engine_time(const Engine *e, int64_t tick);

#endif
