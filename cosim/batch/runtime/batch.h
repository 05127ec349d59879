/* A plan for many copies of a system, LANES of them side by side: see batch.c. Lines that do not begin with # are also
 * read by cffi. */
#ifndef BATCH_H
#define BATCH_H

#include "engine.h"

typedef unsigned (*BatchStep)(void *memory, double t, double h, unsigned of);

/* A component; what is not said here is as in EngineComponent. */
typedef struct {
    int32_t clock, check_before;
    double step;
    int32_t n_copies_before, n_copies;
    const EngineCopy *copies;
    int64_t timestamp_slot;
    const uint32_t *index;
    size_t n_inputs;
    const double *scale, *offset;
    const EngineExtrapolation *extrapolations;
    size_t n_extrapolations;
    uint32_t first, n_outputs;
    BatchStep run;           /* of lanes; NULL: scalar code */
    BatchStep begin;         /* of lanes: outputs before the first step */
    char *memory;            /* of lanes: of all groups */
    size_t stride;           /* bytes of one group */
    const uint32_t *to, *from; /* rows of inputs and outputs in the memory of a group */
    const uint8_t *to_type, *from_type; /* 0 real, 1 integer, 2 Boolean */
    const double *least, *most; /* limits of inputs that are no signals */
    int32_t checked;         /* inputs may be not finite, or beyond limits */
    Engine **alone;          /* of all copies: the exchange of one, in which the copy's component is bound */
    int32_t number;          /* of the component in there */
    const uint32_t *reads;   /* slots that its inputs come from */
    size_t n_reads;
} BatchComponent;

/* Why a copy has ended; result 0: it has not. */
typedef struct {
    int64_t tick;
    int32_t component, result, call; /* result: that of the engine, or BATCH_* */
    uint32_t status;
} BatchFailure;

enum { BATCH_LANE_FAILED = 100, BATCH_INPUT_REFUSED = 101, BATCH_STOPPED = 102, BATCH_UNSETTLED = 103 };

typedef struct {
    BatchComponent *components;
    int32_t n_components, n_discrete;
    const EngineClock *clocks; /* the last one is the recorder's */
    int32_t n_clocks;
    int64_t a, b, d;
    int64_t n_copies_of_system, n_groups;
    char *values;             /* of all groups: n_values of LANES numbers each */
    size_t n_values;
    uint8_t *alive;           /* of all copies, rounded up to whole groups: 1 where one runs */
    BatchFailure *failures;   /* of all copies */
    const uint32_t *recorded;
    const double *record_scale, *record_offset;
    const uint8_t *record_converted;
    size_t n_recorded;
    double *rows;             /* copies x n_rows x n_recorded */
    int64_t first_row, n_rows; /* number of the sample in the first row */
    const EngineStop *stops;  /* conditions that end a copy */
    int32_t n_stops;
    int64_t next_group;       /* to be done */
} Batch;

/* What one thread needs. */
typedef struct {
    int64_t *next;            /* of n_clocks */
    bool *due;
    int32_t *list;            /* of n_components */
    char *before;             /* n_values of LANES numbers */
} BatchWorker;

#endif
