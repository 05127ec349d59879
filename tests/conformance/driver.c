/* A stand-alone host for one FMU, linked with its sources under AddressSanitizer and UndefinedBehaviorSanitizer.
 *
 * It goes through the life cycle, wrong calls, states and Model Exchange, and ends with 0 when every call returned what
 * it should. Compile with -DFMI=2 or -DFMI=3; its one argument is the communication step [s]. Variables come from the
 * table that the FMU's own code holds (fmu_model.h). */
#include "../fmi_calls.h"

static int failures;
static double step;

#define EXPECT(condition)                                              \
    do {                                                               \
        if (!(condition)) {                                            \
            failures++;                                                \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition);     \
        }                                                              \
    } while (0)

static void read_all(Instance c) {
    for (int i = 0; i < fmu_model.n_variables; i++) {
        double room = 0.0;
        EXPECT(get(c, (unsigned)i, &fmu_model.variables[i], &room) == 0);
    }
}

static void set_all(Instance c) {
    for (int i = 0; i < fmu_model.n_variables; i++) {
        const FmuVariable *v = &fmu_model.variables[i];
        if (v->role == FMU_PARAMETER || v->role == FMU_INPUT || v->is_exact)
            EXPECT(set(c, (unsigned)i, v, start_of(v)) == 0);
        else EXPECT(set(c, (unsigned)i, v, 0.0) == 3);
        if (v->type == FMU_FLOAT64) {
            EXPECT(set(c, (unsigned)i, v, NAN) == 3);
            EXPECT(set(c, (unsigned)i, v, INFINITY) == 3);
        }
    }
}

static void set_inputs(Instance c, double t) {
    for (int i = 0; i < fmu_model.n_variables; i++) {
        const FmuVariable *v = &fmu_model.variables[i];
        if (v->role != FMU_INPUT) continue;
        double value = start_of(v) + (v->type == FMU_FLOAT64 ? 1e-3 * sin(10.0 * t + i) : 0.0);
        (void)set(c, (unsigned)i, v, fmin(fmax(value, v->min), v->max));
    }
}

/* Derivatives of all pairs of variables; of FMUs with hundreds of them every so manieth pair, each variable on both
 * sides. */
static void differentiate(Instance c) {
    const int stride = 1 + fmu_model.n_variables / 100;
    for (int i = 0; i < fmu_model.n_variables; i++)
        for (int k = i % stride; k < fmu_model.n_variables; k += stride) {
            double result;
            (void)derivative(c, (unsigned)i, (unsigned)k, &result);
        }
    double result;
    EXPECT(derivative(c, 0xffffffffu, 0, &result) == 3);
}

/* Serialize, damage, deserialize, free. */
static void states(Instance c) {
    Saved saved = NULL, copy = NULL;
    size_t size = 0;
    EXPECT(STATE(Get, )(c, &saved) == 0);
    EXPECT(STATE(Get, )(c, &saved) == 0);
    EXPECT(STATE(Serialized, Size)(c, saved, &size) == 0);
    unsigned char *bytes = malloc(size + 1);
    EXPECT(STATE(Serialize, )(c, saved, (void *)bytes, size) == 0);
    EXPECT(STATE(Serialize, )(c, saved, (void *)bytes, size - 1) == 3);
    EXPECT(DESERIALIZE(c, (void *)bytes, size, &copy) == 0);
    EXPECT(STATE(Set, )(c, copy) == 0);
    EXPECT(STATE(Free, )(c, &copy) == 0);
    EXPECT(copy == NULL);
    /* Misaligned, short and damaged bytes, each in a block of its own so that reading beyond it is seen. */
    unsigned char *shifted = malloc(size + 1);
    memcpy(shifted + 1, bytes, size);
    EXPECT(DESERIALIZE(c, (void *)(shifted + 1), size, &copy) == 0);
    EXPECT(STATE(Free, )(c, &copy) == 0);
    free(shifted);
    for (size_t n = 0; n < size; n += 1 + size / 50) {
        unsigned char *part = malloc(n ? n : 1);
        memcpy(part, bytes, n);
        EXPECT(DESERIALIZE(c, (void *)part, n, &copy) == 3);
        free(part);
        bytes[n] ^= 0x40;
        if (n < 12 || n >= 16) EXPECT(DESERIALIZE(c, (void *)bytes, size, &copy) == 3);
        bytes[n] ^= 0x40;
    }
    EXPECT(STATE(Free, )(c, &saved) == 0);
    EXPECT(STATE(Free, )(c, &saved) == 0);
    EXPECT(STATE(Set, )(c, NULL) == 3);
    free(bytes);
}

