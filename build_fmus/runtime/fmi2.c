/* FMI 2.0 entry points: arguments and state machine; the work is done in fmu_core.c. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu_core.h"

typedef struct {
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char name[];
} Adapter;

#define ANY_MODE 127u
#define READABLE (MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_STEP | MODE_TERMINATED | MODE_ERROR)
#define WRITABLE (MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_STEP)
#define WRITABLE_DISCRETE (WRITABLE & ~MODE_CONTINUOUS_TIME) /* all that is not a floating-point number */
#define RUNNING (MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_STEP)

/* Every function starts with the modes in which it may be called. */
#define ENTER(modes)                                                    \
    FmuInstance *self = (FmuInstance *)c;                               \
    if (!self) return fmi2Error;                                        \
    if (fmu_allowed(self, (modes), __func__) != FMU_OK) return fmi2Error

/* Messages are passed as the printf format that FMI 2.0 asks for, so '%' is doubled. */
static void send(const Adapter *a, FmuStatus status, const char *category, const char *message) {
    char format[2048];
    size_t n = 0;
    if (!a->logger) return;
    for (; *message && n + 2 < sizeof format; message++) {
        if (*message == '%') format[n++] = '%';
        format[n++] = *message;
    }
    format[n] = '\0';
    a->logger(a->environment, a->name, (fmi2Status)status, category, format);
}

static void log_message(void *adapter, FmuStatus status, const char *category, const char *message) {
    send((const Adapter *)adapter, status, category, message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
    fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions, fmi2Boolean visible,
    fmi2Boolean loggingOn) {
    (void)visible;
    const char *reason = NULL;
    if (!functions) return NULL;
    if (!instanceName || !*instanceName) reason = "fmi2Instantiate: instanceName is missing";
    else if (!fmuGUID || strcmp(fmuGUID, fmu_model.token) != 0)
        reason =
            "fmi2Instantiate: fmuGUID is not that of this FMU; modelDescription.xml and binary do not belong together";
    else if (fmuType == fmi2ModelExchange && !fmu_model.is_continuous)
        reason = "fmi2Instantiate: this FMU offers Co-Simulation only";
    else if (fmuType != fmi2ModelExchange && fmuType != fmi2CoSimulation)
        reason = "fmi2Instantiate: fmuType is neither ModelExchange nor CoSimulation";
    if (reason) {
        if (functions->logger)
            functions->logger(
                functions->componentEnvironment, instanceName ? instanceName : "", fmi2Error, "logStatusError", reason);
        return NULL;
    }
    const size_t length = strlen(instanceName) + 1;
    FmuInstance *self = fmu_create(fmuType == fmi2CoSimulation, sizeof(Adapter) + length, log_message);
    if (!self) return NULL;
    Adapter *a = fmu_adapter(self);
    a->logger = functions->logger;
    a->environment = functions->componentEnvironment;
    memcpy(a->name, instanceName, length);
    if (fmu_open(self, fmuResourceLocation) != FMU_OK) {
        fmu_free(self);
        return NULL;
    }
    if (loggingOn) (void)fmu_set_logging(self, __func__, 1, 0, NULL);
    return self;
}

void fmi2FreeInstance(fmi2Component c) {
    if (c) fmu_free((FmuInstance *)c);
}

fmi2Status fmi2SetDebugLogging(
    fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[]) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_set_logging(self, __func__, loggingOn, nCategories, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    (void)toleranceDefined;
    (void)tolerance;
    ENTER(MODE_INSTANTIATED);
    return (fmi2Status)fmu_setup(self, startTime, stopTimeDefined, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    ENTER(MODE_INSTANTIATED);
    return (fmi2Status)fmu_enter_initialization(self);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    ENTER(MODE_INITIALIZATION);
    return (fmi2Status)fmu_exit_initialization(self);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    ENTER(RUNNING);
    fmu_set_mode(self, MODE_TERMINATED);
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_reset(self);
}

/* ------------------------------------------------------------------ values */

static double read_int(const void *values, size_t i) { return (double)((const int *)values)[i]; }
static double read_flag(const void *values, size_t i) { return ((const int *)values)[i] ? 1.0 : 0.0; }
static void write_int(void *values, size_t i, double value) { ((int *)values)[i] = fmu_to_int(value); }
static void write_flag(void *values, size_t i, double value) { ((int *)values)[i] = value != 0.0; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    ENTER(READABLE);
    return (fmi2Status)fmu_get(self, __func__, FMU_FLOAT64, vr, nvr, value, nvr);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    ENTER(READABLE);
    return (fmi2Status)fmu_get_as(self, __func__, FMU_INT32, vr, nvr, value, nvr, write_int);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    ENTER(READABLE);
    return (fmi2Status)fmu_get_as(self, __func__, FMU_BOOLEAN, vr, nvr, value, nvr, write_flag);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    ENTER(WRITABLE);
    return (fmi2Status)fmu_set(self, __func__, FMU_FLOAT64, vr, nvr, value, nvr);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[]) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi2Status)fmu_set_as(self, __func__, FMU_INT32, vr, nvr, value, nvr, read_int);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi2Status)fmu_set_as(self, __func__, FMU_BOOLEAN, vr, nvr, value, nvr, read_flag);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    ENTER(READABLE);
    return (fmi2Status)fmu_get_texts(self, __func__, vr, nvr, value, nvr);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[]) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi2Status)fmu_set_texts(self, __func__, vr, nvr, value, nvr);
}

