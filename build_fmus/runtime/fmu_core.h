/* The part of the runtime that FMI 2.0 and FMI 3.0 share. */
#ifndef FMU_CORE_H
#define FMU_CORE_H

#include <stddef.h>
#include <stdint.h>

#include "fmu_model.h"

/* Numerically equal to fmi2Status and fmi3Status. */
typedef enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR, FMU_FATAL } FmuStatus;

/* Modes of an instance, as bits so that a set of allowed modes is a mask. */
typedef enum {
    MODE_INSTANTIATED = 1,
    MODE_INITIALIZATION = 2,
    MODE_EVENT = 4,
    MODE_CONTINUOUS_TIME = 8,
    MODE_STEP = 16,
    MODE_TERMINATED = 32,
    MODE_ERROR = 64,
    MODE_TICK = 128 /* event mode while the clock ticks: the sample is taken when discrete states are updated */
} FmuMode;

typedef void (*FmuLog)(void *adapter, FmuStatus status, const char *category, const char *message);

typedef struct FmuInstance FmuInstance;
typedef struct FmuSnapshot FmuSnapshot;

/* Life cycle. Allocates one block for everything the instance will ever need; NULL when out of memory. */
FmuInstance *fmu_create(int is_co_simulation, size_t adapter_size, FmuLog log);
void *fmu_adapter(FmuInstance *self);
/* The rest of creation, when messages can be sent: what it needs from the FMU's resources (a path, or a file URI). */
FmuStatus fmu_open(FmuInstance *self, const char *resources);
void fmu_free(FmuInstance *self);
int fmu_is_co_simulation(const FmuInstance *self);
FmuStatus fmu_set_logging(FmuInstance *self, const char *function, int on, size_t n, const char *const categories[]);
FmuMode fmu_mode(const FmuInstance *self);
void fmu_set_mode(FmuInstance *self, FmuMode mode);
FmuStatus fmu_fail(FmuInstance *self, FmuStatus status, const char *format, ...);

/* FMU_OK when the function may be called in the instance's mode, else the logged error. */
FmuStatus fmu_allowed(FmuInstance *self, unsigned modes, const char *function);

FmuStatus fmu_setup(FmuInstance *self, double start_time, int has_stop, double stop_time);
FmuStatus fmu_enter_initialization(FmuInstance *self);
FmuStatus fmu_exit_initialization(FmuInstance *self);
FmuStatus fmu_reset(FmuInstance *self);

/* Values. `count` is the number of values in the array (FMI 2.0: equal to the number of references). */
FmuStatus fmu_get(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                  double *values, size_t count);
FmuStatus fmu_set(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                  const double *values, size_t count);
/* Integers and Booleans pass through these two, element by element, without a buffer. */
int32_t fmu_to_int(double value);
typedef double (*FmuRead)(const void *values, size_t i);
typedef void (*FmuWrite)(void *values, size_t i, double value);
FmuStatus fmu_get_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     void *values, size_t count, FmuWrite write);
FmuStatus fmu_set_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     const void *values, size_t count, FmuRead read);
FmuStatus fmu_get_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
                        const char *values[], size_t count);
FmuStatus fmu_set_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
                        const char *const values[], size_t count);

/* Partial derivatives of unknowns by knowns, times a seed for each number of a known (directional) or of an unknown
 * (adjoint). */
typedef struct {
    int is_adjoint;
    const unsigned *unknowns;
    size_t n_unknowns;
    const unsigned *knowns;
    size_t n_knowns;
    const double *seed;
    size_t n_seed;
} FmuPartial;
FmuStatus fmu_partial_derivative(FmuInstance *self, const char *function, const FmuPartial *of, double *sensitivity,
    size_t n_sensitivity);

/* Co-Simulation. */
FmuStatus fmu_do_step(FmuInstance *self, const char *function, double time, double step);
double fmu_time(const FmuInstance *self);

/* Event mode of Co-Simulation, where the model has a clock: a sample is taken when it ticks, else by the step that
 * passes its instant. */
void fmu_use_events(FmuInstance *self);
int fmu_uses_events(const FmuInstance *self);
FmuStatus fmu_tick(FmuInstance *self, const char *function);
FmuStatus fmu_take_sample(FmuInstance *self, const char *function); /* where the clock ticks; then it does no more */
int fmu_ended(const FmuInstance *self); /* a step was discarded because the simulation shall end */

/* Model Exchange. */
FmuStatus fmu_set_time(FmuInstance *self, const char *function, double time);
FmuStatus fmu_set_states(FmuInstance *self, const char *function, const double *x, size_t n);
FmuStatus fmu_get_states(FmuInstance *self, const char *function, double *x, size_t n);
FmuStatus fmu_get_derivatives(FmuInstance *self, const char *function, double *dx, size_t n);
FmuStatus fmu_get_nominals(FmuInstance *self, const char *function, double *nominals, size_t n);

/* State of an instance. A snapshot is a copy of the instance's state block behind a header that names the component. */
FmuStatus fmu_snapshot(FmuInstance *self, const char *function, void **snapshot);
FmuStatus fmu_restore(FmuInstance *self, const char *function, const void *snapshot);
FmuStatus fmu_free_snapshot(FmuInstance *self, const char *function, void **snapshot);
FmuStatus fmu_serialized_size(FmuInstance *self, const char *function, const void *snapshot, size_t *size);
FmuStatus fmu_serialize(
    FmuInstance *self, const char *function, const void *snapshot, unsigned char *bytes, size_t size);
FmuStatus fmu_deserialize(
    FmuInstance *self, const char *function, const unsigned char *bytes, size_t size, void **snapshot);

#endif
