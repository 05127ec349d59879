/* A small FMU that owes nothing to this project but its descriptions (followers.py): FMI 2.0 or 3.0, from the
 * standard's headers alone.
 *
 * y follows u, dy/dt = rate (u - y), by implicit Euler with steps of 0.1 ms at most, as exported models do. Variables
 * of other types are handed through, so that every type is exchanged; `count` also counts steps, and `total` (FMI 3.0)
 * is an array that adds up the array `w`. With a negative rate reading a floating-point number is an error, below -1 a
 * fatal one. */
#include "../fmi_names.h"

enum {
    U,
    Y,
    RATE,
    COUNT_IN,
    COUNT,
    ON,
    OFF,
    W,
    TOTAL,
    SMALL
}; /* value references; SMALL + 2 i and + 1: type i in and out */

typedef struct {
    double real[3], w[3], total[3];
    int32_t count_in, steps;
    bool on;
    float f32;
    int8_t i8;
    uint8_t u8;
    int16_t i16;
    uint16_t u16;
    uint32_t u32;
    int64_t i64;
    uint64_t u64;
} Model;

static void start(Model *m) {
    memset(m, 0, sizeof *m);
    m->real[RATE] = 1.0;
}

static void advance(Model *m, double h) {
    const int n = h > 1e-4 ? (int)(h / 1e-4 + 0.5) : 1;
    for (int i = 0; i < n; i++) {
        const double a = h / n * m->real[RATE];
        m->real[Y] = (m->real[Y] + a * m->real[U]) / (1.0 + a);
    }
    for (int i = 0; i < 3; i++) m->total[i] += h * m->w[i];
    m->steps++;
}

static Model *made(void) {
    Model *m = malloc(sizeof *m);
    if (m) start(m);
    return m;
}

static Status get_real(const Model *m, const Reference vr[], size_t n, double value[]) {
    if (m->real[RATE] < 0.0) return m->real[RATE] < -1.0 ? F(Fatal) : F(Error);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 3) *value++ = m->real[vr[i]];
        else for (int j = 0; j < 3; j++) *value++ = (vr[i] == W ? m->w : m->total)[j];
    }
    return F(OK);
}
static Status set_real(Model *m, const Reference vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 3) m->real[vr[i]] = *value++;
        else for (int j = 0; j < 3; j++) m->w[j] = *value++;
    }
    return F(OK);
}

#define M ((Model *)c)
INSTANTIATE(made())
void F(FreeInstance)(Instance c) { free(c); }
Status F(SetDebugLogging)(Instance c, Flag on, size_t n, const Text categories[]) { return F(OK); }
SETUP(F(OK), F(OK))
Status F(ExitInitializationMode)(Instance c) { return F(OK); }
Status F(Terminate)(Instance c) { return F(OK); }
Status F(Reset)(Instance c) { return start(c), F(OK); }
ACCESS(REAL, double, return get_real(c, vr, n, value), return set_real(c, vr, n, value))
ACCESS(INTEGER, Whole, EACH(value[i] = M->count_in + (vr[i] == COUNT ? M->steps : 0)), EACH(M->count_in = value[i]))
ACCESS(Boolean, Flag, EACH(value[i] = (vr[i] == OFF) != M->on), EACH(M->on = value[i] != 0))
#if FMI == 3
#define ALIKE(NAME, TYPE, OF) ACCESS(NAME, TYPE, EACH(value[i] = M->OF), EACH(M->OF = value[i]))
ALIKE(Float32, float, f32)
ALIKE(Int8, int8_t, i8)
ALIKE(UInt8, uint8_t, u8)
ALIKE(Int16, int16_t, i16)
ALIKE(UInt16, uint16_t, u16)
ALIKE(UInt32, uint32_t, u32)
ALIKE(Int64, int64_t, i64)
ALIKE(UInt64, uint64_t, u64)
#endif
COPIED_STATES(Model, )
DO_STEP((advance(c, h), F(OK)))
