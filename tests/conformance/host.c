/* A host for the FMUs of one platform, made for that platform by a cross compiler: it loads each library that a job
 * names, replays the stimulus of its documentation and writes the outputs, exactly. In the middle the state travels as
 * bytes into a second instance, which goes on.
 *
 * host JOB...: a job is a text of words: fmi, library, token, resources, step, n_steps, then n_inputs and n_outputs,
 * each followed by that many pairs of type (r, i, b) and value reference, then (n_steps + 1) rows of inputs as bits of
 * doubles in hexadecimal. The outputs, as such bits too, go to JOB.out. Ends with the number of jobs that failed. */
#include <inttypes.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
static void *open_library(const char *path) { return (void *)LoadLibraryA(path); }
static void *find(void *library, const char *name) { return (void *)(uintptr_t)GetProcAddress((HMODULE)library, name); }
#else
#include <dlfcn.h>
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *find(void *library, const char *name) { return dlsym(library, name); }
#endif

#include "fmi2Functions.h"
#include "fmi3Functions.h"

typedef struct {
    char type;
    uint32_t reference;
} Variable;

typedef struct {
    int fmi;
    void *library;
    char path[1024], token[256], resources[1024];
    double step;
    int n_steps, n_inputs, n_outputs;
    Variable *inputs, *outputs;
    double *rows;
} Job;

