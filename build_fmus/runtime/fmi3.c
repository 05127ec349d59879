/* FMI 3.0 entry points: arguments and state machine; the work is done in fmu_core.c. */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "fmu_core.h"

typedef struct {
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Adapter;

#define ANY_MODE 255u
#define EVENT_MODE (MODE_EVENT | MODE_TICK)
#define READABLE (MODE_INITIALIZATION | EVENT_MODE | MODE_CONTINUOUS_TIME | MODE_STEP | MODE_TERMINATED | MODE_ERROR)
#define WRITABLE (MODE_INSTANTIATED | MODE_INITIALIZATION | EVENT_MODE | MODE_CONTINUOUS_TIME | MODE_STEP)
#define WRITABLE_DISCRETE (WRITABLE & ~MODE_CONTINUOUS_TIME) /* all that is not a floating-point number */
#define RUNNING (EVENT_MODE | MODE_CONTINUOUS_TIME | MODE_STEP)

/* Every function starts with the modes in which it may be called. */
#define ENTER(modes)                                                    \
    FmuInstance *self = (FmuInstance *)instance;                        \
    if (!self) return fmi3Error;                                        \
    if (fmu_allowed(self, (modes), __func__) != FMU_OK) return fmi3Error

/* Functions of Model Exchange that may be called in modes of Co-Simulation, too: refuse them on such an instance. */
#define ENTER_MODEL_EXCHANGE(modes) \
    ENTER(modes);                   \
    if (fmu_is_co_simulation(self)) \
    return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: the instance was created for Co-Simulation", __func__)

static void log_message(void *adapter, FmuStatus status, const char *category, const char *message) {
    const Adapter *a = adapter;
    if (a->log) a->log(a->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(
    fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[]) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_set_logging(self, __func__, loggingOn, nCategories, categories);
}

/* ------------------------------------------------------------------ life cycle */

static fmi3Instance instantiate(int is_co_simulation, fmi3String name, fmi3String token, fmi3String resources,
                                fmi3Boolean loggingOn, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                const char *refusal) {
    if (!refusal && (!name || !*name)) refusal = "instanceName is missing";
    if (!refusal && (!token || strcmp(token, fmu_model.token) != 0))
        refusal = "instantiationToken is not that of this FMU; modelDescription.xml and binary do not belong together";
    if (refusal) {
        if (log) log(environment, fmi3Error, "logStatusError", refusal);
        return NULL;
    }
    FmuInstance *self = fmu_create(is_co_simulation, sizeof(Adapter), log_message);
    if (!self) return NULL;
    Adapter *a = fmu_adapter(self);
    a->log = log;
    a->environment = environment;
    if (fmu_open(self, resources) != FMU_OK) {
        fmu_free(self);
        return NULL;
    }
    if (loggingOn) (void)fmu_set_logging(self, __func__, 1, 0, NULL);
    return self;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
    fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage) {
    (void)visible;
    return instantiate(0, instanceName, instantiationToken, resourcePath, loggingOn, instanceEnvironment, logMessage,
                       fmu_model.is_continuous ? NULL : "this FMU offers Co-Simulation only");
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
    fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)visible;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    fmi3Instance instance =
        instantiate(1, instanceName, instantiationToken, resourcePath, loggingOn, instanceEnvironment, logMessage,
            eventModeUsed && !fmu_model.has_clock ? "this FMU has no event mode (hasEventMode is false)" : NULL);
    if (instance && eventModeUsed) fmu_use_events((FmuInstance *)instance);
    return instance;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption) {
    (void)visible;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    return instantiate(0, instanceName, instantiationToken, resourcePath, loggingOn, instanceEnvironment, logMessage,
                       "Scheduled Execution is not offered");
}

void fmi3FreeInstance(fmi3Instance instance) {
    if (instance) fmu_free((FmuInstance *)instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    (void)toleranceDefined;
    (void)tolerance;
    ENTER(MODE_INSTANTIATED);
    const FmuStatus status = fmu_setup(self, startTime, stopTimeDefined, stopTime);
    return (fmi3Status)(status == FMU_OK ? fmu_enter_initialization(self) : status);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    ENTER(MODE_INITIALIZATION);
    return (fmi3Status)fmu_exit_initialization(self);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    ENTER(MODE_CONTINUOUS_TIME | MODE_STEP);
    if (fmu_is_co_simulation(self) && !fmu_uses_events(self))
        return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: the instance was created without event mode", __func__);
    fmu_set_mode(self, MODE_EVENT);
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    ENTER(RUNNING);
    fmu_set_mode(self, MODE_TERMINATED);
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_reset(self);
}

/* ------------------------------------------------------------------ values */

static double read_int(const void *values, size_t i) { return (double)((const int32_t *)values)[i]; }
static double read_flag(const void *values, size_t i) { return ((const unsigned char *)values)[i] ? 1.0 : 0.0; }
static void write_int(void *values, size_t i, double value) { ((int32_t *)values)[i] = fmu_to_int(value); }
static void write_flag(void *values, size_t i, double value) { ((unsigned char *)values)[i] = value != 0.0; }

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues) {
    ENTER(READABLE);
    return (fmi3Status)fmu_get(self, __func__, FMU_FLOAT64, valueReferences, nValueReferences, values, nValues);
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Int32 values[], size_t nValues) {
    ENTER(READABLE);
    return (fmi3Status)fmu_get_as(
        self, __func__, FMU_INT32, valueReferences, nValueReferences, values, nValues, write_int);
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Boolean values[], size_t nValues) {
    ENTER(READABLE);
    return (fmi3Status)fmu_get_as(
        self, __func__, FMU_BOOLEAN, valueReferences, nValueReferences, values, nValues, write_flag);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues) {
    ENTER(WRITABLE);
    return (fmi3Status)fmu_set(self, __func__, FMU_FLOAT64, valueReferences, nValueReferences, values, nValues);
}

fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Int32 values[], size_t nValues) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi3Status)fmu_set_as(
        self, __func__, FMU_INT32, valueReferences, nValueReferences, values, nValues, read_int);
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Boolean values[], size_t nValues) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi3Status)fmu_set_as(
        self, __func__, FMU_BOOLEAN, valueReferences, nValueReferences, values, nValues, read_flag);
}

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         fmi3String values[], size_t nValues) {
    ENTER(READABLE);
    return (fmi3Status)fmu_get_texts(self, __func__, valueReferences, nValueReferences, values, nValues);
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         const fmi3String values[], size_t nValues) {
    ENTER(WRITABLE_DISCRETE);
    return (fmi3Status)fmu_set_texts(self, __func__, valueReferences, nValueReferences, values, nValues);
}

