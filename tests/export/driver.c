/* A stand-alone host for a system's FMU of FMI 3.0, linked with its sources under sanitizers: the whole life, wrong
 * calls, saved states and damaged ones, in two threads at once where -DTHREADS. Ends with 0 when every call returned
 * what it should. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "system.h"

static int failures;
static const char *resources;
static double step;

#define EXPECT(condition)                                          \
    do {                                                           \
        if (!(condition)) {                                        \
            __atomic_add_fetch(&failures, 1, __ATOMIC_SEQ_CST);    \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition); \
        }                                                          \
    } while (0)

static void quiet(void *e, fmi3Status status, const char *category, const char *message) {
    (void)e, (void)status, (void)category, (void)message;
}

static fmi3Instance instantiate(void) {
    return fmi3InstantiateCoSimulation(
        "driver", fmu_model.token, resources, false, true, false, false, NULL, 0, NULL, quiet, NULL);
}

static fmi3Status advance(fmi3Instance c, double t, double h) {
    bool event, terminate, early;
    double last;
    return fmi3DoStep(c, t, h, true, &event, &terminate, &early, &last);
}

static void read_all(fmi3Instance c, double *sum) {
    for (unsigned vr = 0; vr < (unsigned)plan.n_variables; vr++) {
        double x = 0.0;
        int32_t i = 0;
        bool b = false;
        const char *text = "";
        const FmuType type = plan.variables[vr].type;
        const fmi3Status status = type == FMU_FLOAT64 ? fmi3GetFloat64(c, &vr, 1, &x, 1)
                                  : type == FMU_INT32  ? fmi3GetInt32(c, &vr, 1, &i, 1)
                                  : type == FMU_STRING ? fmi3GetString(c, &vr, 1, &text, 1)
                                                       : fmi3GetBoolean(c, &vr, 1, &b, 1);
        EXPECT(status == fmi3OK);
        *sum += x + i + b + (double)strlen(text);
    }
}

/* Values that are right are taken, others refused. */
static void write_all(fmi3Instance c) {
    for (unsigned vr = 0; vr < (unsigned)plan.n_variables; vr++) {
        const PlanVariable *v = &plan.variables[vr];
        double x = 0.0, bad = NAN;
        if (v->type != FMU_FLOAT64) continue;
        EXPECT(fmi3GetFloat64(c, &vr, 1, &x, 1) == fmi3OK);
        const bool settable = v->role == FMU_INPUT || (v->role == FMU_PARAMETER && v->is_tunable);
        EXPECT((fmi3SetFloat64(c, &vr, 1, &x, 1) <= fmi3Warning) == settable);
        EXPECT(fmi3SetFloat64(c, &vr, 1, &bad, 1) == fmi3Error);
    }
}

/* Texts are taken in initialization: one that is told stays where it is while others are set. */
static void set_texts(fmi3Instance c) {
    const char *told[2] = {NULL, NULL}, *given[2] = {"some", "other text"};
    unsigned vr[2], n = 0;
    for (unsigned k = 0; k < (unsigned)plan.n_variables && n < 2; k++)
        if (plan.variables[k].type == FMU_STRING) vr[n++] = k;
    EXPECT(n == 2);
    EXPECT(fmi3SetString(c, vr, n, given, n) == fmi3OK);
    EXPECT(fmi3GetString(c, vr, n, told, n) == fmi3OK);
    EXPECT(!strcmp(told[0], given[0]) && !strcmp(told[1], given[1]));
    EXPECT(fmi3SetString(c, vr, n, told, n) == fmi3OK);
    given[1] = NULL;
    EXPECT(fmi3SetString(c, vr, n, given, n) == fmi3Error);
    EXPECT(fmi3GetString(c, vr, n, told, 1) == fmi3Error);
}

static void states(fmi3Instance c) {
    fmi3FMUState state = NULL, other = NULL;
    size_t size = 0;
    double sum = 0.0, again = 0.0;
    EXPECT(fmi3GetFMUState(c, &state) == fmi3OK);
    EXPECT(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK);
    unsigned char *bytes = malloc(size), *damaged = malloc(size);
    EXPECT(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK);
    EXPECT(fmi3SerializeFMUState(c, state, bytes, size - 1) == fmi3Error);
    EXPECT(advance(c, 10 * step, step) == fmi3OK);
    read_all(c, &sum);
    EXPECT(fmi3DeserializeFMUState(c, bytes, size, &other) == fmi3OK);
    EXPECT(fmi3SetFMUState(c, other) == fmi3OK);
    EXPECT(advance(c, 10 * step, step) == fmi3OK);
    read_all(c, &again);
    EXPECT(sum == again);
    for (size_t i = 0; i < size; i += size / 97 + 1) {
        memcpy(damaged, bytes, size);
        damaged[i] ^= 0x5a;
        fmi3FMUState none = NULL;
        EXPECT(fmi3DeserializeFMUState(c, damaged, size, &none) == fmi3Error && !none);
        EXPECT(fmi3DeserializeFMUState(c, bytes, i, &none) == fmi3Error && !none);
    }
    EXPECT(fmi3SetFMUState(c, state) == fmi3OK);
    EXPECT(fmi3GetFMUState(c, &state) == fmi3OK); /* into the same block */
    EXPECT(fmi3FreeFMUState(c, &other) == fmi3OK);
    EXPECT(fmi3FreeFMUState(c, &state) == fmi3OK);
    EXPECT(fmi3FreeFMUState(c, &state) == fmi3OK); /* NULL by now */
    free(bytes);
    free(damaged);
}

static void *live(void *unused) {
    (void)unused;
    fmi3Instance c = instantiate();
    EXPECT(c != NULL);
    if (!c) return NULL;
    for (int life = 0; life < 2; life++) {
        double sum = 0.0;
        EXPECT(advance(c, 0.0, step) == fmi3Error);
        EXPECT(fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0) == fmi3OK);
        read_all(c, &sum);
        set_texts(c);
        EXPECT(fmi3ExitInitializationMode(c) == fmi3OK);
        for (int k = 0; k < 10; k++) EXPECT(advance(c, k * step, step) == fmi3OK);
        EXPECT(advance(c, 0.0, step) == fmi3Error);
        EXPECT(advance(c, 10 * step, step / 3 * 1.1) == fmi3Error);
        EXPECT(advance(c, 10 * step, -1.0) == fmi3Error);
        write_all(c);
        if (plan.can_save) states(c);
        read_all(c, &sum);
        const unsigned unknown = 1u << 30;
        double x;
        EXPECT(fmi3GetFloat64(c, &unknown, 1, &x, 1) == fmi3Error);
        EXPECT(fmi3GetFloat64(c, NULL, 1, &x, 1) == fmi3Error);
        EXPECT(fmi3Terminate(c) == fmi3OK);
        EXPECT(fmi3Reset(c) == fmi3OK);
    }
    fmi3FreeInstance(c);
    EXPECT(fmi3InstantiateCoSimulation(
               "driver", "another", resources, false, true, false, false, NULL, 0, NULL, quiet, NULL) == NULL);
    return NULL;
}

int main(int argc, char **argv) {
    (void)argc;
    step = atof(argv[1]);
    resources = argv[2];
#ifdef THREADS
    fmi3Instance keeps = instantiate(); /* libraries of components open: the loader's own memory is none of ours, and
                                           its lock is hidden */
    pthread_t threads[3];
    for (int i = 0; i < 3; i++) pthread_create(&threads[i], NULL, live, NULL);
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);
    fmi3FreeInstance(keeps);
#endif
    live(NULL);
    return failures != 0;
}
