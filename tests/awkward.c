/* An FMU that does what FMUs of this world do at `at` [s]; what, is the parameter `trouble`. y is the time it has
 * reached. */
#include <math.h>

#include "fmi_names.h"

enum { NONE, FREEZE, STATUS, GET_STATUS, NOT_FINITE, END, END_EARLY, END_UNTOLD };

typedef struct {
    double u, y, at, value; /* value: what y becomes with NOT_FINITE, the status with STATUS and GET_STATUS */
    int32_t trouble, flags; /* flags: how many steps could have been rolled back */
    bool ended;
} Model;

static bool now(const Model *m, double t) { return t > m->at - 1e-9; }

static Status advance(Model *m, double t, double h, bool no_rollback) {
    m->flags += !no_rollback;
    if (m->trouble == FREEZE && !no_rollback) return F(OK);
    if (m->trouble == STATUS && now(m, t)) return (Status)m->value;
    m->ended = m->trouble >= END && now(m, t);
    const bool early = m->ended && m->trouble == END_EARLY;
    m->y = t + (early ? h / 2 : h);
    return early ? F(Discard) : F(OK);
}

static Status step(Model *m, double t, double h, bool no_rollback, bool *end, double *last) {
    const Status status = advance(m, t, h, no_rollback);
    return *end = m->ended, *last = m->y, status;
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

#define M ((Model *)c)
#define UNTIL_ERROR(CALL)                                                                                              \
    for (size_t i = 0; i < n; i++) {                                                                                   \
        const int status = CALL;                                                                                       \
        if (status) return (Status)status;                                                                             \
    }                                                                                                                  \
    return F(OK)
INSTANTIATE(fresh(malloc(sizeof(Model))))
void F(FreeInstance)(Instance c) { free(c); }
SETUP(F(OK), F(OK))
Status F(ExitInitializationMode)(Instance c) { return F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(Reset)(Instance c) { return fresh(c), F(OK); }
ACCESS(REAL, double, UNTIL_ERROR(get_real(c, vr[i], value + i)), UNTIL_ERROR(set_real(c, vr[i], value[i])))
ACCESS(INTEGER, Whole, EACH(value[i] = M->flags), EACH(M->trouble = value[i]))
COPIED_STATES(Model, )
#ifndef WITHOUT_DO_STEP
DO_STEP(step(c, t, h, no_rollback, &end, &last))
#endif
#if FMI == 2
Status fmi2GetRealStatus(Instance c, const fmi2StatusKind kind, double *x) {
    return *x = M->y, M->trouble == END_UNTOLD ? fmi2Discard : fmi2OK;
}
Status fmi2GetBooleanStatus(Instance c, const fmi2StatusKind kind, Flag *x) { return *x = M->ended, fmi2OK; }
#endif
