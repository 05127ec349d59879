/* Steps of Co-Simulation FMUs of FMI 3.0 with clocks (FMI 3.0, 2.2.9, 4.2): one alone, or several whose clocks are
 * connected, a network, which take their steps together.
 *
 * A communication step from t to t + h holds the ticks in [t, t + h). All FMUs of a network do `fmi3DoStep` to the next
 * time at which one has an event that is known before (a tick of a time-based clock, `nextEventTime`), or to the end.
 * FMUs that may return early step first. Where one does, the others step to that time only; those that are beyond go
 * back to their saved states. There, those with an event are in event mode:
 *
 * 1. Their time-based clocks tick, and inputs of these clocks are set. At t inputs that are discrete without a clock
 *    are set too.
 * 2. Output clocks that tick are read. What is connected to such a clock ticks at once: its FMU is in event mode too,
 *    and reads the inputs of this clock as the other FMUs have them at this time. Its own output clocks are read then.
 * 3. When no output clock is left, outputs of clocks that tick are read, and the discrete states of all of them are
 *    updated. Those that need another update begin at 2 again.
 *
 * So a tick, and what belongs to it, takes no time on any number of connections. What a clock computes shows until it
 * ticks again. Events that an FMU reports only after a step (`eventHandlingNeeded`) are processed at its end. Other
 * values travel by the rule of exchange; continuous inputs are set at once, also between steps.
 *
 * Where an FMU asks for the end of the simulation after its step to t + h, the others take theirs, and events at t + h
 * are left. The step function then says so, as `fmi3DoStep` does: `terminateSimulation`, with `earlyReturn` unless all
 * FMUs have reached t + h.
 *
 * A constant clock has its interval in modelDescription.xml; a fixed or tunable one there, or the FMU says it at the
 * end of initialization, and of a tunable one again when a parameter was set; a changing one at each tick; a countdown
 * in any event mode, if it is known. Triggered input clocks tick when the clock does that is connected to them.
 *
 * Nothing here allocates memory, and there are no globals. Lines that do not begin with # are also read by cffi. */
#ifndef CLOCKED_STEPS_H
#define CLOCKED_STEPS_H

#include "adaptive.h"

/* Functions of the FMU, in the order of `ClockedFmu.call`; `clocked_calls.function` has their names. */
typedef enum {
    CLOCKED_DO_STEP, CLOCKED_ENTER, CLOCKED_UPDATE, CLOCKED_LEAVE, CLOCKED_SET_CLOCK, CLOCKED_GET_CLOCK,
    CLOCKED_INTERVAL, CLOCKED_INTERVAL_FRACTION, CLOCKED_SHIFT, CLOCKED_SHIFT_FRACTION,
    CLOCKED_SAVE, CLOCKED_RESTORE, CLOCKED_FREE, CLOCKED_VALUES
} ClockedFunction;

/* Why a step has failed. */
typedef enum {
    CLOCKED_FINE,
    CLOCKED_CALL_FAILED,    /* `function` returned `status`, or ended the step; of CLOCKED_VALUES number `call` */
    CLOCKED_TERMINATED,     /* it asks for the end of the simulation in event mode */
    CLOCKED_NOT_CONVERGED,  /* every update of discrete states requires another one */
    CLOCKED_TICKS_AGAIN,    /* after every update */
    CLOCKED_TOO_MANY,       /* ticks and early returns in one communication step */
    CLOCKED_FIXED_STEP,     /* a clock ticks within a step, which cannot be divided */
    CLOCKED_BAD_TIME,       /* it returned early at time `value`, outside of the step */
    CLOCKED_BAD_EVENT,      /* the next event is at NaN */
    CLOCKED_BAD_INTERVAL,   /* an interval that no clock can have */
    CLOCKED_BAD_SHIFT
} ClockedEnd;

typedef enum {
    CLOCK_OUTPUT, CLOCK_TRIGGERED, CLOCK_PERIODIC, CLOCK_TUNABLE, CLOCK_CHANGING, CLOCK_COUNTDOWN
} ClockKind;

/* Seconds: n / d exactly; with d = 0 only as a double. */
typedef struct {
    int64_t n, d;
    double value;
} ClockedTime;

typedef struct {
    const char *name;
    uint32_t reference;
    ClockKind kind;
    bool given;                 /* interval and shift are those of modelDescription.xml */
    bool fractions;             /* the FMU says them as fractions */
    ClockedTime interval, shift;
} ClockSetup;

/* Values that are moved together. */
typedef struct {
    uint32_t first, n;          /* which of the calls that set or get */
    const uint32_t *clocks;     /* that they belong to, none: to no clock; n_clocks of the FMU for an unknown one */
    uint32_t n_clocks;
    int32_t waits;              /* connected: -1; else place in u that is not 0 while a value waits for a tick */
    bool at_events;             /* inputs that are discrete without belonging to a clock */
    bool at_first;              /* outputs that initialization computes */
} ClockedGroup;

