/* Values of a system's variables: see container.h. */
#include <stdlib.h>
#include <string.h>

#include "container.h"
#include "fmu_math.h"

static double read_double(const void *values, size_t i) { return ((const double *)values)[i]; }
static void write_double(void *values, size_t i, double value) { ((double *)values)[i] = value; }

static FmuStatus check_arrays(FmuInstance *self, const char *function, const void *refs, size_t n_refs,
    const void *values, size_t count) {
    const FmuStatus status = fmu_check_arrays(self, function, refs, n_refs, values, count);
    if (status != FMU_OK || n_refs == count) return status;
    return fmu_fail(self, FMU_ERROR, "%s: nValues is %zu, the variables have %zu", function, count, n_refs);
}

static const PlanVariable *lookup(FmuInstance *self, const char *function, FmuType type, unsigned reference) {
    if (reference >= (unsigned)P->n_variables) {
        (void)fmu_fail(self, FMU_ERROR, "%s: unknown value reference %u", function, reference);
        return NULL;
    }
    const PlanVariable *v = &P->variables[reference];
    if (v->type == type) return v;
    (void)fmu_fail(self, FMU_ERROR, "%s: variable %s is of type %s", function, v->name, fmu_type_name(v->type));
    return NULL;
}

static FmuStatus check_alive(FmuInstance *self, int32_t component) {
    if (!self->components[component].dead) return FMU_OK;
    return fmu_fail(self, FMU_ERROR, "component '%s' has failed permanently", P->components[component].name);
}

static FmuStatus value_of(FmuInstance *self, const PlanVariable *v, double *value) {
    if (v->role == FMU_TIME) {
        *value = fmu_time(self);
        return FMU_OK;
    }
    if (v->role == FMU_OUTPUT) {
        if (self->state->mode == MODE_INITIALIZATION) {
            const FmuStatus status = container_settle(self);
            if (status != FMU_OK) return status;
        }
        *value = self->values[v->slot];
        if (v->scale != 1.0 || v->shift != 0.0) *value = v->scale * *value + v->shift;
        return FMU_OK;
    }
    const FmuStatus alive = check_alive(self, v->component);
    if (alive != FMU_OK) return alive;
    const uint32_t status = component_get(&self->components[v->component], v->kind, v->reference, value, 1);
    return status > fmi3Warning ? container_failed(self, v->component, "getting a value", status) : FMU_OK;
}

FmuStatus fmu_get_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
    void *values, size_t count, FmuWrite write) {
    FmuStatus status = check_arrays(self, function, refs, n_refs, values, count);
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, type, refs[i]);
        if (!v) return FMU_ERROR;
        double value = 0.0;
        status = value_of(self, v, &value);
        if (status == FMU_OK) write(values, i, value);
    }
    return status;
}

FmuStatus fmu_get(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
    double *values, size_t count) {
    return fmu_get_as(self, function, type, refs, n_refs, values, count, write_double);
}

static FmuStatus check_settable(FmuInstance *self, const char *function, const PlanVariable *v, double value) {
    const unsigned before = MODE_INSTANTIATED | MODE_INITIALIZATION, mode = (unsigned)self->state->mode;
    const unsigned modes = v->role == FMU_INPUT       ? before | MODE_STEP
                           : v->role == FMU_PARAMETER ? before | (v->is_tunable ? (unsigned)MODE_STEP : 0u)
                                                      : 0u;
    if (!modes) return fmu_fail(self, FMU_ERROR, "%s: variable %s is calculated and cannot be set", function, v->name);
    if (!(modes & mode))
        return fmu_fail(self, FMU_ERROR, "%s: variable %s cannot be set in state '%s'", function, v->name,
            fmu_mode_name(self->state->mode));
    if (!isfinite(value))
        return fmu_fail(self, FMU_ERROR, "%s: value %g for %s is not finite", function, value, v->name);
    const bool is_signal = v->role == FMU_INPUT && v->type == FMU_FLOAT64; /* clipped by its component */
    if (!is_signal && !(value >= v->min && value <= v->max))
        return fmu_fail(self, FMU_ERROR, "%s: value %.9g for %s is outside its range [%.9g, %.9g]", function, value,
            v->name, v->min, v->max);
    return FMU_OK;
}

static uint32_t hand_over(FmuInstance *self, const PlanVariable *v, double value) {
    const uint32_t status = component_set(&self->components[v->component], v->kind, v->reference, &value, 1);
    if (status <= fmi3Warning && v->slot >= 0) self->values[v->slot] = value;
    return status;
}

/* The values of number k of the variables that are being set: in its component, or waiting for a tick, NaN if there is
 * none; and as it is shown. */
