/* How a saved state is laid out: a header, then the state. Linear models and lanes read this file for where things are.
 */

#ifndef SAVED_STATE_H
#define SAVED_STATE_H

#include <stdint.h>

enum SnapshotFormat {
    SNAPSHOT_MAGIC = 0x53464d55, /* 'SFMU'; also tells a foreign byte order */
    SNAPSHOT_VERSION = 3
};

struct FmuSnapshot {
    uint32_t magic, version;
    uint32_t is_co_simulation, reserved; /* the modes of the two interfaces differ */
    uint64_t model;    /* hash of the instantiation token */
    uint64_t length;   /* of the state block */
    uint64_t checksum; /* of the state block, once serialized; until then the address of this header, so that no bytes
                          pass for a state */
};

/* Everything that changes while simulating. No pointers: a copy is a saved state. */
typedef struct {
    double time, start_time, stop_time;
    int64_t sample; /* index of the next sample instant */
    int32_t mode;
    int32_t has_stop;
    int32_t started;     /* discrete: the first sample has been committed */
    int32_t start_valid; /* calculated start states agree with inputs and parameters */
    int32_t outputs_valid;
    int32_t derivatives_valid;
    double v[]; /* parameters, inputs, states, derivatives, outputs, warm starts of quadratic programs */
} State;

#endif
