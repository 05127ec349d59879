/* A small FMU that keeps to the standard but for one fault, or with one oddity that the standard allows:
 * `resources/fault.txt` names it (faulty.py has the lists). FMI 2.0 or 3.0, Co-Simulation and Model Exchange, from the
 * standard's headers alone.
 *
 * A mass on a spring: der(x) = v, der(v) = force - d v, force = gain u - k x while `on`. `count` counts steps or
 * events, z is an event indicator, c a constant. Co-Simulation takes steps of 1 ms at most of the classical Runge-Kutta
 * method; with `adaptive` Euler's with error control. */
#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "../fmi_names.h"

typedef FMI2_OR_3(fmi2CallbackLogger, fmi3LogMessageCallback) Log;
enum { OK = F(OK), DISCARD = F(Discard), ERROR = F(Error), FATAL = F(Fatal) };

enum { TIME, U, K, D, X, V, DX, DV, FORCE, COUNT, GAIN, ON, C, Z, N_VARIABLES }; /* value references */
enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, TERMINATED = 32 };
enum { RUNNING = EVENT | CONTINUOUS | STEP, ANY = 63 };
#define TOKEN "faulty"

typedef struct {
    double time, start, stop, u, k, d, x, v;
    int count, gain, mode, n_fixed;
    bool on, has_stop;
} Data;

typedef struct {
    Data data;
    char fault[40];
    bool co_simulation, logging;
    double stale[2];
    bool stale_valid;
    double tolerance, guess; /* of the integrator with error control: not part of the state */
    Log logger;
    void *environment;
    char name[64];
    Data *kept;
    int free_of_reset;
    bool corrupted; /* Fatal was returned */
} Model;

static Data shared;           /* for the faults of those who share */
static volatile double scratch[2];
static Data one_buffer;
static void *volatile left_behind;
static bool free_null_is_fatal;
static int n_made;

static bool has(const Model *m, const char *fault) { return strcmp(m->fault, fault) == 0; }

static Status fail(const Model *m, const char *what) {
#if FMI == 2
    if (m->logger) m->logger(m->environment, m->name, fmi2Error, "logStatusError", "%s", what);
#else
    if (m->logger) m->logger(m->environment, fmi3Error, "logStatusError", what);
#endif
    return ERROR;
}

#define REQUIRE(STATES, NAME)                                                                 \
    Model *m = c;                                                                             \
    if (!m) return ERROR;                                                                     \
    if (m->corrupted) abort();                                                                \
    if (!(m->data.mode & (STATES)) && !has(m, "forbidden")) return fail(m, NAME " is not allowed in this state")

static void start(Model *m) {
    const Data fresh = {.k = 4.0, .d = 0.4, .x = 1.0, .gain = 2, .on = true, .mode = INSTANTIATED};
    const Data old = m->data;
    m->data = fresh;
    m->stale_valid = false;
    m->guess = 1e-4;
    if (old.mode) { /* a reset */
        if (has(m, "reset-keeps-parameter")) m->data.k = old.k;
        if (has(m, "reset-keeps-count")) m->data.count = old.count;
        if (has(m, "reset-keeps-state")) m->data.v = old.v;
        m->free_of_reset = has(m, "reset-ignores-parameters");
    }
    if (has(m, "start")) m->data.d = 0.5;
}

static double force(const Model *m) {
    const Data *q = has(m, "shared") ? &shared : &m->data;
    const double k = m->free_of_reset ? 4.0 : m->data.k;
    return (m->data.on ? 0.5 * m->data.gain * q->u : 0.0) - k * m->data.x;
}

static void derivatives(Model *m, double dx[2]) {
    if (has(m, "stale") && m->stale_valid) {
        memcpy(dx, m->stale, sizeof m->stale);
        return;
    }
    dx[0] = m->data.v;
    dx[1] = force(m) - m->data.d * m->data.v;
    memcpy(m->stale, dx, sizeof m->stale);
    m->stale_valid = true;
}