/* ------------------------------------------------------------------ state */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_snapshot(self, __func__, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_restore(self, __func__, FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_free_snapshot(self, __func__, FMUstate);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_serialized_size(self, __func__, FMUstate, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte bytes[], size_t size) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_serialize(self, __func__, FMUstate, (unsigned char *)bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *FMUstate) {
    ENTER(ANY_MODE);
    return (fmi2Status)fmu_deserialize(self, __func__, (const unsigned char *)bytes, size, FMUstate);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t nUnknowns,
                                        const fmi2ValueReference knowns[], size_t nKnowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    ENTER(MODE_INITIALIZATION | RUNNING | MODE_TERMINATED);
    const FmuPartial of = {0, unknowns, nUnknowns, knowns, nKnowns, seed, nKnowns};
    return (fmi2Status)fmu_partial_derivative(self, __func__, &of, sensitivity, nUnknowns);
}

/* ------------------------------------------------------------------ model exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    ENTER(MODE_CONTINUOUS_TIME | MODE_EVENT);
    fmu_set_mode(self, MODE_EVENT);
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *eventInfo) {
    ENTER(MODE_EVENT);
    if (!eventInfo) return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    memset(eventInfo, 0, sizeof *eventInfo);
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    ENTER(MODE_EVENT);
    fmu_set_mode(self, MODE_CONTINUOUS_TIME);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER(MODE_CONTINUOUS_TIME);
    if (!enterEventMode || !terminateSimulation)
        return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *enterEventMode = *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    ENTER(MODE_EVENT | MODE_CONTINUOUS_TIME);
    return (fmi2Status)fmu_set_time(self, __func__, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
    ENTER(MODE_CONTINUOUS_TIME);
    return (fmi2Status)fmu_set_states(self, __func__, x, nx);
}

/* Functions of model exchange that may also be called while initializing: refuse them on a co-simulation instance. */
#define ENTER_MODEL_EXCHANGE(modes) \
    ENTER(modes);                   \
    if (fmu_is_co_simulation(self)) \
    return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: the instance was created for Co-Simulation", __func__)

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi2Status)fmu_get_derivatives(self, __func__, derivatives, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni) {
    (void)eventIndicators;
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    if (ni) return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: there are no event indicators", __func__);
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi2Status)fmu_get_states(self, __func__, x, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t nx) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi2Status)fmu_get_nominals(self, __func__, nominals, nx);
}

/* ------------------------------------------------------------------ co-simulation */

fmi2Status fmi2SetRealInputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    ENTER(MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_STEP);
    return (fmi2Status)fmu_fail(
        self, FMU_ERROR, "%s: inputs are not interpolated (canInterpolateInputs is false)", __func__);
}

fmi2Status fmi2GetRealOutputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[]) {
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    ENTER(MODE_STEP | MODE_TERMINATED | MODE_ERROR);
    return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: output derivatives are not provided", __func__);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER(MODE_STEP);
    return (fmi2Status)fmu_do_step(self, __func__, currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    ENTER(MODE_STEP);
    return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: steps are not asynchronous", __func__);
}

#define ENTER_STATUS                                   \
    ENTER(MODE_STEP | MODE_TERMINATED | MODE_ERROR);   \
    if (!fmu_is_co_simulation(self))                   \
    return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: the instance was created for Model Exchange", __func__)

static fmi2Status no_status(FmuInstance *self, const char *function) {
    return (fmi2Status)fmu_fail(self, FMU_DISCARD, "%s: this status is only for asynchronous steps", function);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)s;
    (void)value;
    ENTER_STATUS;
    return no_status(self, __func__);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    ENTER_STATUS;
    if (s != fmi2LastSuccessfulTime) return no_status(self, __func__);
    if (!value) return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *value = fmu_time(self);
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)s;
    (void)value;
    ENTER_STATUS;
    return no_status(self, __func__);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    ENTER_STATUS;
    if (s != fmi2Terminated) return no_status(self, __func__);
    if (!value) return (fmi2Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *value = fmu_ended(self) ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)s;
    (void)value;
    ENTER_STATUS;
    return no_status(self, __func__);
}
