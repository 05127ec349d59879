/* An FMU that does what FMUs of this world do at `at` [s]; what, is the parameter `trouble`. y is the time it has
 * reached. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { NONE, FREEZE, STATUS, GET_STATUS, NOT_FINITE, END, END_EARLY };

typedef struct {
    double u, y, at, value; /* value: what y becomes with NOT_FINITE, the status with STATUS and GET_STATUS */
    int32_t trouble, flags; /* flags: how many steps could have been rolled back */
    bool ended;
} Model;

static bool now(const Model *m, double t) { return t > m->at - 1e-9; }

/* One step; returns an FMI status. */
static int step(Model *m, double t, double h, bool no_rollback) {
    m->flags += !no_rollback;
    if (m->trouble == FREEZE && !no_rollback) return 0;
    if (m->trouble == STATUS && now(m, t)) return (int)m->value;
    m->ended = (m->trouble == END || m->trouble == END_EARLY) && now(m, t);
    if (m->ended && m->trouble == END_EARLY) {
        m->y = t + h / 2;
        return 2;
    }
    m->y = t + h;
    return 0;
}

static int get_real(Model *m, unsigned reference, double *x) {
    double all[] = {m->u, m->y, m->at, m->value};
    *x = all[reference];
    if (reference == 1 && now(m, m->y)) {
        if (m->trouble == NOT_FINITE) *x = m->value;
        if (m->trouble == GET_STATUS) return (int)m->value;
    }
    return 0;
}

static int set_real(Model *m, unsigned reference, double x) {
    if (!isfinite(x) && reference == 0) return 3;
    *(double *[]){&m->u, &m->y, &m->at, &m->value}[reference] = x;
    return 0;
}

static Model *fresh(Model *m) {
    if (m) *m = (Model){.at = 1e9};
    return m;
}

#define DO(NAME, ...) int NAME(__VA_ARGS__)
#define EACH(CALL)                                                                                                     \
    do {                                                                                                               \
        for (size_t i = 0; i < n; i++) {                                                                               \
            int status = CALL;                                                                                         \
            if (status) return status;                                                                                 \
        }                                                                                                              \
        return 0;                                                                                                      \
    } while (0)

#if FMI == 2
void *fmi2Instantiate(
    const char *name, int type, const char *guid, const char *uri, const void *callbacks, int v, int l) {
    return fresh(malloc(sizeof(Model)));
}
void fmi2FreeInstance(void *m) { free(m); }
DO(fmi2SetupExperiment, void *m, int a, double b, double c, int d, double e) { return 0; }
DO(fmi2EnterInitializationMode, void *m) { return 0; }
DO(fmi2ExitInitializationMode, void *m) { return 0; }
DO(fmi2Terminate, void *m) { return 0; }
DO(fmi2Reset, void *m) { fresh(m); return 0; }
DO(fmi2GetReal, void *m, const unsigned *vr, size_t n, double *x) { EACH(get_real(m, vr[i], x + i)); }
DO(fmi2SetReal, void *m, const unsigned *vr, size_t n, const double *x) { EACH(set_real(m, vr[i], x[i])); }
DO(fmi2GetInteger, void *m, const unsigned *vr, size_t n, int *x) { *x = ((Model *)m)->flags; return 0; }
DO(fmi2SetInteger, void *m, const unsigned *vr, size_t n, const int *x) { ((Model *)m)->trouble = *x; return 0; }
DO(fmi2GetFMUstate, void *m, void **s) {
    *s = *s ? *s : malloc(sizeof(Model));
    memcpy(*s, m, sizeof(Model));
    return 0;
}
DO(fmi2SetFMUstate, void *m, void *s) { memcpy(m, s, sizeof(Model)); return 0; }
DO(fmi2FreeFMUstate, void *m, void **s) { free(*s); *s = NULL; return 0; }
#ifndef WITHOUT_DO_STEP
DO(fmi2DoStep, void *m, double t, double h, int no_rollback) {
    int status = step(m, t, h, no_rollback);
    return ((Model *)m)->ended ? 2 : status; /* FMI 2.0 has no other way to ask for the end */
}
#endif
DO(fmi2GetRealStatus, void *m, int kind, double *x) { *x = ((Model *)m)->y; return 0; }
DO(fmi2GetBooleanStatus, void *m, int kind, int *x) { *x = ((Model *)m)->ended; return 0; }
#else
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *path, bool v, bool l, bool e, bool r,
                                  const uint32_t *vr, size_t n, void *env, void *log, void *update) {
    return fresh(malloc(sizeof(Model)));
}
void fmi3FreeInstance(void *m) { free(m); }
DO(fmi3EnterInitializationMode, void *m, bool a, double b, double c, bool d, double e) { return 0; }
DO(fmi3ExitInitializationMode, void *m) { return 0; }
DO(fmi3Terminate, void *m) { return 0; }
DO(fmi3Reset, void *m) { fresh(m); return 0; }
DO(fmi3GetFloat64, void *m, const uint32_t *vr, size_t n, double *x, size_t k) { EACH(get_real(m, vr[i], x + i)); }
DO(fmi3SetFloat64, void *m, const uint32_t *vr, size_t n, const double *x, size_t k) { EACH(set_real(m, vr[i], x[i])); }
DO(fmi3GetInt32, void *m, const uint32_t *vr, size_t n, int32_t *x, size_t k) { *x = ((Model *)m)->flags; return 0; }
DO(fmi3SetInt32, void *m, const uint32_t *vr, size_t n, const int32_t *x, size_t k) {
    ((Model *)m)->trouble = *x;
    return 0;
}
DO(fmi3GetFMUState, void *m, void **s) {
    *s = *s ? *s : malloc(sizeof(Model));
    memcpy(*s, m, sizeof(Model));
    return 0;
}
DO(fmi3SetFMUState, void *m, void *s) { memcpy(m, s, sizeof(Model)); return 0; }
DO(fmi3FreeFMUState, void *m, void **s) { free(*s); *s = NULL; return 0; }
#ifndef WITHOUT_DO_STEP
DO(fmi3DoStep, void *m, double t, double h, bool no_rollback, bool *event, bool *terminate, bool *early, double *last) {
    int status = step(m, t, h, no_rollback);
    *event = false;
    *terminate = ((Model *)m)->ended;
    *early = false;
    *last = ((Model *)m)->y;
    return status;
}
#endif
#endif
