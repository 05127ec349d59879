/* What the generated plan.c says about a system: constants, which container_binding.c binds to an instance's memory. */
#ifndef SYSTEM_H
#define SYSTEM_H

#include "fmu_model.h"
#include "component.h"

/* What a call needs that moves texts, bytes or 64-bit integers, whose slots are in the values (exact_values.h). */
typedef struct {
    uint32_t kind, n_values, n_items, n_texts; /* n_texts: bytes */
    const struct ExactItem *items;
} PlanExact;

/* One call that moves all connected variables of one type. */
typedef struct {
    Kind kind;
    const uint32_t *references, *widths;
    uint32_t n_references;
    uint32_t n_data;                 /* elements of its variables, and of each one as in EngineTransfer */
    const uint32_t *element, *place; /* as in EngineTransfer; NULL: the data are u or y from `at` on */
    uint32_t n, at;
    uint32_t buffer;                 /* otherwise: where they are among the buffers, in bytes */
    bool waits;                      /* it sets discrete inputs of a component with event mode */
    const PlanExact *exact;          /* or NULL */
    bool keeps;                      /* it has elements that nobody drives, which keep their values */
} PlanTransfer;

/* A value that the system sets before initialization. */
typedef struct {
    Kind kind;
    uint32_t reference;
    uint32_t n;
    const double *values;
    const char *text;
    const unsigned char *bytes;
    const uint64_t *wide;            /* of KIND_INT64 and KIND_UINT64, bit by bit */
} PlanStart;

typedef struct {
    const char *name, *token;
    const char *resources;           /* its own, below those of the system */
    const char *folder, *identifier; /* of others: where its binaries are, below the resources; NULL: linked */
    int version;
    const void *functions;           /* of linked components: Functions2 or Functions3 */
    int32_t clock;
    double step;
    bool check_before;
    bool repeats;                    /* it is part of an algebraic loop, and computes its outputs in steps only */
    int32_t n_copies_before, n_copies;
    const EngineCopy *copies;
    int64_t timestamp_slot;
    const uint32_t *index;
    uint32_t n_inputs;
    bool in_place; /* inputs are values already, from `u` on; otherwise u is that much behind the values */
    uint32_t u;
    const double *scale, *offset;
    const EngineExtrapolation *extrapolations;
    uint32_t n_extrapolations;
    uint32_t first, n_outputs;
    const PlanTransfer *sets, *gets;
    int32_t n_sets, n_gets;
    const PlanStart *starts;
    uint32_t n_starts;
    bool has_tolerance;
    double tolerance;
    const Exchange *exchange;        /* NULL: it steps itself */
    bool integrated;
    bool begins_with_events;
    const void *setup;               /* IntegratorSetup, EventSetup or ClockedSetup; or NULL */
    const UpdateSetup *follows;      /* NULL: no input follows inside its steps */
    const uint32_t *exchange_references;
    const ExchangeCall *exchange_calls; /* of a linked one */
} PlanComponent;

/* A variable of the system's FMU; its value reference is its index. */
typedef struct {
    const char *name;
    FmuType type;
    FmuRole role;                    /* time, parameter, input, output */
    bool is_tunable;
    double min, max;
    int32_t component;                  /* parameters and inputs: whose, and which */
    Kind kind;
    uint32_t reference;
    int64_t slot;                    /* outputs; of others where their value is shown too, or -1 */
    double scale, shift;             /* outputs: shown as scale * value + shift */
} PlanVariable;

/* A parameter that another component calculates: in initialization `to` becomes scale * `from` + offset. Texts, bytes
 * and 64-bit integers of the same kind are `exact`: they become what `from` is. */
typedef struct {
    const char *name;
    struct {
        int32_t component;
        Kind kind;
        uint32_t reference, n, index;   /* one of n elements */
    } from, to;
    double scale, offset, min, max;
    bool exact;
} PlanPassed;

/* Components whose clocks are connected, with `ClockTick` and `ClockWire`. */
typedef struct {
    const int32_t *components;
    const struct ClockTick *ticks;
    const struct ClockWire *wires;
    int32_t n_components, n_ticks, n_wires;
} PlanNetwork;

typedef struct {
    size_t (*room)(const PlanNetwork *p);  /* bytes of memory that one needs */
    void (*join)(Component *components, const PlanNetwork *p, void *memory);
    uint32_t (*begin)(void *memory);       /* after all have left initialization */
} Networks;
extern const Networks networks;

/* Calls with `exact`: bytes of memory that one needs; binding it, at first as if it were another one; bytes of the
 * value that was too long and those that it may have, 0 if none was. */
typedef struct {
    size_t (*room)(const PlanTransfer *p);
    void (*bind)(const Component *m, const PlanTransfer *p, bool set, void *memory, EngineTransfer *t);
    uint64_t (*too_long)(const void *memory, uint32_t *most);
} Texts;
extern const Texts texts;

typedef struct {
    const PlanComponent *components;
    int32_t n_components, n_discrete;
    const EngineClock *clocks;
    int32_t n_clocks;
    const EngineLoop *loops;         /* without work */
    int32_t n_loops, n_running;      /* all, and those that are solved after initialization too */
    int32_t n_late;                  /* the last ones, Engine.n_late */
    const EngineFollower *followers;
    int32_t n_followers;
    int64_t a, d;                    /* the tick is a / d seconds */
    uint32_t n_values, n_u, n_buffer; /* doubles, doubles, bytes */
    uint32_t n_published;
    const char *const *owners;       /* of each value: "component.variable" */
    const PlanVariable *variables;
    int32_t n_variables;
    const PlanPassed *passed;
    uint32_t n_passed;
    int fmi;                         /* version of the system's own functions */
    bool can_save;
    void *(*open)(const char *resources, const char *folder, const char *identifier, int version, void *functions,
        bool exchange, char *reason, size_t n_reason); /* third-party FMUs; NULL: there are none */
    void (*close)(void *library);
    ExchangeCall (*find)(void *library, int version, const char *name);
    const Networks *networks;          /* NULL: no clocks are connected */
    const PlanNetwork *connected;
    int32_t n_connected;
    const Updates *updates;            /* NULL: no component's inputs follow inside its steps */
    const Texts *texts;                /* NULL: no call has `exact` */
} Plan;

extern const Plan plan;

#endif