/* Ends this job, naming what failed. */
#define MUST(condition)                                                          \
    do {                                                                         \
        if (!(condition)) {                                                      \
            fprintf(stderr, "%s: failed: %s\n", job->path, #condition);          \
            return 1;                                                            \
        }                                                                        \
    } while (0)
#define FIND(name) name##TYPE *name = (name##TYPE *)(uintptr_t)find(job->library, #name); MUST(name);

static void message2(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...) {
    va_list arguments;
    va_start(arguments, text);
    vfprintf(stderr, text, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}
static const fmi2CallbackFunctions callbacks = {message2, calloc, free, NULL, NULL};

static void message3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text) {
    fprintf(stderr, "%s\n", text);
}

static double read_bits(FILE *file) {
    uint64_t bits = 0;
    double value;
    if (fscanf(file, "%" SCNx64, &bits) != 1) fprintf(stderr, "a number is missing\n"), exit(99);
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void write_bits(FILE *file, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    fprintf(file, "%016" PRIx64 " ", bits);
}

static Variable *read_variables(FILE *file, int *n) {
    if (fscanf(file, "%d", n) != 1 || *n < 0) exit(99);
    Variable *v = calloc((size_t)*n + 1, sizeof *v);
    for (int i = 0; i < *n; i++)
        if (fscanf(file, " %c %" SCNu32, &v[i].type, &v[i].reference) != 2) exit(99);
    return v;
}

/* ------------------------------------------------------------------ FMI 2.0 */

static int run2(Job *job, FILE *out) {
    FIND(fmi2Instantiate)
    FIND(fmi2SetupExperiment) FIND(fmi2EnterInitializationMode) FIND(fmi2ExitInitializationMode) FIND(fmi2DoStep)
        FIND(fmi2SetReal) FIND(fmi2SetInteger) FIND(fmi2SetBoolean) FIND(fmi2GetReal) FIND(fmi2GetInteger)
            FIND(fmi2GetBoolean) FIND(fmi2GetFMUstate) FIND(fmi2SetFMUstate) FIND(fmi2FreeFMUstate)
                FIND(fmi2SerializedFMUstateSize) FIND(fmi2SerializeFMUstate) FIND(fmi2DeSerializeFMUstate)
                    FIND(fmi2Terminate) FIND(fmi2FreeInstance) FIND(fmi2GetVersion)
                        MUST(!strcmp(fmi2GetVersion(), fmi2Version));
    fmi2Component one = NULL;
    for (int k = 0; k <= job->n_steps; k++) {
        const double *row = job->rows + (size_t)(k ? k - 1 : 0) * (size_t)job->n_inputs;
        if (k == 0 || k == job->n_steps / 2 + 1) {
            fmi2Component other = fmi2Instantiate(
                "platform", fmi2CoSimulation, job->token, job->resources, &callbacks, fmi2False, fmi2False);
            MUST(other);
            MUST(fmi2SetupExperiment(other, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
            MUST(fmi2EnterInitializationMode(other) == fmi2OK);
            if (k) {
                fmi2FMUstate state = NULL, copy = NULL;
                size_t size = 0;
                MUST(fmi2ExitInitializationMode(other) == fmi2OK);
                MUST(fmi2GetFMUstate(one, &state) == fmi2OK && fmi2SerializedFMUstateSize(one, state, &size) == fmi2OK);
                fmi2Byte *bytes = malloc(size);
                MUST(fmi2SerializeFMUstate(one, state, bytes, size) == fmi2OK);
                MUST(fmi2DeSerializeFMUstate(other, bytes, size, &copy) == fmi2OK &&
                     fmi2SetFMUstate(other, copy) == fmi2OK);
                MUST(fmi2FreeFMUstate(one, &state) == fmi2OK && fmi2FreeFMUstate(other, &copy) == fmi2OK);
                free(bytes);
                MUST(fmi2Terminate(one) == fmi2OK);
                fmi2FreeInstance(one);
            }
            one = other;
        }
        for (int i = 0; i < job->n_inputs; i++) {
            const Variable *v = &job->inputs[i];
            const fmi2Integer whole = (fmi2Integer)row[i];
            MUST((v->type == 'r'   ? fmi2SetReal(one, &v->reference, 1, &row[i])
                  : v->type == 'i' ? fmi2SetInteger(one, &v->reference, 1, &whole)
                                   : fmi2SetBoolean(one, &v->reference, 1, &whole)) == fmi2OK);
        }
        if (k == 0) MUST(fmi2ExitInitializationMode(one) == fmi2OK);
        else MUST(fmi2DoStep(one, (k - 1) * job->step, job->step, fmi2True) == fmi2OK);
        for (int i = 0; i < job->n_outputs; i++) {
            const Variable *v = &job->outputs[i];
            double value = 0.0;
            fmi2Integer whole = 0;
            MUST((v->type == 'r'   ? fmi2GetReal(one, &v->reference, 1, &value)
                  : v->type == 'i' ? fmi2GetInteger(one, &v->reference, 1, &whole)
                                   : fmi2GetBoolean(one, &v->reference, 1, &whole)) == fmi2OK);
            write_bits(out, v->type == 'r' ? value : whole);
        }
        fputc('\n', out);
    }
    MUST(fmi2Terminate(one) == fmi2OK);
    fmi2FreeInstance(one);
    return 0;
}

/* ------------------------------------------------------------------ FMI 3.0 */

static int run3(Job *job, FILE *out) {
    FIND(fmi3InstantiateCoSimulation)
    FIND(fmi3EnterInitializationMode) FIND(fmi3ExitInitializationMode) FIND(fmi3DoStep) FIND(fmi3SetFloat64)
        FIND(fmi3SetInt32) FIND(fmi3SetBoolean) FIND(fmi3GetFloat64) FIND(fmi3GetInt32) FIND(fmi3GetBoolean)
            FIND(fmi3GetFMUState) FIND(fmi3SetFMUState) FIND(fmi3FreeFMUState) FIND(fmi3SerializedFMUStateSize)
                FIND(fmi3SerializeFMUState) FIND(fmi3DeserializeFMUState) FIND(fmi3Terminate) FIND(fmi3FreeInstance)
                    FIND(fmi3GetVersion) MUST(!strcmp(fmi3GetVersion(), fmi3Version));
    fmi3Instance one = NULL;
    for (int k = 0; k <= job->n_steps; k++) {
        const double *row = job->rows + (size_t)(k ? k - 1 : 0) * (size_t)job->n_inputs;
        if (k == 0 || k == job->n_steps / 2 + 1) {
            fmi3Instance other = fmi3InstantiateCoSimulation(
                "platform", job->token, job->resources, false, false, false, false, NULL, 0, NULL, message3, NULL);
            MUST(other);
            MUST(fmi3EnterInitializationMode(other, false, 0.0, 0.0, false, 0.0) == fmi3OK);
            if (k) {
                fmi3FMUState state = NULL, copy = NULL;
                size_t size = 0;
                MUST(fmi3ExitInitializationMode(other) == fmi3OK);
                MUST(fmi3GetFMUState(one, &state) == fmi3OK && fmi3SerializedFMUStateSize(one, state, &size) == fmi3OK);
                fmi3Byte *bytes = malloc(size);
                MUST(fmi3SerializeFMUState(one, state, bytes, size) == fmi3OK);
                MUST(fmi3DeserializeFMUState(other, bytes, size, &copy) == fmi3OK &&
                     fmi3SetFMUState(other, copy) == fmi3OK);
                MUST(fmi3FreeFMUState(one, &state) == fmi3OK && fmi3FreeFMUState(other, &copy) == fmi3OK);
                free(bytes);
                MUST(fmi3Terminate(one) == fmi3OK);
                fmi3FreeInstance(one);
            }
            one = other;
        }
        for (int i = 0; i < job->n_inputs; i++) {
            const Variable *v = &job->inputs[i];
            const int32_t whole = (int32_t)row[i];
            const bool on = row[i] != 0.0;
            MUST((v->type == 'r'   ? fmi3SetFloat64(one, &v->reference, 1, &row[i], 1)
                  : v->type == 'i' ? fmi3SetInt32(one, &v->reference, 1, &whole, 1)
                                   : fmi3SetBoolean(one, &v->reference, 1, &on, 1)) == fmi3OK);
        }
        if (k == 0) MUST(fmi3ExitInitializationMode(one) == fmi3OK);
        else {
            bool event, terminate, early;
            double last;
            MUST(fmi3DoStep(one, (k - 1) * job->step, job->step, true, &event, &terminate, &early, &last) == fmi3OK);
        }
        for (int i = 0; i < job->n_outputs; i++) {
            const Variable *v = &job->outputs[i];
            double value = 0.0;
            int32_t whole = 0;
            bool on = false;
            MUST((v->type == 'r'   ? fmi3GetFloat64(one, &v->reference, 1, &value, 1)
                  : v->type == 'i' ? fmi3GetInt32(one, &v->reference, 1, &whole, 1)
                                   : fmi3GetBoolean(one, &v->reference, 1, &on, 1)) == fmi3OK);
            write_bits(out, v->type == 'r' ? value : v->type == 'i' ? whole : on);
        }
        fputc('\n', out);
    }
    MUST(fmi3Terminate(one) == fmi3OK);
    fmi3FreeInstance(one);
    return 0;
}

/* ------------------------------------------------------------------ jobs */

static int run(const char *name) {
    Job one = {0}, *job = &one;
    FILE *file = fopen(name, "r");
    if (!file) return perror(name), 1;
    if (fscanf(file, "%d %1023s %255s %1023s", &job->fmi, job->path, job->token, job->resources) != 4) exit(99);
    job->step = read_bits(file);
    if (fscanf(file, "%d", &job->n_steps) != 1) exit(99);
    job->inputs = read_variables(file, &job->n_inputs);
    job->outputs = read_variables(file, &job->n_outputs);
    const size_t n = (size_t)(job->n_steps + 1) * (size_t)job->n_inputs;
    job->rows = calloc(n + 1, sizeof *job->rows);
    for (size_t i = 0; i < n; i++) job->rows[i] = read_bits(file);
    fclose(file);
    job->library = open_library(job->path);
    MUST(job->library);
    char result[1100];
    snprintf(result, sizeof result, "%s.out", name);
    FILE *out = fopen(result, "wb");
    MUST(out);
    const int failed = job->fmi == 2 ? run2(job, out) : run3(job, out);
    fclose(out);
    free(job->rows), free(job->inputs), free(job->outputs);
    return failed;
}

int main(int n, char **names) {
    int failed = 0;
    for (int i = 1; i < n; i++) failed += run(names[i]);
    return failed;
}