static void advance_with_error_control(Model *m, double h) {
    Data *q = &m->data;
    for (double left = h; left > 1e-12;) {
        const double s = m->guess < left ? m->guess : left, x = q->x, v = q->v;
        double k1[2], k2[2];
        m->stale_valid = false, derivatives(m, k1);
        q->x = x + s * k1[0], q->v = v + s * k1[1], m->stale_valid = false, derivatives(m, k2);
        const double error = 0.5 * s * fmax(fabs(k2[0] - k1[0]), fabs(k2[1] - k1[1])) / m->tolerance;
        const bool again = error > 1.0 && s > 1e-6;
        if (again) q->x = x, q->v = v; /* once more, shorter */
        else left -= s;
        if (s == m->guess || again) m->guess = fmax(1e-6, s * fmin(5.0, fmax(0.2, 0.9 / sqrt(error + 1e-9))));
    }
}

static void advance(Model *m, double h) {
    Data *q = &m->data;
    if (has(m, "adaptive") || has(m, "adaptive-forgets-velocity")) {
        advance_with_error_control(m, h);
        m->stale_valid = false;
        return;
    }
    const int n = (int)ceil(h / 1e-3 - 1e-6);
    const double s = h / (n ? n : 1);
    for (int i = 0; i < n; i++) {
        double k1[2], k2[2], k3[2], k4[2];
        const double x = q->x, v = q->v;
        m->stale_valid = false, derivatives(m, k1);
        q->x = x + 0.5 * s * k1[0], q->v = v + 0.5 * s * k1[1], m->stale_valid = false, derivatives(m, k2);
        q->x = x + 0.5 * s * k2[0], q->v = v + 0.5 * s * k2[1], m->stale_valid = false, derivatives(m, k3);
        q->x = x + s * k3[0], q->v = v + s * k3[1], m->stale_valid = false, derivatives(m, k4);
        q->x = x + s / 6.0 * (k1[0] + 2.0 * k2[0] + 2.0 * k3[0] + k4[0]);
        q->v = v + s / 6.0 * (k1[1] + 2.0 * k2[1] + 2.0 * k3[1] + k4[1]);
    }
    if (has(m, "threads")) { /* a static scratch variable, and time for other instances to write to it */
        /* Instances wait for different times, so that they do not step in unison whatever the load of the machine. */
        static int calls;
        nanosleep(&(struct timespec){0, 100000 * (1 + __atomic_fetch_add(&calls, 1, __ATOMIC_RELAXED) % 7)}, NULL);
        scratch[0] = q->x, scratch[1] = q->v;
        nanosleep(&(struct timespec){0, 300000}, NULL);
        q->x = scratch[0], q->v = scratch[1];
    }
    m->stale_valid = false;
}

static double real(Model *m, Reference vr) {
    double dx[2];
    switch (vr) {
    case TIME: return has(m, "time") ? 0.0 : m->data.time;
    case U: return m->data.u;
    case K: return m->data.k;
    case D: return m->data.d;
    case X: return m->data.x;
    case V: return m->data.v;
    case DX: derivatives(m, dx); return has(m, "rate") ? -dx[0] : dx[0];
    case DV: derivatives(m, dx); return dx[1];
    case FORCE: return force(m);
    case C: return 3.5;
    default: return m->data.x - 0.5;
    }
}

static bool is_real(Reference vr) { return vr < N_VARIABLES && vr != COUNT && vr != GAIN && vr != ON; }

static Model *instantiate(
    Text name, Text token, bool co_simulation, bool logging, Log logger, void *environment, const char *resources) {
    Model *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->logger = logger, m->environment = environment, m->co_simulation = co_simulation, m->logging = logging;
    snprintf(m->name, sizeof m->name, "%s", name ? name : "");
    char path[4096];
    snprintf(path, sizeof path, "%s/fault.txt",
        resources && strncmp(resources, "file://", 7) == 0 ? resources + 7
        : resources                                        ? resources
                                                           : "");
    FILE *file = fopen(path, "r");
    if (file) {
        if (fscanf(file, "%39s", m->fault) != 1) m->fault[0] = 0;
        fclose(file);
    }
    if (has(m, "once") && n_made++) {
        fail(m, "there was an instance in this process");
        free(m);
        return NULL;
    }
    if (!name || !*name || !token || (strcmp(token, has(m, "empty-token") ? "" : TOKEN) != 0 && !has(m, "token"))) {
        fail(m, "no name, or another token");
        free(m);
        return NULL;
    }
    start(m);
    if (has(m, "shared")) shared = m->data;
    if (has(m, "leak")) left_behind = memset(malloc(100000), 1, 100000);
    free_null_is_fatal = has(m, "free-null");
    return m;
}