/* Read everything, whatever comes of it. */
static void look(Instance c) {
    for (int i = 0; i < fmu_model.n_variables; i++) {
        double room = 0.0;
        (void)get(c, (unsigned)i, &fmu_model.variables[i], &room);
    }
}

/* States with odd numbers and a checksum that fits (the last 8 bytes of the header, FNV-1a of what follows): refused,
 * or good for a step. A number here and there, and all numbers of the warm starts of quadratic programs, which end the
 * block. */
static void hostile_states(Instance c, double t) {
    enum { HEADER = 40, CHECKSUM = 32 };
    const double odd[] = {NAN, 1.7e308, -1.0, 0.5, 2.0, 1099511627776.0};
    Saved saved = NULL, copy = NULL;
    size_t size = 0;
    EXPECT(STATE(Get, )(c, &saved) == 0);
    EXPECT(STATE(Serialized, Size)(c, saved, &size) == 0);
    unsigned char *bytes = malloc(size), *spoilt = malloc(size);
    EXPECT(STATE(Serialize, )(c, saved, (void *)bytes, size) == 0);
    const size_t n = (size - HEADER) / sizeof(double), warm = (size_t)fmu_model.n_qp_memory, stride = 1 + n / 10;
    for (size_t i = 0; i <= n; i += i + stride > n && i < n ? n - i : stride)
        for (size_t k = 0; k < sizeof odd / sizeof *odd; k++) {
            memcpy(spoilt, bytes, size);
            for (size_t j = i < n ? i : n - warm; j < (i < n ? i + 1 : n); j++)
                memcpy(spoilt + HEADER + j * sizeof(double), &odd[k], sizeof(double));
            const uint64_t h = fmu_hash(spoilt + HEADER, size - HEADER);
            memcpy(spoilt + CHECKSUM, &h, sizeof h);
            const Status status = DESERIALIZE(c, (void *)spoilt, size, &copy);
            EXPECT(status == 0 || status == 3);
            if (status != 0) continue;
            EXPECT(STATE(Set, )(c, copy) == 0);
            (void)do_step(c, t, step);
            look(c);
            EXPECT(STATE(Free, )(c, &copy) == 0);
        }
    EXPECT(STATE(Set, )(c, saved) == 0);
    EXPECT(STATE(Free, )(c, &saved) == 0);
    free(bytes);
    free(spoilt);
}

/* Real inputs far from anything sensible: results or an error. */
static void extreme_inputs(void) {
    const double far[] = {1.7e308, -1e300, 1e18, -7e9};
    Instance c = instantiate(fmu_model.token, 1);
    for (size_t k = 0; k < sizeof far / sizeof *far; k++) {
        EXPECT(initialize(c, 0.0) == 0);
        (void)F(ExitInitializationMode)(c);
        for (int i = 0; i < fmu_model.n_variables; i++) {
            const FmuVariable *v = &fmu_model.variables[i];
            if (v->role == FMU_INPUT && v->type == FMU_FLOAT64)
                EXPECT(set(c, (unsigned)i, v, i % 3 ? far[k] : -far[k]) == 0);
            if (v->role == FMU_INPUT && v->type == FMU_BOOLEAN) EXPECT(set(c, (unsigned)i, v, 1.0) == 0);
        }
        (void)do_step(c, 0.0, step);
        (void)do_step(c, step, step);
        look(c);
        EXPECT(F(Reset)(c) == 0);
    }
    F(FreeInstance)(c);
}

static void wrong_calls(Instance c) {
    double value = 0.0;
    unsigned vr = (unsigned)fmu_model.n_variables;
    EXPECT(do_step(c, 0.0, NAN) == 3);
    EXPECT(do_step(c, 0.0, -1.0) == 3);
    EXPECT(do_step(c, 0.0, 0.0) == 3);
    EXPECT(do_step(c, 1e9, step) == 3);
    EXPECT(do_step(c, NAN, step) == 3);
    EXPECT(do_step(NULL, 0.0, step) == 3);
#if FMI == 2
    EXPECT(fmi2GetReal(c, &vr, 1, &value) == 3);
    EXPECT(fmi2SetReal(c, &vr, 1, &value) == 3);
    EXPECT(fmi2GetReal(c, NULL, 1, &value) == 3);
    EXPECT(fmi2GetReal(c, &vr, 1, NULL) == 3);
#else
    EXPECT(fmi3GetFloat64(c, &vr, 1, &value, 1) == 3);
    EXPECT(fmi3SetFloat64(c, &vr, 1, &value, 1) == 3);
    EXPECT(fmi3GetFloat64(c, NULL, 1, &value, 1) == 3);
    EXPECT(fmi3GetFloat64(c, &vr, 1, NULL, 1) == 3);
    vr = 0;
    EXPECT(fmi3GetFloat64(c, &vr, 1, &value, 0) == 3);
#endif
    EXPECT(F(EnterInitializationMode)(c
#if FMI == 3
                                      , 0, 0.0, 0.0, 0, 0.0
#endif
                                      ) == 3);
    EXPECT(F(ExitInitializationMode)(c) == 3);
    const char *category = "none of ours, %s %n";
    EXPECT(F(SetDebugLogging)(c, 1, 1, &category) == 3);
}

