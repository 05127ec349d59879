/* A first-order filter of `u`, which asks for its input after each of its internal steps (intermediate update). */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    double u, x;
    int32_t asked;
} Values;

#include "small_fmu.h"

static const double TIME_CONSTANT = 0.1; /* s */
enum { PARTS = 20 };

static void start(Values *v) { *v = (Values){.u = 0.0}; }
static void *address(Values *v, fmi3ValueReference r) {
    void *const all[] = {&v->u, &v->x, &v->asked};
    return all[r];
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }

static void step(Model *m, double h, bool *event, double *done) {
    Values *v = &m->v;
    const double part = h / PARTS;
    for (int i = 1; i <= PARTS; i++) {
        const double before = v->u;
        bool ends = false;
        double when = 0.0;
        if (m->update) m->update(m->environment, m->now + i * part, true, false, true, false, &ends, &when);
        v->asked++;
        const double u = 0.5 * (before + v->u);
        v->x = u + (v->x - u) * exp(-part / TIME_CONSTANT);
    }
}

static void enter(Values *v, double now) {}
static double update(Values *v, double now) { return INFINITY; }