void F(FreeInstance)(Instance c) {
    if (!c && free_null_is_fatal) abort();
    free(c);
}

static Status setup(Model *m, bool has_tolerance, double tolerance, double begin, bool has_stop, double end) {
    if (!isfinite(begin) || (has_stop && !(end > begin))) return fail(m, "times");
    m->data.time = m->data.start = begin, m->data.stop = end, m->data.has_stop = has_stop;
    m->tolerance = has_tolerance ? tolerance : 1e-3;
    if (has(m, "setup-loses-parameters")) m->data.k = 4.0, m->data.d = 0.4;
    return OK;
}

Status F(ExitInitializationMode)(Instance c) {
    REQUIRE(INITIALIZATION, "ExitInitializationMode");
    m->data.mode = m->co_simulation ? STEP : EVENT;
    return OK;
}
Status F(Terminate)(Instance c) {
    REQUIRE(RUNNING, "Terminate");
    if (has(m, "terminate")) return fail(m, "cannot end");
    m->data.mode = TERMINATED;
    return OK;
}
Status F(Reset)(Instance c) {
    REQUIRE(ANY, "Reset");
    if (has(m, "reset-crash") && m->data.mode == TERMINATED) abort();
    if (has(m, "reset-fails")) return fail(m, "cannot be reset");
    start(m);
    return OK;
}
Status F(SetDebugLogging)(Instance c, Flag on, size_t n, const Text categories[]) {
    REQUIRE(ANY, "SetDebugLogging");
    if (n && !categories) return fail(m, "no categories");
    for (size_t i = 0; i < n; i++)
        if (!categories[i] || strcmp(categories[i], "logStatusError") != 0 || has(m, "logging"))
            return fail(m, "no such category");
    m->logging = on;
    return OK;
}

static Status get_real(Model *m, const Reference vr[], size_t n, double value[]) {
    if (has(m, "get-terminated") && m->data.mode == TERMINATED) return fail(m, "no values any more");
    if (n && (!vr || !value)) return fail(m, "NULL");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES && has(m, "unknown-accepted")) value[i] = 0.0;
        else if (vr[i] >= N_VARIABLES && has(m, "unknown-crash")) value[i] = ((volatile double *)8)[0];
        else if (!is_real(vr[i])) return fail(m, "no such real variable");
        else value[i] = real(m, vr[i]);
        if (has(m, "nan") && vr[i] == FORCE && m->data.mode == STEP) value[i] = NAN;
    }
    return OK;
}

