/* A CAN bus with three nodes. When it is idle, the frame with the lowest identifier of those that wait is sent; all
 * other nodes receive it when its last bit is sent, and its sender gets a confirmation then. Stuff bits and errors are
 * left out: a frame with n bytes has 44 + 8 n bits (64 + 8 n with an extended identifier), and a pause of 3 bits. */
#include "can_frames.h"

enum { NODES = 3, WAITING = 16 };
typedef struct {
    uint32_t baud_rate, frames, lost;
    bool rx_clock[NODES], tx_clock[NODES];
    Bytes rx[NODES], tx[NODES];
    Frame waiting[NODES][WAITING]; /* frames of each node, in their order */
    int32_t n[NODES];
    int32_t sender;                  /* whose first frame is being sent, or -1 */
    double delivery, idle;           /* when its last bit is sent, and from when on the bus is idle again */
} Values;

#include "small_fmu.h"

enum { BAUD_RATE, FRAMES, LOST, NODE = 10 }; /* of node k from NODE + 4 k on: received data, sent data, their clocks */

static void start(Values *v) { v->baud_rate = 500000, v->sender = -1; }
static void *address(Values *v, fmi3ValueReference r) {
    if (r < NODE) return r == BAUD_RATE ? &v->baud_rate : r == FRAMES ? &v->frames : &v->lost;
    const int k = (int)(r - NODE) / 4;
    void *const own[] = {&v->rx[k], &v->tx[k], &v->rx_clock[k], &v->tx_clock[k]};
    return own[(r - NODE) % 4];
}
static size_t count(const Values *v, fmi3ValueReference r) { return 1; }
static void step(Model *m, double h, bool *event, double *done) {}

static bool delivers(const Values *v, double now) { return v->sender >= 0 && now > v->delivery - 1e-9; }

static void enter(Values *v, double now) {
    if (!delivers(v, now)) return;
    const Frame *f = &v->waiting[v->sender][0];
    for (int k = 0; k < NODES; k++) {
        v->tx[k].size = 0;
        if (k == v->sender) write_confirm(&v->tx[k], f->id);
        else write_transmit(&v->tx[k], f);
        v->tx_clock[k] = true;
    }
}

static void queue(Values *v, int k) {
    Frame f;
    uint32_t code;
    for (size_t at = 0; (code = read_operation(&v->rx[k], &at, &f));) {
        if (code != TRANSMIT) continue;
        if (v->n[k] == WAITING) v->lost++;
        else v->waiting[k][v->n[k]++] = f;
    }
}

static void begin_next(Values *v, double now) {
    for (int k = 0; k < NODES; k++)
        if (v->n[k] && (v->sender < 0 || v->waiting[k][0].id < v->waiting[v->sender][0].id)) v->sender = k;
    if (v->sender < 0) return;
    const Frame *f = &v->waiting[v->sender][0];
    v->delivery = now + ((f->extended ? 64 : 44) + 8 * f->n) / (double)v->baud_rate;
    v->idle = v->delivery + 3.0 / v->baud_rate;
}

static double update(Values *v, double now) {
    for (int k = 0; k < NODES; k++)
        if (v->rx_clock[k]) queue(v, k);
    if (delivers(v, now)) {
        Frame *own = v->waiting[v->sender];
        memmove(own, own + 1, sizeof *own * (size_t)--v->n[v->sender]);
        v->sender = -1;
        v->frames++;
    }
    memset(v->rx_clock, 0, sizeof v->rx_clock);
    memset(v->tx_clock, 0, sizeof v->tx_clock);
    if (v->sender < 0 && now > v->idle - 1e-9) begin_next(v, now);
    if (v->sender >= 0) return v->delivery;
    for (int k = 0; k < NODES; k++)
        if (v->n[k]) return v->idle;
    return INFINITY;
}
