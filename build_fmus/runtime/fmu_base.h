/* What an instance has toward its host, whatever is in it. */
#ifndef FMU_BASE_H
#define FMU_BASE_H

#include "fmu_core.h"

/* The first field of every FmuInstance. */
typedef struct {
    FmuLog log;
    void *adapter;
    int is_co_simulation;
    unsigned logging; /* one bit per category */
    int32_t *mode;    /* in the instance's state, so that saved states have it */
} FmuBase;

void fmu_base_use(FmuBase *base, int is_co_simulation, void *adapter, FmuLog log, int32_t *mode);

const char *fmu_mode_name(int32_t mode);
const char *fmu_type_name(FmuType type);
FmuStatus fmu_check_arrays(FmuInstance *self, const char *function, const void *refs, size_t n_refs, const void *values,
                           size_t count);
uint64_t fmu_hash(const void *data, size_t n); /* FNV-1a of words of 8 bytes, folded, then of the bytes left */

#endif