static Status set_real(Model *m, const Reference vr[], size_t n, const double value[]) {
    if (n && (!vr || !value)) return fail(m, "NULL");
    const int mode = m->data.mode;
    for (size_t i = 0; i < n; i++) {
        const bool before = mode & (INSTANTIATED | INITIALIZATION), states = before && (vr[i] == X || vr[i] == V);
        const bool parameter =
            (vr[i] == K && before) || (vr[i] == D && mode & (INSTANTIATED | INITIALIZATION | EVENT | STEP));
        const bool free_for_all = has(m, "readonly") && is_real(vr[i]);
        if (vr[i] >= N_VARIABLES && has(m, "unknown-accepted")) continue;
        if (!is_real(vr[i]) || !(vr[i] == U || parameter || states || free_for_all)) return fail(m, "cannot be set");
        if (has(m, "no-early-inputs") && vr[i] == U && mode == INSTANTIATED)
            return fail(m, "inputs have no attribute initial");
        if (has(m, "fatal") && vr[i] == U && mode == STEP) return m->corrupted = true, FATAL;
        if (!isfinite(value[i])) {
            while (has(m, "hang-on-nan")) {}
            return fail(m, "not finite");
        }
    }
    m->stale_valid = m->stale_valid && has(m, "stale");
    for (size_t i = 0; i < n; i++) {
        Data *q = &m->data;
        double *place = vr[i] == U   ? &q->u
                        : vr[i] == K ? &q->k
                        : vr[i] == D ? &q->d
                        : vr[i] == X ? &q->x
                        : vr[i] == V ? &q->v
                                     : NULL;
        if (!place || (has(m, "set-ignored") && vr[i] == K) ||
            (has(m, "input-ignored") && vr[i] == U && mode & RUNNING))
            continue;
        *place = value[i];
        if (vr[i] == U && has(m, "shared")) shared.u = value[i];
    }
    return OK;
}

static Status get_whole(Model *m, const Reference vr[], size_t n, Whole value[]) {
    if (n && (!vr || !value)) return fail(m, "NULL");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != COUNT && vr[i] != GAIN) return fail(m, "no such integer variable");
        value[i] = vr[i] == COUNT ? m->data.count : m->data.gain;
    }
    return OK;
}
static Status set_whole(Model *m, const Reference vr[], size_t n, const Whole value[]) {
    if (n && (!vr || !value)) return fail(m, "NULL");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != GAIN || !(m->data.mode & (INSTANTIATED | INITIALIZATION))) return fail(m, "cannot be set");
        if (value[i] < 1 || value[i] > 3) return fail(m, "out of range");
        m->data.gain = has(m, "integer-clipped") && value[i] > 2 ? 2 : (int)value[i];
    }
    return OK;
}
static Status get_flag(Model *m, const Reference vr[], size_t n, Flag value[]) {
    if (n && (!vr || !value)) return fail(m, "NULL");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != ON) return fail(m, "no such Boolean variable");
        value[i] = m->data.on;
    }
    return OK;
}
static Status set_flag(Model *m, const Reference vr[], size_t n, const Flag value[]) {
    if (n && (!vr || !value)) return fail(m, "NULL");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != ON || m->data.mode & (CONTINUOUS | TERMINATED)) return fail(m, "cannot be set");
        if (has(m, "no-early-inputs") && m->data.mode == INSTANTIATED)
            return fail(m, "inputs have no attribute initial");
        m->data.on = value[i] != 0;
    }
    m->stale_valid = false;
    return OK;
}

/* States. Serialized ones begin with their length. */
typedef struct {
    size_t size;
    Data *pointer;
    Data data;
} State;

