/* Samples `value` when its clock `trigger` ticks, and lets its clock `tick` tick every `period`, with a count. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    double period, next, value, sent, taken, taken_at;
    bool trigger, tick;
} Values;

#include "small_fmu.h"

enum { PERIOD, VALUE, SENT, TAKEN, TAKEN_AT, TRIGGER, TICK };

static void start(Values *v) { v->taken_at = -1.0; }
static void *address(Values *v, fmi3ValueReference r) {
    void *const all[] = {&v->period, &v->value, &v->sent, &v->taken, &v->taken_at, &v->trigger, &v->tick};
    return all[r];
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }
static void step(Model *m, double h, bool *event, double *done) {}

static void enter(Values *v, double now) {
    v->tick = v->period > 0.0 && v->next > 0.0 && now > v->next - 1e-9;
    if (v->tick) v->sent += 1.0;
}

static double update(Values *v, double now) {
    if (v->trigger) v->taken = v->value, v->taken_at = now;
    if (v->tick || v->next == 0.0) v->next += v->period;
    v->trigger = v->tick = false;
    return v->period > 0.0 ? v->next : INFINITY;
}