/* Types that no component here has: an empty request is fine, anything else is an error. */
static fmi3Status no_variables(FmuInstance *self, const char *function, size_t n) {
    if (n == 0) return fmi3OK;
    return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: %s has no variables of this type", function, fmu_model.name);
}

#define NO_VARIABLES(type, writable)                                                                                   \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference valueReferences[],                        \
        size_t nValueReferences, fmi3##type values[], size_t nValues) {                                                \
        (void)valueReferences;                                                                                         \
        (void)values;                                                                                                  \
        ENTER(READABLE);                                                                                               \
        return no_variables(self, __func__, nValueReferences + nValues);                                               \
    }                                                                                                                  \
    fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference valueReferences[],                        \
        size_t nValueReferences, const fmi3##type values[], size_t nValues) {                                          \
        (void)valueReferences;                                                                                         \
        (void)values;                                                                                                  \
        ENTER(writable);                                                                                               \
        return no_variables(self, __func__, nValueReferences + nValues);                                               \
    }

NO_VARIABLES(Float32, WRITABLE)
NO_VARIABLES(Int8, WRITABLE_DISCRETE)
NO_VARIABLES(UInt8, WRITABLE_DISCRETE)
NO_VARIABLES(Int16, WRITABLE_DISCRETE)
NO_VARIABLES(UInt16, WRITABLE_DISCRETE)
NO_VARIABLES(UInt32, WRITABLE_DISCRETE)
NO_VARIABLES(Int64, WRITABLE_DISCRETE)
NO_VARIABLES(UInt64, WRITABLE_DISCRETE)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         size_t valueSizes[], fmi3Binary values[], size_t nValues) {
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    ENTER(READABLE);
    return no_variables(self, __func__, nValueReferences + nValues);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         const size_t valueSizes[], const fmi3Binary values[], size_t nValues) {
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    ENTER(WRITABLE_DISCRETE);
    return no_variables(self, __func__, nValueReferences + nValues);
}

static fmi3Status not_offered(FmuInstance *self, const char *function, const char *what) {
    return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: %s", function, what);
}

/* ------------------------------------------------------------------ the clock of a sampled component */

/* Every reference must be that of the clock. */
static fmi3Status check_clocks(FmuInstance *self, const char *function, const fmi3ValueReference references[], size_t n,
                               const void *values, const void *more) {
    if (!fmu_model.has_clock) return not_offered(self, function, "there are no clocks");
    if (n && (!references || !values || !more)) return not_offered(self, function, "NULL argument");
    for (size_t i = 0; i < n; i++)
        if (references[i] != (fmi3ValueReference)fmu_model.n_variables)
            return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: value reference %u is no clock", function, references[i]);
    return fmi3OK;
}