static Status save(Model *m, Saved *saved) {
    if (!saved) return fail(m, "NULL");
    State *s = *saved ? *saved : calloc(1, sizeof *s);
    if (!s) return fail(m, "no memory");
    s->size = sizeof *s;
    s->data = m->data;
    if (has(m, "serialized-pointer")) {
        s->pointer = malloc(sizeof(Data)); /* left behind, as its maker did */
        *s->pointer = m->data;
        m->kept = s->pointer;
    }
    if (has(m, "one-buffer")) one_buffer = m->data;
    *saved = s;
    return OK;
}
static Status restore(Model *m, Saved saved) {
    State *s = saved;
    if (!s) return fail(m, "NULL");
    const Data old = m->data;
    m->data = has(m, "one-buffer") ? one_buffer : s->data;
    if (has(m, "serialized-pointer"))
        m->data = m->kept == s->pointer ? *s->pointer : (Data){.mode = s->data.mode, .time = s->data.time};
    if (has(m, "state-forgets-velocity") || has(m, "adaptive-forgets-velocity")) m->data.v = old.v;
    m->guess = 1e-4; /* the integrator begins from scratch */
    if (has(m, "state-forgets-input")) m->data.u = old.u;
    if (has(m, "state-forgets-count")) m->data.count = old.count;
    m->stale_valid = false;
    return OK;
}
static Status release(Model *m, Saved *saved) {
    if (!saved) return fail(m, "NULL");
    free(*saved);
    *saved = has(m, "dangling") && *saved ? *saved : NULL;
    return OK;
}
static Status size_of(Model *m, Saved saved, size_t *size) {
    if (!saved || !size) return fail(m, "NULL");
    *size = sizeof(State);
    return OK;
}
static Status serialize(Model *m, Saved saved, Byte bytes[], size_t size) {
    if (!saved || !bytes || size < sizeof(State)) return fail(m, "no room");
    memcpy(bytes, saved, sizeof(State));
    return OK;
}
static Status deserialize(Model *m, const Byte bytes[], size_t size, Saved *saved) {
    State s = {0};
    if (!bytes || !saved) return fail(m, "NULL");
    if (has(m, "damaged-accepted")) memcpy(&s, bytes, size < sizeof s ? size : sizeof s);
    else if (size != sizeof s) return fail(m, "no state");
    else memcpy(&s, bytes, sizeof s);
    if (s.size != sizeof s && !has(m, "damaged-accepted")) return fail(m, "no state");
    State *copy = *saved ? *saved : malloc(sizeof s);
    if (!copy) return fail(m, "no memory");
    *copy = s;
    *saved = copy;
    return OK;
}

#define SIZED FMI2_OR_3(, k != n ? fail(m, "sizes") :)
#define CHECKED(NAME, TYPE, GET, SET)                                                                                  \
    ACCESS(NAME, TYPE, REQUIRE(ANY ^ INSTANTIATED, "Get"); return SIZED GET(m, vr, n, value),                          \
        REQUIRE(ANY ^ TERMINATED, "Set"); return SIZED SET(m, vr, n, value))
CHECKED(REAL, double, get_real, set_real)
CHECKED(INTEGER, Whole, get_whole, set_whole)
CHECKED(Boolean, Flag, get_flag, set_flag)
Status STATE(Get, )(Instance c, Saved *s) { REQUIRE(ANY, "GetFMUState"); return save(m, s); }
Status STATE(Set, )(Instance c, Saved s) { REQUIRE(ANY, "SetFMUState"); return restore(m, s); }
Status STATE(Free, )(Instance c, Saved *s) { REQUIRE(ANY, "FreeFMUState"); return release(m, s); }
Status STATE(Serialized, Size)(Instance c, Saved s, size_t *size) {
    REQUIRE(ANY, "SerializedFMUStateSize");
    return size_of(m, s, size);
}
Status STATE(Serialize, )(Instance c, Saved s, Byte b[], size_t size) {
    REQUIRE(ANY, "SerializeFMUState");
    return serialize(m, s, b, size);
}
Status DESERIALIZE(Instance c, const Byte b[], size_t size, Saved *s) {
    REQUIRE(ANY, "DeserializeFMUState");
    return deserialize(m, b, size, s);
}

/* d unknown / d known. */
static Status partial(Model *m, const Reference z[], size_t nz, const Reference v[], size_t nv, const double seed[],
    double result[], bool adjoint) {
    if ((nz && !z) || (nv && !v) || !seed || !result) return fail(m, "NULL");
    for (size_t i = 0; i < (adjoint ? nv : nz); i++) result[i] = 0.0;
    for (size_t i = 0; i < nz; i++)
        for (size_t j = 0; j < nv; j++) {
            const double gain = m->data.on ? 0.5 * m->data.gain : 0.0;
            const bool of_force = z[i] == FORCE || z[i] == DV;
            double d = 0.0;
            if (!is_real(z[i]) || !is_real(v[j]) || z[i] == v[j]) return fail(m, "no derivative");
            if (v[j] == U && of_force) d = has(m, "directional") ? 2.0 * gain : gain;
            if (v[j] == X && of_force) d = -m->data.k;
            if (v[j] == X && z[i] == Z) d = 1.0;
            if (v[j] == V && z[i] == DX) d = 1.0;
            if (v[j] == V && z[i] == DV) d = -m->data.d;
            if (adjoint && has(m, "adjoint") && z[i] == DV) d = 0.0;
            if (adjoint) result[j] += d * seed[i];
            else result[i] += d * seed[j];
        }
    return OK;
}

