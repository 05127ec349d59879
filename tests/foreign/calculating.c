/* A small FMU, FMI 2.0 or 3.0, with calculated parameters: `scaled` is factor * p, `next` is n + 1, `greeting` is
 * "hello " and `name`, which refuses long texts, and, in FMI 3.0, `sums[i]` is q[i] + p, `lock` is `key` backwards, and
 * `larger` is `large` + 1. `y` is p + 1000 n, and `seen` is made of q, `name`, `key`, `mode` and the last digits of
 * `large`. */
#include "../fmi_names.h"

#include <math.h>
#include <stdio.h>

enum { P, FACTOR, SCALED, NUMBER, NEXT, Y, Q, SUMS, NAME, GREETING, KEY, LOCK, SEEN, LARGE, LARGER, MODE };
enum { MOST = 64 };

typedef struct {
    double p, factor, q[2];
    int32_t n, key_size;
    int64_t large, mode;
    char name[MOST], greeting[2 * MOST];
    unsigned char key[MOST], lock[MOST];
} Model;

static Model *fresh(Model *m) {
    if (m) *m = (Model){.p = 1.0, .factor = 2.0, .n = 3, .mode = 1};
    return m;
}

static double seen(const Model *m) {
    double sum = m->q[0] + 10.0 * m->q[1];
    for (const char *c = m->name; *c; c++) sum = 2.0 * sum + (unsigned char)*c;
    for (int i = 0; i < m->key_size; i++) sum = 2.0 * sum + m->key[i];
    return sum + (double)(m->large % 1000) + 0.25 * (double)(m->mode - 1);
}

static size_t count(Reference r) { return r == Q || r == SUMS ? 2 : 1; }

static void get_reals(const Model *m, Reference r, double *x) {
    const double shown[] = {m->p, m->factor, m->factor * m->p, 0.0, 0.0, m->p + 1000.0 * m->n, m->q[0], m->q[0] + m->p};
    *x = r == SEEN ? seen(m) : shown[r];
    if (r == Q) x[1] = m->q[1];
    if (r == SUMS) x[1] = m->q[1] + m->p;
}

static Status set_reals(Model *m, Reference r, const double *x) {
    if (r != P && r != FACTOR && r != Q) return F(Error);
    memcpy(r == P ? &m->p : r == FACTOR ? &m->factor : m->q, x, count(r) * sizeof *x);
    return F(OK);
}

#define M ((Model *)c)
INSTANTIATE(fresh(malloc(sizeof(Model))))
void F(FreeInstance)(Instance c) { free(c); }
SETUP(F(OK), F(OK))
Status F(ExitInitializationMode)(Instance c) { return F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(Reset)(Instance c) { return fresh(c), F(OK); }
DO_STEP(F(OK))
static Status get_each(const Model *m, const Reference vr[], size_t n, double *x) {
    for (size_t i = 0; i < n; x += count(vr[i++])) get_reals(m, vr[i], x);
    return F(OK);
}
static Status set_each(Model *m, const Reference vr[], size_t n, const double *x) {
    for (size_t i = 0; i < n; x += count(vr[i++]))
        if (set_reals(m, vr[i], x) != F(OK)) return F(Error);
    return F(OK);
}
ACCESS(REAL, double, return get_each(M, vr, n, value), return set_each(M, vr, n, value))
ACCESS(INTEGER, Whole, EACH(value[i] = M->n + (vr[i] == NEXT)), EACH(M->n = value[i]))
#define SAME(C) (C)
COPIED_STATES(Model, SAME)
static Status get_text(Model *m, Reference r, Text *value) {
    snprintf(m->greeting, sizeof m->greeting, "hello %s", m->name);
    *value = r == NAME ? m->name : m->greeting;
    return F(OK);
}
static Status set_text(Model *m, Text value) {
    if (strlen(value) >= MOST) return F(Error);
    strcpy(m->name, value);
    return F(OK);
}
ACCESS(String, Text, return get_text(M, vr[0], value), return set_text(M, value[0]))
#if FMI == 3
ACCESS(Int64, int64_t, EACH(value[i] = vr[i] == MODE ? M->mode : M->large + (vr[i] == LARGER)),
    EACH(*(vr[i] == MODE ? &M->mode : &M->large) = value[i]))
fmi3Status fmi3GetBinary(Instance c, const Reference vr[], size_t n, size_t sizes[], fmi3Binary values[], size_t k) {
    for (int i = 0; i < M->key_size; i++) M->lock[i] = M->key[M->key_size - 1 - i];
    values[0] = vr[0] == KEY ? M->key : M->lock, sizes[0] = M->key_size;
    return fmi3OK;
}
fmi3Status fmi3SetBinary(
    Instance c, const Reference vr[], size_t n, const size_t sizes[], const fmi3Binary values[], size_t k) {
    if (sizes[0] > MOST) return fmi3Error;
    memcpy(M->key, values[0], M->key_size = sizes[0]);
    return fmi3OK;
}
#endif
