/* A small FMU, FMI 2.0 or 3.0, that passes on what doubles do not hold: a String and, in FMI 3.0, a Binary and 64-bit
 * integers.
 *
 * As a source it writes in step k the text "k" with `length` times the letter a before it, the bytes 0, 1, ... k - 1,
 * and whole numbers from `first` on. Otherwise it passes on what it was given at the last step. `hash` is of the text
 * and bytes that it was given. With event mode (FMI 3.0) it refuses them in step mode, and `hash` counts its events. */
#include "../fmi_names.h"

#include <stdio.h>

enum { TEXT_IN, TEXT, DATA_IN, DATA, WHOLE_IN, WHOLE, UNSIGNED_IN, UNSIGNED, LENGTH, SOURCE, FIRST, HASH, TIME };
enum { LIST_IN = 20, LIST, WORDS_IN, WORDS, N = 3 }; /* arrays of N integers and of N short texts, passed on */
enum { MOST = 4096 };

typedef struct {
    char text_in[MOST], text[MOST];
    unsigned char data_in[MOST], data[MOST];
    size_t n_in, n;
    int64_t whole_in, whole, first;
    uint64_t u_in, u;
    int64_t list[N];
    char words[N][16];
    int32_t length, source, k;
    double hash;
    bool locked; /* step mode of an FMU with event mode */
    int32_t events;
} Model;

static Model *made(void) { return calloc(1, sizeof(Model)); }

static Status set_text(Model *m, const Text value) {
    if (!value || strlen(value) >= MOST) return F(Error);
    strcpy(m->text_in, value);
    return F(OK);
}

static void show(Model *m) {
    if (m->source) {
        memset(m->text, 'a', m->length);
        sprintf(m->text + m->length, "%d", m->k);
        m->n = m->k % MOST;
        for (size_t i = 0; i < m->n; i++) m->data[i] = (unsigned char)i;
        m->whole = m->first + m->k;
        m->u = (uint64_t)m->first * 2 + 1 + m->k;
    } else {
        strcpy(m->text, m->text_in);
        memcpy(m->data, m->data_in, m->n = m->n_in);
        m->whole = m->whole_in;
        m->u = m->u_in;
    }
}

static Status step(Model *m) {
    m->hash = 1e-6 * m->events;
    for (const char *p = m->text_in; *p; p++) m->hash += *p;
    for (size_t i = 0; i < m->n_in; i++) m->hash += 1000.0 * (i + 1) * m->data_in[i];
    m->k++;
    show(m);
    return F(OK);
}

#define M ((Model *)c)
INSTANTIATE(made())
void F(FreeInstance)(Instance c) { free(c); }
SETUP(F(OK), F(OK))
Status F(ExitInitializationMode)(Instance c) { return show(M), F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(Reset)(Instance c) { return memset(M, 0, sizeof *M), F(OK); }
DO_STEP(step(M))
static Status get_texts(Model *m, const Reference vr[], size_t n, Text value[]) {
    show(m);
    for (size_t i = 0; i < n; i++)
        if (vr[i] < LIST_IN) *value++ = m->text;
        else for (int k = 0; k < N; k++) *value++ = m->words[k];
    return F(OK);
}
static Status set_texts(Model *m, const Reference vr[], size_t n, const Text value[]) {
    if (m->locked) return F(Error);
    for (size_t i = 0; i < n; i++)
        if (vr[i] < LIST_IN) {
            if (set_text(m, *value++) != F(OK)) return F(Error);
        } else for (int k = 0; k < N; k++) strncpy(m->words[k], *value++, sizeof m->words[k] - 1);
    return F(OK);
}
ACCESS(String, Text, return get_texts(M, vr, n, value), return set_texts(M, vr, n, value))
ACCESS(REAL, double, *value = M->hash; return F(OK), return F(Error))
ACCESS(INTEGER, Whole, EACH(value[i] = vr[i] == LENGTH ? M->length : M->source),
    EACH(*(vr[i] == LENGTH ? &M->length : &M->source) = value[i]))
#define SAME(C) (C)
COPIED_STATES(Model, SAME)
#if FMI == 3
static int64_t *whole(Model *m, Reference r) {
    return r >= LIST_IN ? m->list : r == WHOLE ? &m->whole : r == FIRST ? &m->first : &m->whole_in;
}
#define EACH_WHOLE(TO, FROM)                                                                       \
    for (size_t i = 0; i < n; i++)                                                                 \
        for (int j = 0; j < (vr[i] >= LIST_IN ? N : 1); j++, value++) TO = FROM;                   \
    return F(OK)
ACCESS(Int64, int64_t, show(M); EACH_WHOLE(*value, whole(M, vr[i])[j]),
    if (M->locked) return F(Error); EACH_WHOLE(whole(M, vr[i])[j], *value))
ACCESS(UInt64, uint64_t, show(M); EACH(value[i] = vr[i] == UNSIGNED ? M->u : M->u_in),
    if (M->locked) return F(Error); EACH(M->u_in = value[i]))
fmi3Status fmi3GetBinary(Instance c, const Reference vr[], size_t n, size_t sizes[], fmi3Binary values[], size_t k) {
    show(M);
    values[0] = M->data, sizes[0] = M->n;
    return F(OK);
}
fmi3Status fmi3SetBinary(
    Instance c, const Reference vr[], size_t n, const size_t sizes[], const fmi3Binary values[], size_t k) {
    if (sizes[0] > MOST || M->locked) return F(Error);
    memcpy(M->data_in, values[0], M->n_in = sizes[0]);
    return F(OK);
}
fmi3Status fmi3EnterEventMode(Instance c) { return M->events++, M->locked = false, fmi3OK; }
fmi3Status fmi3EnterStepMode(Instance c) { return M->locked = true, fmi3OK; }
fmi3Status fmi3UpdateDiscreteStates(Instance c, Flag *again, Flag *terminate, Flag *nominals, Flag *states,
    Flag *has_next, double *next) {
    *again = *terminate = *nominals = *states = *has_next = false;
    return fmi3OK;
}
#endif
