/* Answers the bytes that it was given in reverse order, with `letter` before them. */
#include "bytes.h"

typedef struct {
    uint32_t letter;
    Bytes in, out;
} Values;

#include "small_fmu.h"

enum { LETTER, IN, OUT };

static void start(Values *v) {}
static void *address(Values *v, fmi3ValueReference r) {
    return r == LETTER ? (void *)&v->letter : r == IN ? &v->in : &v->out;
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }
static void step(Model *m, double h, bool *event, double *done) {
    Values *v = &m->v;
    v->out.size = 0;
    if (v->letter) v->out.data[v->out.size++] = (uint8_t)v->letter;
    for (size_t i = v->in.size; i > 0 && v->out.size < sizeof v->out.data; i--)
        v->out.data[v->out.size++] = v->in.data[i - 1];
}
static void enter(Values *v, double now) {}
static double update(Values *v, double now) { return INFINITY; }