static void co_simulation(void) {
    EXPECT(instantiate("wrong", 1) == NULL);
    Instance c = instantiate(fmu_model.token, 1);
    Instance other = instantiate(fmu_model.token, 1);
    EXPECT(c != NULL && other != NULL);
    for (int round = 0; round < 2; round++) {
        EXPECT(do_step(c, 0.0, step) == 3);
        set_all(c);
        states(c);
        EXPECT(initialize(c, 0.0) == 0);
        set_all(c);
        read_all(c);
        differentiate(c);
        EXPECT(F(ExitInitializationMode)(c) == 0);
        wrong_calls(c);
        for (int k = 0; k < 40; k++) {
            set_inputs(c, k * step);
            EXPECT(do_step(c, k * step, step) == 0);
            read_all(c);
        }
        differentiate(c);
        states(c);
        if (round == 0) hostile_states(c, 40 * step);
        Saved saved = NULL;
        EXPECT(STATE(Get, )(c, &saved) == 0);
        EXPECT(STATE(Set, )(other, saved) == 0);
        EXPECT(do_step(other, 40 * step, 7.3 * step) == 0);
        EXPECT(do_step(other, 47.3 * step, 1e300) == 3);
        EXPECT(STATE(Free, )(other, &saved) == 0);
        EXPECT(F(Terminate)(c) == 0);
        read_all(c);
        EXPECT(do_step(c, 40 * step, step) == 3);
        EXPECT(F(Reset)(c) == 0);
    }
    F(FreeInstance)(c);
    F(FreeInstance)(other);
    F(FreeInstance)(NULL);
}

static void model_exchange(void) {
    Instance c = instantiate(fmu_model.token, 0);
    if (!fmu_model.is_continuous) {
        EXPECT(c == NULL);
        return;
    }
    const size_t n = (size_t)fmu_model.n_states;
    double *x = calloc(n ? n : 1, sizeof(double)), *dx = calloc(n ? n : 1, sizeof(double));
    EXPECT(initialize(c, 0.0) == 0);
    EXPECT(F(ExitInitializationMode)(c) == 0);
#if FMI == 2
    fmi2EventInfo info;
    EXPECT(fmi2NewDiscreteStates(c, &info) == 0);
#else
    fmi3Boolean flags[5];
    double next;
    EXPECT(fmi3UpdateDiscreteStates(c, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next) == 0);
#endif
    EXPECT(F(EnterContinuousTimeMode)(c) == 0);
    EXPECT(F(GetContinuousStates)(c, x, n) == 0);
    EXPECT(F(GetContinuousStates)(c, x, n + 1) == 3);
    EXPECT(F(GetNominalsOfContinuousStates)(c, dx, n) == 0);
    for (int k = 0; k < 40; k++) {
        const double h = 1e-4;
        Flag event, terminate;
        set_inputs(c, k * h);
#if FMI == 2
        EXPECT(fmi2GetDerivatives(c, dx, n) == 0);
#else
        EXPECT(fmi3GetContinuousStateDerivatives(c, dx, n) == 0);
#endif
        for (size_t i = 0; i < n; i++) x[i] += h * dx[i];
        EXPECT(F(SetTime)(c, (k + 1) * h) == 0);
        EXPECT(F(SetContinuousStates)(c, x, n) == 0);
        EXPECT(F(CompletedIntegratorStep)(c, 1, &event, &terminate) == 0);
    }
    EXPECT(F(EnterEventMode)(c) == 0);
    EXPECT(F(SetContinuousStates)(c, x, n) == 3);
    differentiate(c);
    states(c);
    read_all(c);
    EXPECT(F(Terminate)(c) == 0);
    F(FreeInstance)(c);
    free(x);
    free(dx);
}

int main(int argc, char **argv) {
    if (argc != 2) return 2;
    step = strtod(argv[1], NULL);
    co_simulation();
    model_exchange();
    extreme_inputs();
    printf("%d failures\n", failures);
    return failures != 0;
}