typedef struct {
    const char *name;
    const ClockSetup *clocks;   /* by value reference */
    const ClockedGroup *inputs, *outputs;
    uint32_t n_clocks, n_inputs, n_outputs;
    uint32_t n_u, n_y;          /* values */
    bool variable_step, returns_early;
} ClockedSetup;

/* When a clock ticks next: at (base + count * interval) / d [s]; with d = 0 at base_value + count * interval_value. */
typedef struct {
    int64_t base, interval, d, count;
    double base_value, interval_value; /* infinite: not known yet */
} ClockDue;

/* What continues from step to step beside the FMU's own state, and `due` and the values in u and y. */
typedef struct {
    double now, next_event;     /* [s]; infinite: none is announced */
    int32_t ends, reserved;     /* it has asked for the end in event mode, where it stays: its network takes no step */
} ClockedMemory;

typedef struct ClockedNetwork ClockedNetwork;
typedef struct ClockedFmu ClockedFmu;

/* `clock` of FMU `target` of a network ticks when `origin` of `source` does, an output clock or a time-based one. */
typedef struct ClockTick {
    int32_t source, origin, target, clock;
} ClockTick;

/* An input that belongs to clocks, and the output of another FMU that drives it: u[to] = scale * y[from] + offset. */
typedef struct ClockWire {
    int32_t source, target;
    uint32_t from, to, n;
    double scale, offset;
    const uint32_t *clocks;     /* of the input */
    uint32_t n_clocks;
    bool plain;                 /* the output belongs to no clock */
} ClockWire;

typedef struct {
    uint32_t end, function, status;
    int32_t call;               /* k > 0: set number k - 1, k < 0: get number -k - 1 */
    ClockedFmu *fmu;
    uint32_t clock;
    double time, until, value;  /* [s]; the step is from `time` to `until` */
} ClockedReport;

struct ClockedNetwork {
    ClockedFmu **fmus;          /* of n_fmus, as the next three */
    ClockedFmu **order, **queue, **reached; /* that are to be updated; whose clocks are to be read; that were ticked */
    int32_t n_fmus, n_order, n_reached;
    const ClockTick *ticks;
    const ClockWire *wires;
    int32_t n_ticks, n_wires;
    uint32_t environment;       /* of the caller (environment.h) */
    Engine engine;              /* what calls that move values fail with */
    ClockedReport report;
};

struct ClockedFmu {
    ClockedNetwork *network, own; /* own: of this FMU alone */
    const ClockedSetup *setup;
    void *owner;
    void *call[CLOCKED_VALUES];
    EngineComponent values;     /* u: inputs as the exchange has them; y: outputs as they were read last */
    const EngineTransfer *sets, *gets;
    double *shown;              /* the outputs in the exchange */
    const EngineAdaptive *adaptive; /* in a run with a tolerance: what drives inputs of clocks */
    const ClockWire *followed;  /* of n_followed elements: u[to] = scale * (its output `from` at a tick) + offset */
    size_t n_followed;
    bool *flags;                /* event, (not used), terminate, early */
    double *last;
    ClockDue *due;              /* of n_clocks, as all up to `truths` */
    uint32_t *references;
    bool *told, *truths;
    uint8_t *ticking, *active, *sent, *hit, *fresh, *every; /* sets of clocks */
    bool stepping, tuned, arrived, inside, listed, queued, no_set_prior, dead, foreign;
    void *state;
    double saved;               /* time of `state` */
    uint32_t changed;           /* what it has changed of the floating-point environment (environment.h) */
    ClockedMemory memory;
    ClockedFmu *self[4];
};

/* The functions here. All that return a number return a status of FMI; above 1 see `report` of the network. */
typedef struct {
    const char *(*function)(uint32_t number);
    size_t (*size)(const ClockedSetup *setup);
    /* An FMU alone, in memory of this size; `call`, sets, gets, shown, flags and last are still to be filled in. */
    ClockedFmu *(*make)(void *memory, const ClockedSetup *setup, void *instance);
    /* FMUs take their steps together from now on. `pointers`: of 4 n, the first n are the FMUs. */
    void (*join)(ClockedNetwork *network, ClockedFmu **pointers, int32_t n);
    /* Before the FMU leaves initialization, which began at time t: intervals of its clocks. */
    uint32_t (*intervals)(ClockedFmu *f, double t);
    /* After initialization, those FMUs of a network that have not begun leave the event mode together. */
    uint32_t (*begin)(ClockedNetwork *network);
    /* Before and after a change of values between steps. */
    uint32_t (*enter)(ClockedFmu *f), (*leave)(ClockedFmu *f);
    /* The setter, the getter and the step function; the last FMU of a network takes the step for all. */
    EngineValues3 set, get;
    EngineStep3 step;
    /* What the report says, as a sentence without the component's name. */
    void (*why)(const ClockedNetwork *network, char *text, size_t size);
} ClockedCalls;
extern const ClockedCalls clocked_calls;

#endif