static Status do_step(Model *m, double t, double h) {
    Data *q = &m->data;
    if (!(h > 0.0) || !isfinite(h) || !isfinite(t)) {
        if (has(m, "wrong-steps")) return OK;
        return fail(m, "no step");
    }
    if (fabs(t - q->time) > 1e-9 * (1.0 + fabs(t))) return fail(m, "another time");
    if (q->has_stop && t + h > q->stop * (1.0 + 1e-12) + 1e-12 && !has(m, "beyond-stop"))
        return fail(m, "beyond the end");
    if (has(m, "step-fails")) {
#if FMI == 2
        if (m->logger)
            m->logger(m->environment, m->name, fmi2Error, "logStatusError", "%s cannot step: %d of %.1f, %g %%",
                "model", -3, 4.25, 1e-3);
        return ERROR;
#else
        return fail(m, "cannot step");
#endif
    }
    if (has(m, "slow")) { /* a step of two seconds; the one after it would take an hour */
        struct timespec wait = {q->count ? 3600 : 2, 100000000};
        nanosleep(&wait, NULL);
    }
    if (has(m, "step-crash") && q->count == 3) ((volatile int *)8)[0] = 1;
    if (has(m, "step-hang") && q->count == 3)
        for (;;) {}
    if (has(m, "step-devour") && q->count == 3)
        for (;;) memset(malloc(1 << 20), 1, 1 << 20);
    if (has(m, "step-exit") && q->count == 3) exit(0);
    if (has(m, "status") && q->count == 3) return (Status)17;
    if (has(m, "rounding")) fesetround(FE_UPWARD);
    if (has(m, "random")) q->v += 1e-3 * (double)((uintptr_t)m >> 4 & 1023) / 1024.0 + 1e-3 * rand() / RAND_MAX;
    if (has(m, "fixed-step")) { /* as far as whole steps of 10 ms go */
        for (; (q->n_fixed + 1) * 0.01 < t + h - q->start + 1e-9; q->n_fixed++) advance(m, 0.01);
    } else
        advance(m, has(m, "steps") ? 1e-3 : h);
    q->time = t + h;
    q->count++;
    return OK;
}

