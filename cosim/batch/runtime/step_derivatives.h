/* Derivatives of one step of an FMU, in a library beside it that importers may ignore.
 *
 * The step is the one that fmi3DoStep (fmi2DoStep) would take from a state, as fmi3SerializeFMUState gives it in Step
 * Mode: the solver steps or samples in [t, t + h), with the inputs and parameters of that state. The FMU itself is not
 * needed, and nothing is kept between calls. */
#ifndef STEP_DERIVATIVES_H
#define STEP_DERIVATIVES_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Knowns are the parameters, inputs and states, unknowns the states and outputs, in the order of a saved state. */
typedef struct {
    uint32_t parameters, inputs, states, outputs;
    size_t memory; /* bytes that a call works in */
} StepSizes;

typedef enum {
    STEP_FINE,
    STEP_NO_STATE, /* the bytes are no state of this FMU, or the step is no positive number or far too long */
    STEP_FAILED    /* a state diverges, or an output is not finite */
} StepStatus;

void step_derivatives_sizes(StepSizes *sizes);

/* Derivatives along n directions.
 * memory: of sizes.memory bytes, one for each thread.
 * state: the serialized state.
 * h: length of the step [s].
 * seeds: (n, knowns) the directions.
 * after: (unknowns) states and outputs after the step, those of fmi3DoStep to the last bit.
 * derivatives: (n, unknowns). Outputs that the step does not compute keep their value and have derivative 0.
 * sides: a number that is equal where two steps have taken the same sides of all comparisons of what depends on a
 *        direction (contact, limits, pieces of tables, active rows of quadratic programs). */
StepStatus step_derivatives(void *memory, const unsigned char *state, size_t size, double h, size_t n,
    const double *seeds, double *after, double *derivatives, uint64_t *sides);

#ifdef __cplusplus
}
#endif
#endif