static void keep_old(FmuInstance *self, const PlanVariable *v, size_t k) {
    Component *m = &self->components[v->component];
    if (!component_later(m, v->reference, &self->old[k], false) &&
        component_get(m, v->kind, v->reference, &self->old[k], 1) > fmi3Warning)
        self->old[k] = NAN;
    if (v->slot >= 0) self->old[(size_t)P->n_variables + k] = self->values[v->slot];
}

static void put_back_old(FmuInstance *self, const PlanVariable *v, size_t k) {
    Component *m = &self->components[v->component];
    if (!component_later(m, v->reference, &self->old[k], true) && !isnan(self->old[k]) &&
        component_set(m, v->kind, v->reference, &self->old[k], 1) > fmi3Warning)
        self->state->mode = MODE_ERROR;
    if (v->slot >= 0) self->values[v->slot] = self->old[(size_t)P->n_variables + k];
}

FmuStatus fmu_set_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     const void *values, size_t count, FmuRead read) {
    FmuStatus status = check_arrays(self, function, refs, n_refs, values, count);
    /* First look at everything, then set it: a call that fails changes nothing. */
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, type, refs[i]);
        status = v ? check_settable(self, function, v, read(values, i)) : FMU_ERROR;
    }
    if (status != FMU_OK) return status;
    /* Before initialization a component tells no values. */
    const bool kept = self->state->mode != MODE_INSTANTIATED && n_refs <= (size_t)P->n_variables;
    size_t done = 0;
    for (; done < n_refs; done++) {
        const PlanVariable *v = &P->variables[refs[done]];
        if (kept) keep_old(self, v, done);
        const uint32_t said = hand_over(self, v, read(values, done));
        if (said <= fmi3Warning) continue;
        status = container_refused(self, v->component, v->name, said);
        break;
    }
    if (status != FMU_OK && kept)
        while (done-- > 0) put_back_old(self, &P->variables[refs[done]], done);
    self->state->settled = 0;
    return status;
}

FmuStatus fmu_set(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                  const double *values, size_t count) {
    return fmu_set_as(self, function, type, refs, n_refs, values, count, read_double);
}

/* ------------------------------------------------------------------ texts: parameters only */

/* The text that a component has, copied: the component may change its own at any call. */
static FmuStatus show_text(FmuInstance *self, const PlanVariable *v) {
    const FmuStatus alive = check_alive(self, v->component);
    if (alive != FMU_OK) return alive;
    const char *text;
    const uint32_t status = component_get_text(&self->components[v->component], v->reference, &text);
    if (status > fmi3Warning) return container_failed(self, v->component, "getting a value", status);
    char **shown = &self->shown[v - P->variables];
    if (*shown && strcmp(*shown, text) == 0) return FMU_OK; /* where it was told it stays */
    char *copy = malloc(strlen(text) + 1);
    if (!copy) return fmu_fail(self, FMU_ERROR, "%s: out of memory", v->name);
    free(*shown);
    *shown = strcpy(copy, text);
    return FMU_OK;
}

FmuStatus fmu_get_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
    const char *values[], size_t count) {
    FmuStatus status = check_arrays(self, function, refs, n_refs, values, count);
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, FMU_STRING, refs[i]);
        status = v ? show_text(self, v) : FMU_ERROR;
        if (status == FMU_OK) values[i] = self->shown[refs[i]];
    }
    return status;
}

FmuStatus fmu_set_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
    const char *const values[], size_t count) {
    const bool kept = self->state->mode != MODE_INSTANTIATED;
    FmuStatus status = check_arrays(self, function, refs, n_refs, values, count);
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const PlanVariable *v = lookup(self, function, FMU_STRING, refs[i]);
        status = v ? check_settable(self, function, v, 0.0) : FMU_ERROR;
        if (status == FMU_OK && !values[i])
            status = fmu_fail(self, FMU_ERROR, "%s: the value for %s is NULL", function, v->name);
        if (status == FMU_OK && kept) status = show_text(self, v);
    }
    if (status != FMU_OK) return status;
    size_t done = 0;
    for (; done < n_refs; done++) {
        const PlanVariable *v = &P->variables[refs[done]];
        const uint32_t said = component_set_text(&self->components[v->component], v->reference, values[done]);
        if (said <= fmi3Warning) continue;
        status = container_refused(self, v->component, v->name, said);
        break;
    }
    while (status != FMU_OK && kept && done-- > 0) {
        const PlanVariable *v = &P->variables[refs[done]];
        if (component_set_text(&self->components[v->component], v->reference, self->shown[refs[done]]) > fmi3Warning)
            self->state->mode = MODE_ERROR;
    }
    self->state->settled = 0;
    return status;
}
