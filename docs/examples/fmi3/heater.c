/* A heated space: its heater switches on at the temperature `low` and off at `high`. Both fall by 4 at `night`.
 *
 * It announces the night as its next event. Where it switches within a step, it returns early, if it may. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    double temperature, low, high, night, switched_at;
    int32_t on, switched;
} Values;

#include "small_fmu.h"

enum { TEMPERATURE, LOW, HIGH, NIGHT, SWITCHED_AT, ON, SWITCHED };
static const double TIME_CONSTANT = 600.0, OUTSIDE = 5.0, HEATED = 35.0; /* s, degC: what it tends to, off and on */

static void start(Values *v) {
    *v = (Values){.temperature = 20.0, .low = 19.0, .high = 21.0, .night = INFINITY, .switched_at = -1.0};
}
static void *address(Values *v, fmi3ValueReference r) {
    void *const all[] = {&v->temperature, &v->low, &v->high, &v->night, &v->switched_at, &v->on, &v->switched};
    return all[r];
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }

static void step(Model *m, double h, bool *event, double *done) {
    Values *v = &m->v;
    const double end = v->on ? HEATED : OUTSIDE, bound = v->on ? v->high : v->low;
    const double until = TIME_CONSTANT * log((v->temperature - end) / (bound - end)); /* s, to where it switches */
    *event = until <= h;
    if (*event && m->early) *done = fmax(until, 0.0);
    v->temperature = end + (v->temperature - end) * exp(-*done / TIME_CONSTANT);
}

static void enter(Values *v, double now) {}

static double update(Values *v, double now) {
    if (now > v->night - 1e-9) v->low -= 4.0, v->high -= 4.0, v->night = INFINITY;
    const double near = 1e-9;
    const int32_t on = v->temperature < v->low + near ? 1 : v->temperature > v->high - near ? 0 : v->on;
    if (on != v->on) v->on = on, v->switched++, v->switched_at = now;
    return v->night;
}
