/* A plan for many copies of a system, LANES of them side by side: see batch.c. Lines that do not begin with # are also
 * read by cffi. */
#ifndef BATCH_H
#define BATCH_H

#include "engine.h"

/* The sides of comparisons that a component with derivatives has taken (numbers.h): all of a run so far, those of the
 * last step, in how many steps they were others than in the one before, those of the first step where nothing was noted
 * before, and whether the last step was over plain numbers. Steps with a tie, and the time of the first of them. */
typedef struct {
    uint64_t all, last, changes, first, plain, ties;
    double tie;
} Sides;

typedef unsigned (*BatchStep)(void *memory, double t, double h, unsigned of);

/* What EngineComponent does not say of a component. */
typedef struct {
    const uint32_t *index;   /* of all inputs; that of EngineComponent may be missing */
    size_t n_inputs;
    BatchStep run;           /* of lanes; NULL: scalar code */
    BatchStep begin;         /* of lanes: outputs before the first step */
    char *memory;            /* of lanes: of all groups */
    size_t stride;           /* bytes of one group */
    size_t sides;            /* where in them its Sides are; 0: nowhere */
    const uint32_t *to, *from; /* rows of inputs and outputs in the memory of a group */
    const uint8_t *to_type, *from_type; /* 0 real, 1 integer, 2 Boolean */
    const double *least, *most; /* limits of inputs that are no signals */
    int32_t checked;         /* inputs may be not finite, or beyond limits */
    int32_t followed;        /* what is read depends on it; else it needs no derivatives */
    Engine **alone;          /* of all copies: the exchange of one, in which the copy's component is bound */
    const uint32_t *reads;   /* slots that its inputs come from */
    size_t n_reads;
    char *samples;           /* of a table with derivatives: its numbers, for each copy row by row; else NULL */
    Engine **probes;         /* of numbers with derivatives: for each copy and direction two that are a little apart */
} BatchComponent;

/* Why a copy has ended; result 0: it has not. */
typedef struct {
    int64_t tick;
    int32_t component, result, call; /* result: that of the engine, or BATCH_* */
    uint32_t status;
} BatchFailure;

enum {
    BATCH_LANE_FAILED = 100,
    BATCH_INPUT_REFUSED = 101,
    BATCH_STOPPED = 102,
    BATCH_UNSETTLED = 103,
    BATCH_PROBE_FAILED = 104
};

typedef struct {
    BatchComponent *components;
    int64_t n_copies_of_system, n_groups;
    char *values;             /* of all groups: n_values of LANES numbers each */
    size_t n_values;
    uint8_t *alive;           /* of all copies, rounded up to whole groups: 1 where one runs */
    BatchFailure *failures;   /* of all copies */
    const uint32_t *recorded;
    const double *record_scale, *record_offset;
    const uint8_t *record_converted;
    size_t n_recorded;
    double *rows;             /* copies x n_rows x n_recorded, each a value and its derivatives */
    const double *apart;      /* of each copy and direction: how far along it, to either side; 0 where nothing moves */
    uint64_t *sides;          /* copies x n_rows x n_components; NULL: not recorded */
    size_t n_components;
    int64_t first_row, n_rows; /* number of the sample in the first row */
    int64_t next_group;       /* to be done */
} Batch;

/* What one thread needs. */
typedef struct {
    Engine engine;            /* the plan, with lists of its own; its values are those of the group at hand */
    char *before;             /* n_values of LANES numbers */
} BatchWorker;

/* How numbers follow from others (adjoints.h). Entry i is a number: operands ends[i - 1] to ends[i] are the indices of
 * those that it follows from, `slopes` its derivatives by them. A tape that is full has at least `most` operands, or
 * more entries than `mask`, a power of two less one; behind `most` there is space for the operands of one entry. */
enum { TAPE_SPARE = 4096 };
typedef unsigned long long TapeCount; /* no uint64_t: to a compiler an index in memory is never one of the counts */
typedef struct {
    double *slopes;
    uint32_t *operands, *ends;
    TapeCount most, mask;
    TapeCount n_operands, n;
} Tape;

#endif
