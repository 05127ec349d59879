/* Logging, modes and checks of arguments: what every instance needs, whether it is a component or a system of them. */

#include "fmu_base.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "fmu_math.h"

#define MESSAGE_LENGTH 1024

static FmuBase *base_of(FmuInstance *self) { return (FmuBase *)(void *)self; }

void fmu_base_use(FmuBase *base, int is_co_simulation, void *adapter, FmuLog log, int32_t *mode) {
    *base = (FmuBase){.log = log, .adapter = adapter, .is_co_simulation = is_co_simulation, .mode = mode,
                      .logging = ~0u & ~(1u << FMU_OK)}; /* without debug logging, errors still tell what is wrong */
}

void *fmu_adapter(FmuInstance *self) { return base_of(self)->adapter; }
int fmu_is_co_simulation(const FmuInstance *self) { return ((const FmuBase *)(const void *)self)->is_co_simulation; }
FmuMode fmu_mode(const FmuInstance *self) { return (FmuMode)*((const FmuBase *)(const void *)self)->mode; }

/* By status; modelDescription.xml lists the same. */
static const char *const categories[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError",
                                         "logStatusFatal"};

FmuStatus fmu_fail(FmuInstance *self, FmuStatus status, const char *format, ...) {
    const FmuBase *base = base_of(self);
    char message[MESSAGE_LENGTH];
    if (!(base->logging >> status & 1u)) return status;
    va_list args;
    va_start(args, format);
    (void)vsnprintf(message, sizeof message, format, args);
    va_end(args);
    if (base->log) (*base->log)(base->adapter, status, categories[status], message);
    return status;
}

FmuStatus fmu_set_logging(FmuInstance *self, const char *function, int on, size_t n, const char *const names[]) {
    if (n && !names) return fmu_fail(self, FMU_ERROR, "%s: NULL array argument", function);
    unsigned mask = 0;
    for (size_t i = 0; i < n; i++) {
        unsigned found = 0;
        for (unsigned k = 0; k < sizeof categories / sizeof *categories; k++)
            if (names[i] && strcmp(names[i], categories[k]) == 0) found = 1u << k;
        if (!found)
            return fmu_fail(self, FMU_ERROR, "%s: unknown log category '%s'", function, names[i] ? names[i] : "");
        mask |= found;
    }
    base_of(self)->logging = !on ? 0u : n ? mask : ~0u;
    return FMU_OK;
}

const char *fmu_mode_name(int32_t mode) {
    switch (mode) {
        case MODE_INSTANTIATED: return "instantiated";
        case MODE_INITIALIZATION: return "initialization mode";
        case MODE_EVENT:
        case MODE_TICK: return "event mode";
        case MODE_CONTINUOUS_TIME: return "continuous-time mode";
        case MODE_STEP: return "step mode";
        case MODE_TERMINATED: return "terminated";
        default: return "error";
    }
}

FmuStatus fmu_allowed(FmuInstance *self, unsigned modes, const char *function) {
    if (modes & (unsigned)fmu_mode(self)) return FMU_OK;
    return fmu_fail(self, FMU_ERROR, "%s: not allowed in state '%s'", function, fmu_mode_name((int32_t)fmu_mode(self)));
}

const char *fmu_type_name(FmuType type) {
    if (type == FMU_STRING) return "String";
    return type == FMU_FLOAT64 ? "Float64 (Real)" : type == FMU_INT32 ? "Int32 (Integer)" : "Boolean";
}

FmuStatus fmu_check_arrays(FmuInstance *self, const char *function, const void *refs, size_t n_refs, const void *values,
                           size_t count) {
    if ((n_refs && !refs) || (count && !values)) return fmu_fail(self, FMU_ERROR, "%s: NULL array argument", function);
    return FMU_OK;
}

/* Nearest value that fits, 0 for NaN: other conversions are undefined in C. */
int32_t fmu_to_int(double value) {
    if (isnan(value)) return 0;
    return value >= (double)INT32_MAX ? INT32_MAX : value <= (double)INT32_MIN ? INT32_MIN : (int32_t)value;
}

uint64_t fmu_hash(const void *data, size_t n) {
    const unsigned char *bytes = data;
    uint64_t h = 14695981039346656037ull, word;
    size_t i = 0;
    for (; n - i >= sizeof word; i += sizeof word) {
        memcpy(&word, bytes + i, sizeof word);
        h = (h ^ word ^ (word >> 32)) *
            1099511628211ull; /* the highest bits, such as signs, would reach no other bit */
    }
    for (; i < n; i++) h = (h ^ bytes[i]) * 1099511628211ull;
    return h;
}
