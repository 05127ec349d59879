/* Values that a double does not hold, in the vector of doubles: 64-bit integers, Strings and Binaries.
 *
 * Each has one slot for a number, the integer as a double or the length in bytes, and behind it slots for its bytes:
 * four in each, little-endian, as a whole number below 2^32. So they are copied, delayed and saved as all other values.
 * The functions here stand between the engine and the FMI function that sets or gets them. Nothing here allocates
 * memory, and there are no globals. Lines that do not begin with # are also read by cffi. */
#ifndef EXACT_VALUES_H
#define EXACT_VALUES_H

#include "engine.h"

typedef enum { EXACT_INT64, EXACT_UINT64, EXACT_STRING, EXACT_BINARY } ExactKind;

/* One value: number `element` of those that the call moves, at `at` of the slots. */
typedef struct ExactItem {
    uint32_t element, at;
    uint32_t size;               /* bytes at most */
    uint32_t text;               /* where its bytes begin in `texts` */
} ExactItem;

/* A call of fmi2GetString, fmi3GetInt64 and their like. */
typedef struct {
    uint32_t kind, version;      /* version of FMI: 2 or 3 */
    void *call;
    const uint32_t *references;
    size_t n_references, n_values;
    void *values;                /* of n_values: integers, or addresses of bytes */
    size_t *sizes;               /* of n_values: of Binaries */
    const ExactItem *items;
    size_t n_items;
    unsigned char *texts;        /* of the items, to be set; a String has a zero behind it */
    int64_t too_long;            /* item that is longer than its size, or -1 */
    uint64_t length;             /* which it has */
} ExactValues;

/* Setters and getters in the place of those of an FMU of FMI 2.0 or 3.0: `exact` is the address of an `ExactValues`,
 * `slots` are those of its items. */
uint32_t exact_set2(void *instance, const uint32_t *exact, size_t n, void *slots);
uint32_t exact_set3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots);
uint32_t exact_get2(void *instance, const uint32_t *exact, size_t n, void *slots);
uint32_t exact_get3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots);

#endif
