/* What the master's process and the process of an isolated FMU share: the head of a call, four areas of bytes, and one
 * socket.
 *
 * One call at a time. The master writes head and request and raises `request`; the worker does the call and raises
 * `reply`. Each looks for the other's number for some microseconds, then waits at the socket, where the other rings
 * with one byte. Without shared memory the same head and areas travel through the socket. Lines that do not begin with
 * # are also read by cffi. */
#ifndef LINK_H
#define LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What the worker is asked to do. */
typedef enum {
    LINK_LOAD,
    LINK_INSTANTIATE,
    LINK_FREE,
    LINK_SETUP,
    LINK_ENTER,
    LINK_EXIT,
    LINK_TERMINATE,
    LINK_RESET,
    LINK_SET,
    LINK_GET,
    LINK_PLAN,
    LINK_STEP,
    LINK_STATUS,
    LINK_GET_STATE,
    LINK_SET_STATE,
    LINK_FREE_STATE,
    LINK_STATE_SIZE,
    LINK_SERIALIZE,
    LINK_DESERIALIZE,
    LINK_READ_BYTES,
    LINK_WRITE_BYTES,
    LINK_DERIVATIVE,
    LINK_INTEGRATE,
    LINK_INTEGRATOR,
    LINK_EVENTS,
    LINK_INTERVAL
} LinkOp;

/* How an isolated FMU was lost. */
typedef enum { LINK_ALIVE, LINK_DIED, LINK_TOO_SLOW, LINK_CANCELLED, LINK_LIED, LINK_INHERITED, LINK_RELEASED } LinkEnd;

enum {
    LINK_OK = 0, LINK_WARNING = 1, LINK_ERROR = 3, LINK_FATAL = 4, /* statuses of FMI */
    LINK_LOG = 1 << 16,  /* bytes for messages of one call */
    LINK_PLANNED = 16,   /* calls that fetch outputs with a step */
    LINK_FETCHING = 256  /* of Answer.failed: and which of these */
};

/* C types of values, in FMI 2.0 and 3.0. */
typedef enum {
    LINK_Real, LINK_Integer, LINK_Boolean2, LINK_String2, LINK_Float64, LINK_Float32, LINK_Int8, LINK_UInt8, LINK_Int16,
    LINK_UInt16, LINK_Int32, LINK_UInt32, LINK_Int64, LINK_UInt64, LINK_Boolean3, LINK_String3,
    LINK_Binary, LINK_Clock, LINK_TYPES
} LinkType;

/* When a clock ticks. */
typedef struct {
    double seconds;
    uint64_t counter, resolution;
    int32_t qualifier, reserved;
} LinkInterval;

/* Values of one type, in the request area: this head, `n_references` uint32_t, values; each begins at a multiple of 8
 * bytes. Of Binaries, the values are their sizes, uint64_t, and all bytes behind these. */
typedef struct {
    uint32_t type, n_references;
    uint64_t n_values;
} LinkValues;

#endif
