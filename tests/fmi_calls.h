/* FMI 2.0 or 3.0 (-DFMI=2, -DFMI=3) under one set of names, for programs of the tests that are linked with the sources
 * of one FMU. */
#ifndef FMI_CALLS_H
#define FMI_CALLS_H

#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_model.h"

#include "fmi_names.h"

#if FMI == 2
static void logger(void *e, const char *name, Status status, const char *category, const char *message, ...) {
    char text[4096];
    va_list args;
    va_start(args, message);
    vsnprintf(text, sizeof text, message, args);
    va_end(args);
    (void)e, (void)name, (void)status, (void)category;
}

static Instance instantiate(const char *token, int co_simulation) {
    static const fmi2CallbackFunctions callbacks = {logger, NULL, NULL, NULL, NULL};
    return fmi2Instantiate("driver", co_simulation ? fmi2CoSimulation : fmi2ModelExchange, token, "", &callbacks, 0, 1);
}

static Status initialize(Instance c, double start) {
    Status status = fmi2SetupExperiment(c, 0, 0.0, start, 0, 0.0);
    return status == 0 ? fmi2EnterInitializationMode(c) : status;
}

static Status do_step(Instance c, double t, double h) { return fmi2DoStep(c, t, h, 1); }

static Status get(Instance c, unsigned vr, const FmuVariable *v, void *values) {
    return v->type == FMU_FLOAT64 ? fmi2GetReal(c, &vr, 1, values)
           : v->type == FMU_INT32 ? fmi2GetInteger(c, &vr, 1, values)
                                  : fmi2GetBoolean(c, &vr, 1, values);
}

static Status set(Instance c, unsigned vr, const FmuVariable *v, double value) {
    int i = v->type == FMU_FLOAT64 ? 0 : (int)value;
    return v->type == FMU_FLOAT64 ? fmi2SetReal(c, &vr, 1, &value)
           : v->type == FMU_INT32 ? fmi2SetInteger(c, &vr, 1, &i)
                                  : fmi2SetBoolean(c, &vr, 1, &i);
}

static Status derivative(Instance c, unsigned unknown, unsigned known, double *result) {
    double seed = 1.0;
    return fmi2GetDirectionalDerivative(c, &unknown, 1, &known, 1, &seed, result);
}
#else
static void logger(fmi3InstanceEnvironment e, Status status, const char *category, const char *message) {
    (void)e, (void)status, (void)category, (void)message;
}

static Instance instantiate(const char *token, int co_simulation) {
    return co_simulation
               ? fmi3InstantiateCoSimulation("driver", token, NULL, 0, 1, 0, 0, NULL, 0, NULL, logger, NULL)
               : fmi3InstantiateModelExchange("driver", token, NULL, 0, 1, NULL, logger);
}

static Status initialize(Instance c, double start) { return fmi3EnterInitializationMode(c, 0, 0.0, start, 0, 0.0); }

static Status do_step(Instance c, double t, double h) {
    fmi3Boolean event, terminate, early;
    double last;
    return fmi3DoStep(c, t, h, 1, &event, &terminate, &early, &last);
}

static Status get(Instance c, unsigned vr, const FmuVariable *v, void *values) {
    return v->type == FMU_FLOAT64 ? fmi3GetFloat64(c, &vr, 1, values, 1)
           : v->type == FMU_INT32 ? fmi3GetInt32(c, &vr, 1, values, 1)
                                  : fmi3GetBoolean(c, &vr, 1, values, 1);
}

static Status set(Instance c, unsigned vr, const FmuVariable *v, double value) {
    fmi3Int32 i = v->type == FMU_FLOAT64 ? 0 : (fmi3Int32)value;
    fmi3Boolean b = value != 0.0;
    return v->type == FMU_FLOAT64 ? fmi3SetFloat64(c, &vr, 1, &value, 1)
           : v->type == FMU_INT32 ? fmi3SetInt32(c, &vr, 1, &i, 1)
                                  : fmi3SetBoolean(c, &vr, 1, &b, 1);
}

static Status derivative(Instance c, unsigned unknown, unsigned known, double *result) {
    double seed = 1.0;
    return fmi3GetDirectionalDerivative(c, &unknown, 1, &known, 1, &seed, 1, result, 1);
}
#endif

static double start_of(const FmuVariable *v) {
    const int offset = v->role == FMU_PARAMETER ? 0
                       : v->role == FMU_INPUT   ? fmu_model.n_parameters
                                                : fmu_model.n_parameters + fmu_model.n_inputs;
    return fmu_model.start[offset + v->slot];
}

#endif