#define ENTER_CLOCK(modes, values, more)                                                                        \
    ENTER(ANY_MODE);                                                                                            \
    if (check_clocks(self, __func__, references, n, (values), (more)) != fmi3OK) return fmi3Error;              \
    if (fmu_allowed(self, fmu_uses_events(self) ? (modes) : 0u, __func__) != FMU_OK) return fmi3Error

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Clock values[]) {
    ENTER_CLOCK(EVENT_MODE, values, values);
    for (size_t i = 0; i < n; i++) values[i] = fmu_mode(self) == MODE_TICK;
    return fmi3OK;
}

fmi3Status fmi3SetClock(
    fmi3Instance instance, const fmi3ValueReference references[], size_t n, const fmi3Clock values[]) {
    ENTER_CLOCK(EVENT_MODE, values, values);
    for (size_t i = 0; i < n; i++) {
        if (fmu_mode(self) == MODE_TICK && !values[i]) return not_offered(self, __func__, "canBeDeactivated is false");
        if (fmu_mode(self) == MODE_EVENT && values[i] && fmu_tick(self, __func__) != FMU_OK) return fmi3Error;
    }
    return fmi3OK;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
    fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    ENTER_CLOCK(MODE_INITIALIZATION | EVENT_MODE, intervals, qualifiers);
    for (size_t i = 0; i < n; i++) {
        intervals[i] = fmu_model.sample_time;
        qualifiers[i] = fmi3IntervalUnchanged;
    }
    return fmi3OK;
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
    fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
    ENTER_CLOCK(MODE_INITIALIZATION | EVENT_MODE, counters, qualifiers);
    if (n && !resolutions) return not_offered(self, __func__, "NULL argument");
    for (size_t i = 0; i < n; i++) {
        counters[i] = fmu_model.clock_counter;
        resolutions[i] = fmu_model.clock_resolution;
        qualifiers[i] = fmi3IntervalUnchanged;
    }
    return fmi3OK;
}

fmi3Status fmi3GetShiftDecimal(
    fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Float64 shifts[]) {
    ENTER_CLOCK(MODE_INITIALIZATION | EVENT_MODE, shifts, shifts);
    for (size_t i = 0; i < n; i++) shifts[i] = 0.0;
    return fmi3OK;
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
    fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    ENTER_CLOCK(MODE_INITIALIZATION | EVENT_MODE, counters, resolutions);
    for (size_t i = 0; i < n; i++) {
        counters[i] = 0;
        resolutions[i] = fmu_model.clock_resolution;
    }
    return fmi3OK;
}

/* ------------------------------------------------------------------ what is not offered: setting clocks,
 * configuration, ... */

#define NOT_OFFERED(function, parameters, what)        \
    fmi3Status function parameters {                   \
        ENTER(ANY_MODE);                               \
        return not_offered(self, __func__, what);      \
    }

#ifdef __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

NOT_OFFERED(fmi3SetIntervalDecimal,
    (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]),
    "no interval and no shift of a clock can be set")
NOT_OFFERED(fmi3SetIntervalFraction,
            (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[], const fmi3UInt64 s[]),
            "no interval and no shift of a clock can be set")
NOT_OFFERED(fmi3SetShiftDecimal, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]),
            "no interval and no shift of a clock can be set")
NOT_OFFERED(fmi3SetShiftFraction,
            (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[], const fmi3UInt64 s[]),
            "no interval and no shift of a clock can be set")
NOT_OFFERED(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time),
            "Scheduled Execution is not offered")
NOT_OFFERED(fmi3EnterConfigurationMode, (fmi3Instance instance), "there are no structural parameters")
NOT_OFFERED(fmi3ExitConfigurationMode, (fmi3Instance instance), "there are no structural parameters")
NOT_OFFERED(
    fmi3EvaluateDiscreteStates, (fmi3Instance instance), "not offered (providesEvaluateDiscreteStates is false)")
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, (fmi3Instance instance, fmi3ValueReference r, size_t *n),
            "not offered (providesPerElementDependencies is false)")
NOT_OFFERED(fmi3GetVariableDependencies,
            (fmi3Instance instance, fmi3ValueReference r, size_t e[], fmi3ValueReference i[], size_t ei[],
             fmi3DependencyKind k[], size_t n),
            "not offered (providesPerElementDependencies is false)")