#if FMI == 2
const char *fmi2GetVersion(void) { return VERSION; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean log) {
    (void)visible;
    return functions ? instantiate(name, guid, type == fmi2CoSimulation, log, functions->logger,
                           functions->componentEnvironment, resources)
                     : NULL;
}
Status fmi2SetupExperiment(Instance c, Flag a, double tolerance, double begin, Flag b, double end) {
    REQUIRE(INSTANTIATED, "SetupExperiment");
    return setup(m, a, tolerance, begin, b, end);
}
Status fmi2EnterInitializationMode(Instance c) {
    REQUIRE(INSTANTIATED, "EnterInitializationMode");
    m->data.mode = INITIALIZATION;
    return OK;
}
Status fmi2GetString(Instance c, const Reference vr[], size_t n, fmi2String value[]) {
    REQUIRE(ANY, "Get");
    return (void)vr, (void)value, n ? fail(m, "no strings") : OK;
}
Status fmi2SetString(Instance c, const Reference vr[], size_t n, const fmi2String value[]) {
    REQUIRE(ANY, "Set");
    return (void)vr, (void)value, n ? fail(m, "no strings") : OK;
}
Status fmi2GetDirectionalDerivative(
    Instance c, const Reference z[], size_t nz, const Reference v[], size_t nv, const fmi2Real dv[], fmi2Real dz[]) {
    REQUIRE(INITIALIZATION | RUNNING, "GetDirectionalDerivative");
    return partial(m, z, nz, v, nv, dv, dz, false);
}
Status fmi2DoStep(Instance c, fmi2Real t, fmi2Real h, Flag no_set_prior) {
    REQUIRE(STEP, "DoStep");
    (void)no_set_prior;
    return do_step(m, t, h);
}
Status fmi2EnterEventMode(Instance c) {
    REQUIRE(CONTINUOUS, "EnterEventMode");
    m->data.mode = EVENT;
    return OK;
}
Status fmi2NewDiscreteStates(Instance c, fmi2EventInfo *info) {
    REQUIRE(EVENT, "NewDiscreteStates");
    memset(info, 0, sizeof *info);
    info->newDiscreteStatesNeeded = has(m, "endless-events");
    return OK;
}
#ifndef LACKING
Status fmi2GetStatus(Instance c, const fmi2StatusKind kind, fmi2Status *value) {
    return (void)c, (void)kind, (void)value, DISCARD;
}
#endif
Status fmi2GetRealStatus(Instance c, const fmi2StatusKind kind, fmi2Real *value) {
    return (void)c, (void)kind, (void)value, DISCARD;
}
Status fmi2GetIntegerStatus(Instance c, const fmi2StatusKind kind, fmi2Integer *value) {
    return (void)c, (void)kind, (void)value, DISCARD;
}
Status fmi2GetBooleanStatus(Instance c, const fmi2StatusKind kind, fmi2Boolean *value) {
    return (void)c, (void)kind, (void)value, DISCARD;
}
Status fmi2GetStringStatus(Instance c, const fmi2StatusKind kind, fmi2String *value) {
    return (void)c, (void)kind, (void)value, DISCARD;
}
Status fmi2CancelStep(Instance c) { return (void)c, ERROR; }
Status fmi2SetRealInputDerivatives(
    Instance c, const Reference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    return (void)c, (void)vr, (void)n, (void)order, (void)value, ERROR;
}
Status fmi2GetRealOutputDerivatives(
    Instance c, const Reference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    return (void)c, (void)vr, (void)n, (void)order, (void)value, ERROR;
}
#define GET_DERIVATIVES fmi2GetDerivatives
#else
const char *fmi3GetVersion(void) { return VERSION; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean log, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message, fmi3IntermediateUpdateCallback update) {
    (void)visible, (void)events, (void)early, (void)required, (void)n, (void)update;
    return instantiate(name, token, true, log, message, environment, resources);
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean log, fmi3InstanceEnvironment environment, fmi3LogMessageCallback message) {
    (void)visible;
    return instantiate(name, token, false, log, message, environment, resources);
}
Status fmi3EnterInitializationMode(Instance c, Flag a, double tolerance, double begin, Flag b, double end) {
    REQUIRE(INSTANTIATED, "EnterInitializationMode");
    if (setup(m, a, tolerance, begin, b, end) != OK) return ERROR;
    m->data.mode = INITIALIZATION;
    return OK;
}
Status fmi3GetDirectionalDerivative(Instance c, const Reference z[], size_t nz, const Reference v[], size_t nv,
    const fmi3Float64 dv[], size_t ndv, fmi3Float64 dz[], size_t ndz) {
    REQUIRE(INITIALIZATION | RUNNING, "GetDirectionalDerivative");
    return ndv != nv || ndz != nz ? fail(m, "sizes") : partial(m, z, nz, v, nv, dv, dz, false);
}
Status fmi3GetAdjointDerivative(Instance c, const Reference z[], size_t nz, const Reference v[], size_t nv,
    const fmi3Float64 dz[], size_t ndz, fmi3Float64 dv[], size_t ndv) {
    REQUIRE(INITIALIZATION | RUNNING, "GetAdjointDerivative");
    return ndv != nv || ndz != nz ? fail(m, "sizes") : partial(m, z, nz, v, nv, dz, dv, true);
}
Status fmi3DoStep(Instance c, fmi3Float64 t, fmi3Float64 h, Flag no_set_prior, Flag *event, Flag *terminate,
    Flag *early, fmi3Float64 *last) {
    REQUIRE(STEP, "DoStep");
    (void)no_set_prior;
    if (!event || !terminate || !early || !last) return fail(m, "NULL");
    *event = *terminate = *early = false;
    *last = t + h;
    return do_step(m, t, h);
}
Status fmi3EnterEventMode(Instance c) {
    REQUIRE(CONTINUOUS, "EnterEventMode");
    m->data.mode = EVENT;
    return OK;
}
Status fmi3UpdateDiscreteStates(Instance c, Flag *a, Flag *b, Flag *d, Flag *e, Flag *f, fmi3Float64 *next) {
    REQUIRE(EVENT, "UpdateDiscreteStates");
    *a = has(m, "endless-events");
    *b = *d = *e = *f = false;
    *next = 0.0;
    return OK;
}
Status fmi3GetNumberOfEventIndicators(Instance c, size_t *n) {
    REQUIRE(ANY, "GetNumberOfEventIndicators");
    return *n = has(m, "indicators") ? 2 : 1, OK;
}
Status fmi3GetNumberOfContinuousStates(Instance c, size_t *n) {
    REQUIRE(ANY, "GetNumberOfContinuousStates");
    return *n = 2, OK;
}
#define GET_DERIVATIVES fmi3GetContinuousStateDerivatives
#endif

