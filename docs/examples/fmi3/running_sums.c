/* Sums of the first 1, 2, ... n elements of an array; n is a structural parameter. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { MOST = 16 };
typedef struct {
    uint64_t n;
    double u[MOST], sum[MOST];
} Values;

#include "small_fmu.h"

enum { N, U, SUM };

static void start(Values *v) { v->n = 3; }
static void *address(Values *v, fmi3ValueReference r) { return r == N ? (void *)&v->n : r == U ? v->u : v->sum; }
static size_t count(const Values *v, fmi3ValueReference r) { return r == N ? 1 : v->n > MOST ? MOST : v->n; }
static void step(Model *m, double h, bool *event, double *done) {
    double sum = 0.0;
    for (size_t i = 0; i < count(&m->v, U); i++) m->v.sum[i] = sum += m->v.u[i];
}
static void enter(Values *v, double now) {}
static double update(Values *v, double now) { return INFINITY; }