NOT_OFFERED(fmi3GetOutputDerivatives,
    (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Int32 o[], fmi3Float64 v[], size_t nv),
    "output derivatives are not provided")

#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif

fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
    ENTER(ANY_MODE);
    if (!fmu_uses_events(self)) return not_offered(self, __func__, "the instance was created without event mode");
    if (fmu_allowed(self, MODE_EVENT, __func__) != FMU_OK)
        return fmi3Error; /* while the clock ticks states have to be updated first */
    fmu_set_mode(self, MODE_STEP);
    return fmi3OK;
}

/* ------------------------------------------------------------------ state */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_snapshot(self, __func__, FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_restore(self, __func__, FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_free_snapshot(self, __func__, FMUState);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_serialized_size(self, __func__, FMUState, size);
}

fmi3Status fmi3SerializeFMUState(
    fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_serialize(self, __func__, FMUState, serializedState, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState) {
    ENTER(ANY_MODE);
    return (fmi3Status)fmu_deserialize(self, __func__, serializedState, size, FMUState);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    ENTER(MODE_INITIALIZATION | RUNNING | MODE_TERMINATED);
    const FmuPartial of = {0, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed};
    return (fmi3Status)fmu_partial_derivative(self, __func__, &of, sensitivity, nSensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    ENTER(MODE_INITIALIZATION | RUNNING | MODE_TERMINATED);
    const FmuPartial of = {1, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed};
    return (fmi3Status)fmu_partial_derivative(self, __func__, &of, sensitivity, nSensitivity);
}

/* ------------------------------------------------------------------ model exchange */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime) {
    ENTER(EVENT_MODE);
    if (!discreteStatesNeedUpdate || !terminateSimulation || !nominalsOfContinuousStatesChanged ||
        !valuesOfContinuousStatesChanged || !nextEventTimeDefined || !nextEventTime)
        return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *discreteStatesNeedUpdate = *terminateSimulation = *nominalsOfContinuousStatesChanged = false;
    *valuesOfContinuousStatesChanged = *nextEventTimeDefined = false;
    *nextEventTime = 0.0;
    return fmu_mode(self) == MODE_TICK ? (fmi3Status)fmu_take_sample(self, __func__) : fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
    ENTER_MODEL_EXCHANGE(MODE_EVENT);
    fmu_set_mode(self, MODE_CONTINUOUS_TIME);
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER(MODE_CONTINUOUS_TIME);
    if (!enterEventMode || !terminateSimulation)
        return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *enterEventMode = *terminateSimulation = false;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    ENTER_MODEL_EXCHANGE(MODE_EVENT | MODE_CONTINUOUS_TIME);
    return (fmi3Status)fmu_set_time(self, __func__, time);
}

fmi3Status fmi3SetContinuousStates(
    fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nContinuousStates) {
    ENTER(MODE_CONTINUOUS_TIME);
    return (fmi3Status)fmu_set_states(self, __func__, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(
    fmi3Instance instance, fmi3Float64 derivatives[], size_t nContinuousStates) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi3Status)fmu_get_derivatives(self, __func__, derivatives, nContinuousStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators) {
    (void)eventIndicators;
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    if (nEventIndicators) return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: there are no event indicators", __func__);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi3Status)fmu_get_states(self, __func__, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates) {
    ENTER_MODEL_EXCHANGE(MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS_TIME | MODE_TERMINATED);
    return (fmi3Status)fmu_get_nominals(self, __func__, nominals, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators) {
    ENTER_MODEL_EXCHANGE(READABLE | MODE_INSTANTIATED);
    if (!nEventIndicators) return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *nEventIndicators = 0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates) {
    ENTER_MODEL_EXCHANGE(READABLE | MODE_INSTANTIATED);
    if (!nContinuousStates) return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *nContinuousStates = (size_t)fmu_model.n_states;
    return fmi3OK;
}

/* ------------------------------------------------------------------ co-simulation */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    (void)noSetFMUStatePriorToCurrentPoint;
    ENTER(MODE_STEP);
    if (!eventHandlingNeeded || !terminateSimulation || !earlyReturn || !lastSuccessfulTime)
        return (fmi3Status)fmu_fail(self, FMU_ERROR, "%s: NULL argument", __func__);
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = false;
    const FmuStatus status = fmu_do_step(self, __func__, currentCommunicationPoint, communicationStepSize);
    *lastSuccessfulTime = fmu_time(self);
    *terminateSimulation = fmu_ended(self) != 0; /* maybe before the step's end; mightReturnEarlyFromDoStep is false */
    return (fmi3Status)status;
}
