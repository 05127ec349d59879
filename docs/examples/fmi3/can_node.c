/* An ECU on a CAN bus: every `period`, from `first` on, it sends `value`, and it shows what it received last. */
#include "can_frames.h"

typedef struct {
    double value, period, first, next;
    double received_value, received_time, confirmed_time;
    uint32_t id, received_id, received, confirmed;
    bool rx_clock, tx_clock;
    Bytes rx, tx;
} Values;

#include "small_fmu.h"

enum { VALUE, PERIOD, FIRST, ID, RX, TX, RX_CLOCK, TX_CLOCK, R_ID, R_VALUE, R_TIME, RECEIVED, C_TIME, CONFIRMED };

static void start(Values *v) {
    v->received_time = v->confirmed_time = v->next = -1.0;
    v->first = 0.001;
}
static void *address(Values *v, fmi3ValueReference r) {
    void *const all[] = {&v->value, &v->period, &v->first, &v->id, &v->rx, &v->tx, &v->rx_clock, &v->tx_clock,
        &v->received_id, &v->received_value, &v->received_time, &v->received, &v->confirmed_time, &v->confirmed};
    return all[r];
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }
static void step(Model *m, double h, bool *event, double *done) {}

static bool due(const Values *v, double now) { return v->period > 0.0 && v->next >= 0.0 && now > v->next - 1e-9; }

static void enter(Values *v, double now) {
    if (!due(v, now)) return;
    Frame f = {.id = v->id, .n = 8};
    memcpy(f.data, &v->value, 8); /* as it is in memory */
    v->tx.size = 0;
    write_transmit(&v->tx, &f);
    v->tx_clock = true;
}

static double update(Values *v, double now) {
    Frame f;
    uint32_t code;
    for (size_t at = 0; v->rx_clock && (code = read_operation(&v->rx, &at, &f));) {
        if (code == TRANSMIT) {
            v->received++, v->received_id = f.id, v->received_time = now;
            memcpy(&v->received_value, f.data, f.n);
        } else if (code == CONFIRM) v->confirmed++, v->confirmed_time = now;
    }
    if (v->next < 0.0) v->next = v->first;
    else if (v->tx_clock) v->next += v->period;
    v->rx_clock = v->tx_clock = false;
    return v->period > 0.0 ? v->next : INFINITY;
}