#define EXCHANGE(STATES, NAME)                      \
    REQUIRE(STATES, NAME);                          \
    if (m->co_simulation) return fail(m, NAME " belongs to Model Exchange")

Status F(EnterContinuousTimeMode)(Instance c) {
    EXCHANGE(EVENT, "EnterContinuousTimeMode");
    m->data.mode = CONTINUOUS;
    return OK;
}
Status F(CompletedIntegratorStep)(Instance c, Flag no_set_prior, Flag *enter, Flag *terminate) {
    EXCHANGE(CONTINUOUS, "CompletedIntegratorStep");
    (void)no_set_prior;
    *enter = *terminate = false;
    return OK;
}
Status F(SetTime)(Instance c, double t) {
    EXCHANGE(EVENT | CONTINUOUS, "SetTime");
    m->data.time = t;
    return isfinite(t) ? OK : fail(m, "no time");
}
Status F(SetContinuousStates)(Instance c, const double x[], size_t n) {
    EXCHANGE(CONTINUOUS, "SetContinuousStates");
    if (n != 2 || !x || !isfinite(x[0] + x[1])) return fail(m, "no states");
    m->data.x = x[0], m->data.v = x[1];
    return OK;
}
Status F(GetContinuousStates)(Instance c, double x[], size_t n) {
    EXCHANGE(INITIALIZATION | EVENT | CONTINUOUS | TERMINATED, "GetContinuousStates");
    if (n != 2 || !x) return fail(m, "no room");
    x[0] = m->data.x, x[1] = m->data.v;
    return OK;
}
Status GET_DERIVATIVES(Instance c, double dx[], size_t n) {
    EXCHANGE(INITIALIZATION | EVENT | CONTINUOUS | TERMINATED, "GetDerivatives");
    if (has(m, "no-early-derivatives") && m->data.mode == INITIALIZATION) return fail(m, "not in the figure");
    if (n != 2 || !dx) return fail(m, "no room");
    derivatives(m, dx);
    if (has(m, "order")) {
        const double first = dx[0];
        dx[0] = dx[1], dx[1] = first;
    }
    return OK;
}
Status F(GetNominalsOfContinuousStates)(Instance c, double x[], size_t n) {
    EXCHANGE(INITIALIZATION | EVENT | CONTINUOUS | TERMINATED, "GetNominalsOfContinuousStates");
    if (n != 2 || !x) return fail(m, "no room");
    x[0] = 1.0, x[1] = has(m, "nominal") ? 0.0 : 1.0;
    return OK;
}
Status F(GetEventIndicators)(Instance c, double z[], size_t n) {
    EXCHANGE(INITIALIZATION | EVENT | CONTINUOUS | TERMINATED, "GetEventIndicators");
    if (n != 1 || !z) return fail(m, "no room");
    z[0] = m->data.x - 0.5;
    return OK;
}
