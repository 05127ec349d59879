/* A sampled component for firmware, which calls it once per sample. `Component` becomes the name of the component;
 * build_fmus/target/assemble.py puts this file behind the equations.
 *
 * A step computes what a step of the FMU computes, in the same order: results are bit-identical. */

#include <float.h>
#include <string.h>

#include "fmu_math.h"
#include "fmu_model.h"

static const FmuModel *const M = &fmu_model;

#ifndef TIME_OF /* [s], as in the FMU */
#define TIME_OF(sample) ((double)(sample) * M->sample_time)
#endif

static int all_finite_numbers(const double *values, int n) {
    int finite = 1;
    for (int i = 0; i < n; i++) finite &= fabs(values[i]) <= DBL_MAX;
    return finite;
}

static void copy_numbers(double *to, const double *from, int n) {
    for (int i = 0; i < n; i++) to[i] = from[i];
}

/* Whether a variable may have a value. Real inputs are signals: the equations clip those beyond their limits. */
static int is_legal(const FmuVariable *v, double value) {
    if (v->type != FMU_FLOAT64 && value != floor(value)) return 0;
    if (v->type == FMU_BOOLEAN) return value == 0.0 || value == 1.0;
    if (v->role == FMU_INPUT && v->type == FMU_FLOAT64) return 1;
    return value >= v->min && value <= v->max;
}

void Component_init(Component *self) {
    (void)memset(self, 0, sizeof *self);
    copy_numbers((double *)&self->parameters, M->start, M->n_parameters);
    copy_numbers(self->states, M->start + M->n_parameters + M->n_inputs, M->n_states);
    if (M->qp) M->qp->setup(self->program_work);
}

Component_status Component_set_parameter(Component *self, Component_parameter parameter, int element, double value) {
    if ((size_t)parameter >= (size_t)M->n_variables) return Component_UNKNOWN_PARAMETER;
    const FmuVariable *v = &M->variables[parameter];
    if (v->role != FMU_PARAMETER || element < 0 || element >= v->size) return Component_UNKNOWN_PARAMETER;
    if (self->started && !v->is_tunable) return Component_NOT_TUNABLE;
    if (!(fabs(value) <= DBL_MAX)) return Component_NOT_FINITE;
    if (!is_legal(v, value)) return Component_OUT_OF_RANGE;
    ((double *)&self->parameters)[v->slot + element] = value;
    self->prepared = 0;
    return Component_OK;
}

/* Start values that are calculated, with the first inputs, and relations between the parameters. */
static Component_status start_component(Component *self, const FmuArguments *at) {
    if (M->checks) {
        M->checks(at, self->checks);
        for (int i = 0; i < M->n_checks; i++)
            if (!(self->checks[i] > 0.0)) return Component_BAD_PARAMETERS;
    }
    if (M->start_states) {
        copy_numbers(self->next, self->states, M->n_states);
        M->start_states(at, self->next);
        if (!all_finite_numbers(self->next, M->n_states)) return Component_FAILED;
        copy_numbers(self->states, self->next, M->n_states);
    }
    self->started = 1;
    return Component_OK;
}

Component_status Component_step(Component *self, const Component_inputs *inputs, Component_outputs *outputs) {
    const double *u = (const double *)inputs;
    if (self->failed) return Component_FAILED;
    if (!all_finite_numbers(u, M->n_inputs)) return Component_NOT_FINITE;
    for (int i = 0; i < M->n_variables; i++) {
        const FmuVariable *v = &M->variables[i];
        for (int j = 0; v->role == FMU_INPUT && j < v->size; j++)
            if (!is_legal(v, u[v->slot + j])) return Component_OUT_OF_RANGE;
    }
    FmuArguments at = {.x = self->states, .u = u, .p = (const double *)&self->parameters, .f = self->fixed,
                       .s = self->program_solution, .w = self->work};
    if (M->prepare && !self->prepared) M->prepare(&at, self->fixed);
    self->prepared = 1;
    const Component_status status = self->started ? Component_OK : start_component(self, &at);
    if (status != Component_OK) return status;

    at.t = TIME_OF(self->sample);
    if (M->qp) {
        M->program_data(&at, self->program_data);
        M->qp->solve(self->program_work, self->program_memory, self->program_data, self->program_solution);
    }
    M->sample(&at, (double *)&self->results, self->next);
    if (!all_finite_numbers(self->next, M->n_states) ||
        !all_finite_numbers((const double *)&self->results, M->n_outputs)) {
        self->failed = 1;
        return Component_FAILED;
    }
    copy_numbers(self->states, self->next, M->n_states);
    *outputs = self->results;
    self->sample++;
    return Component_OK;
}
