/* One component in LANES copies: steps of its solver, or its samples, over the functions of its model.c. Included last.
 *
 * In the operations of fmu_core.c, for lanes that are at one time and have one solver step. A copy that fails is
 * reported by its lane; the others are not concerned. */
#if IS_CONTINUOUS
#include "integrators.c"
#endif

enum { N_VALUES = N_PARAMETERS + N_INPUTS + 2 * N_STATES + N_OUTPUTS };
enum { FINE, STATE_BEYOND, STATE_NOT_FINITE, OUTPUT_NOT_FINITE, SINGULAR }; /* why a lane failed */
enum { MATRIX = IS_ROS2 * N_STATES * N_STATES };

#if HAS_PROFILES /* the last numbers of the work memory are those of one copy */
enum { N_NODES = sizeof(Profiles) / sizeof(lanes), PIECE = 256, PIECES = (N_NODES + PIECE - 1) / PIECE };
enum { WORK = N_WORK - 1 - N_PARAMETERS - N_NODES };
#else
enum { WORK = N_WORK };
#endif

typedef struct {
    lanes time, start_time, sample, started; /* the first number of each counts */
    lanes failure, which, when, value;       /* of lanes that have failed: why, slot, time, and the state */
    lanes v[N_VALUES + 1]; /* parameters, inputs, states, derivatives, outputs: as in an instance's state */
    lanes k[5][N_STATES + 1];
    lanes matrix[MATRIX + IS_ROS2 * N_STATES + 1];
    lanes w[WORK + 1];
#if N_QP_DATA
    lanes data[N_QP_DATA], solution[N_QP_SOLUTION], kept[N_QP_SOLUTION];
#endif
    lanes fixed[N_FIXED + 1];
#if HAS_PROFILES
    Profiles profiles;
    uint64_t touched[PIECES]; /* pieces of them that are not zeros */
#endif
#ifdef HAS_SIDES
    Sides sides;
#endif
#if HAS_PLAIN
    int prepared; /* values over plain numbers */
#endif
    double memory[N_QP_MEMORY + 1]; /* warm starts of the quadratic programs */
    int pivots[IS_ROS2 * N_STATES + 1];
} Component;

#define P (m->v)
#define U (P + N_PARAMETERS)
#define X (U + N_INPUTS)
#define Y (X + 2 * N_STATES)

INLINE FmuArguments arguments(Component *m, double t, const lanes *x) {
#if HAS_PROFILES
    const lanes *const s = (const lanes *)&m->profiles;
#elif N_QP_DATA
    const lanes *const s = m->solution;
#else
    const lanes *const s = NULL;
#endif
    return (FmuArguments){.t = t, .x = x, .u = U, .p = P, .f = m->fixed, .s = s, .w = m->w};
}

#if N_QP_DATA
#include "programs.h"
/* Scratch of the quadratic programs lies behind the component. */
enum { SCRATCH = (sizeof(Component) + 63) / 64 * 64 };

static void solve_at(Component *m, double t, int trial) {
    const FmuArguments at = arguments(m, t, X);
    double tried[N_QP_MEMORY];
    if (trial) memcpy(tried, m->memory, sizeof tried);
    program_data(&at, m->data);
    solve_programs(m->data, m->solution, trial ? tried : m->memory, m->kept, trial, (char *)m + SCRATCH);
}
#else
enum { SCRATCH = sizeof(Component) };
INLINE size_t programs_bytes(void) { return 0; }
INLINE void solve_at(Component *m, double t, int trial) { (void)m, (void)t, (void)trial; }
#endif

/* Outputs that somebody reads, and the next states of a discrete component. The compiler leaves out what these do not
 * depend on, as far as it has these functions at this place; unread_outputs.py has done so for continuous ones. */
__attribute__((noinline, flatten)) static void evaluate(Component *m, double t, lanes *next) {
    FmuArguments at = arguments(m, t, X);
    lanes y[N_OUTPUTS + 1];
    lanes w[WORK < 2048 ? WORK + 1 : 1];
    if (WORK < 2048) at.w = w;
#if IS_CONTINUOUS
    (void)next;
#if N_SHOWN
    outputs(&at, y);
#endif
#else
    sample(&at, y, next);
#endif
#define SHOW(i) Y[i] = y[i];
    SHOWN(SHOW)
}

static void fail(Component *m, unsigned failed, int why, int which, double when, const lanes *value) {
    for (int i = 0; i < LANES; i++)
        if (failed >> i & 1u) {
            m->failure[i] = why;
            m->which[i] = which;
            m->when[i] = when;
            m->value[i] = (*value)[i];
        }
}

/* Which of the lanes in `of` have a value that is not finite; they are noted. */
static unsigned not_finite(
    Component *m, unsigned of, const lanes *values, const int *slots, int n, int why, double when) {
    unsigned failed = 0;
    for (int i = 0; i < n; i++) {
        const int slot = slots ? slots[i] : i;
        const unsigned now = lanes_bits(~(mask)(lanes_size(values[slot]) <= DBL_MAX)) & of & ~failed;
        if (now) fail(m, now, why, slot, when, &values[slot]);
        failed |= now;
    }
    return failed;
}

#if IS_CONTINUOUS
#ifdef ADJOINTS
__attribute__((noinline)) /* once is enough to compile */
#endif
static void rhs(void *component, double t, const lanes *x, lanes *dx) {
#if N_STATES
    const FmuArguments at = arguments((Component *)component, t, x);
    derivatives(&at, dx);
#endif
}

#if IS_ROS2
static void jacobian_of(void *component, double t, const lanes *x, lanes *J, lanes *by_time) {
    const FmuArguments at = arguments((Component *)component, t, x);
    jacobian(&at, J, by_time);
}
#else
#define jacobian_of NULL
#endif

INLINE int step_solver(Component *m, double t, double h, int first) {
    const Integrator of = {
        .method = SOLVER,
        .n = N_STATES,
        .system = m,
        .rhs = rhs,
        .jacobian = jacobian_of,
        .nominals = NOMINALS,
        .velocity_of = VELOCITY_OF,
        .stage = m->k[0],
        .k1 = m->k[1],
        .k2 = m->k[2],
        .k3 = m->k[3],
        .k4 = m->k[4],
        .matrix = m->matrix,
        .by_time = m->matrix + MATRIX,
        .pivots = m->pivots,
    };
    return integrator_step(&of, t, h, first, X);
}

/* One communication step of all lanes; returns which of those in `of` have failed. */
static unsigned step(Component *m, double t, double h, unsigned of) {
    const double count = fmu_ceil(h / ((const double *)&P[0])[0] * (1.0 - 1e-9));
    const int64_t n = count < 1.0 ? 1 : (int64_t)count;
    const double dt = h / (double)n;
    unsigned failed = 0;
    for (int64_t i = 0; i < n; i++) {
        const double ti = t + (double)i * dt;
        const int column = step_solver(m, ti, dt, i == 0);
        if (column < N_STATES) {
            fail(m, of & ~failed, SINGULAR, column, ti, &X[column]);
            return failed | of;
        }
#if N_STATES
        mask within = ~(mask){0};
        for (int j = 0; j < N_STATES; j++) within &= (mask)(lanes_size(X[j]) <= bounds[j]);
        const unsigned beyond = lanes_bits(~within) & of & ~failed;
        unsigned noted = 0;
        for (int j = 0; beyond & ~noted && j < N_STATES; j++) {
            const unsigned now = lanes_bits(~(mask)(lanes_size(X[j]) <= bounds[j])) & beyond & ~noted;
            if (now) fail(m, now, STATE_BEYOND, j, ti + dt, &X[j]);
            noted |= now;
        }
        failed |= beyond;
#endif
    }
    const double reached = t + h;
    *(double *)&m->time = reached;
#if N_SHOWN
    evaluate(m, reached, NULL);
    mask finite = ~(mask){0};
    for (int i = 0; i < N_SHOWN; i++) finite &= (mask)(lanes_size(Y[shown[i]]) <= DBL_MAX);
    if (lanes_bits(~finite) & of & ~failed)
        failed |= not_finite(m, of & ~failed, Y, shown, N_SHOWN, OUTPUT_NOT_FINITE, reached);
#endif
    return failed;
}
#else
static unsigned step(Component *m, double t, double h, unsigned of) {
    const double Ts = SAMPLE_TIME, end = t + h - 1e-6 * Ts, start = *(const double *)&m->start_time;
    double *const sample_number = (double *)&m->sample, *const started = (double *)&m->started;
    unsigned failed = 0;
    for (;;) {
        const double instant = start + *sample_number * Ts;
        if (!(instant < end)) break;
        const double time = *(const double *)&m->time;
#if HAS_START
        if (*started == 0.0) {
            const FmuArguments begin = arguments(m, 0.0, X);
            start_states(&begin, X);
            failed |= not_finite(m, of & ~failed, X, NULL, N_STATES, STATE_NOT_FINITE, time);
        }
#endif
        *started = 1.0;
        lanes *const next = m->k[0];
        solve_at(m, instant, 0);
        evaluate(m, instant, next);
        mask finite = ~(mask){0};
#define MOVE(first, count)                                                                                      \
    for (int i = first; i < first + count; i++) finite &= (mask)(lanes_size(next[i]) <= DBL_MAX);               \
    memcpy(X + first, next + first, count * sizeof(lanes));
        MOVING(MOVE) /* the other states stay as they are */
        for (int i = 0; i < N_SHOWN; i++) finite &= (mask)(lanes_size(Y[shown[i]]) <= DBL_MAX);
        if (lanes_bits(~finite) & of & ~failed) {
            failed |= not_finite(m, of & ~failed, X, NULL, N_STATES, STATE_NOT_FINITE, time);
            failed |= not_finite(m, of & ~failed, Y, shown, N_SHOWN, OUTPUT_NOT_FINITE, time);
        }
        *sample_number += 1.0;
    }
    *(double *)&m->time = t + h;
    return failed;
}
#endif

#if HAS_PLAIN
/* The same component over plain numbers (library.py): where nothing that it reads depends on a direction, its steps are
 * taken there, on a memory behind this one that begins alike. Both lanes are the same copy. STILL: nothing ever depends
 * on one, so its equations over numbers with derivatives, which take long to compile, are not referred to. */
enum { PLAIN = (SCRATCH + 63) / 64 * 64, BEFORE_VALUES = offsetof(Component, v) / sizeof(lanes) };
typedef double Pair[2];
size_t plain_rows(void);
void plain_prepare(void *memory);
unsigned plain_begin(void *memory, double t, double h, unsigned of);
unsigned plain_step(void *memory, double t, double h, unsigned of);
INLINE size_t plain_bytes(void) { return PLAIN - SCRATCH + plain_rows() * sizeof(Pair); }

static void to_plain(Component *m, size_t begin, size_t n) {
    Pair *const to = (Pair *)((char *)m + PLAIN) + begin;
    const lanes *const from = (const lanes *)m + begin;
    for (size_t i = 0; i < n; i++) to[i][0] = to[i][1] = from[i].v;
}

static void from_plain(Component *m, size_t begin, size_t n) {
    const Pair *const from = (const Pair *)((const char *)m + PLAIN) + begin;
    lanes *const to = (lanes *)m + begin;
    for (size_t i = 0; i < n; i++) to[i] = lanes_all(from[i][0]);
}

static int moves(const lanes *values, int n) {
    int any = 0;
    while (n && !any) any = depends(values[--n]); /* parameters, which come first, mostly do not move */
    return any;
}

enum { INPUTS = BEFORE_VALUES + N_PARAMETERS, STATES = INPUTS + N_INPUTS, OUTPUTS = STATES + 2 * N_STATES };

static unsigned step_of_any(Component *m, double t, double h, unsigned of) {
    const uint64_t was_plain = m->sides.plain;
#if STILL
    m->sides.plain = 1;
#else
    m->sides.plain = was_plain ? !moves(U, N_INPUTS) : !moves(m->v, N_VALUES);
    if (was_plain && !m->sides.plain) {
        from_plain(m, 0, BEFORE_VALUES);
        from_plain(m, STATES, 2 * N_STATES + N_OUTPUTS);
    }
    if (!m->sides.plain) return step(m, t, h, of);
#endif
    if (was_plain) to_plain(m, INPUTS, N_INPUTS);
    else to_plain(m, 0, OUTPUTS + N_OUTPUTS); /* a step without a sample keeps its outputs */
    if (!m->prepared) plain_prepare((char *)m + PLAIN);
    m->prepared = 1;
    const unsigned failed = plain_step((char *)m + PLAIN, t, h, 3u) & of;
    from_plain(m, OUTPUTS, N_OUTPUTS);
    if (IS_CONTINUOUS) from_plain(m, STATES, N_STATES); /* which others may read */
    if (failed) from_plain(m, 0, BEFORE_VALUES);
    return failed;
}
#else
INLINE size_t plain_bytes(void) { return 0; }
#define step_of_any step
#endif

EXPORT size_t cosim_lanes_rows(void) {
    return (SCRATCH + programs_bytes() + plain_bytes() + sizeof(lanes) - 1) / sizeof(lanes);
}

#if HAS_PROFILES
const double *lane_profiles(const double *p); /* of one copy: valid until the next call */

/* Most nodes are behind the end of the road; their zeros are touched only where there was another number before. */
static void take_profiles(Component *m) {
    for (int i = 0; i < LANES; i++) {
        double p[N_PARAMETERS + 1];
        for (int k = 0; k < N_PARAMETERS; k++) p[k] = P[k][i];
        const double *const from = lane_profiles(p);
        lanes *const to = (lanes *)&m->profiles;
        for (size_t piece = 0; piece < PIECES; piece++) {
            const size_t begin = piece * PIECE, end = begin + PIECE < N_NODES ? begin + PIECE : N_NODES;
            uint64_t any = m->touched[piece], bits;
            for (size_t k = begin; k < end; k++) {
                memcpy(&bits, &from[k], sizeof bits);
                any |= bits;
            }
            if (!any) continue;
            m->touched[piece] = 1;
            for (size_t k = begin; k < end; k++) to[k][i] = from[k];
        }
    }
}
#endif

EXPORT void cosim_lanes_prepare(void *memory) {
    Component *const m = (Component *)memory;
#ifdef HAS_SIDES
    note_moves(m->v, N_VALUES);
    taken.sides = 0;
#endif
#if HAS_PLAIN
    m->prepared = 0;
#endif
#if N_QP_DATA
    memset(m->kept, 0, sizeof m->kept);
    memset(m->memory, 0, sizeof m->memory);
    memset((char *)m + SCRATCH, 0, programs_bytes());
    fmu_qp_functions.setup((char *)m + SCRATCH);
#endif
#if N_FIXED && !STILL
    const FmuArguments at = arguments(m, 0.0, X);
    prepare(&at, m->fixed);
#endif
#if HAS_PROFILES && !STILL
    take_profiles(m);
#endif
#ifdef HAS_SIDES
    begin_sides(&m->sides);
#endif
}
/* Outputs before the first step, as fmu_core.c has them, with start states that follow inputs and parameters. */
#if STILL
EXPORT unsigned cosim_lanes_begin(void *memory, double t, double h, unsigned of) {
    Component *const m = (Component *)memory;
    to_plain(m, 0, OUTPUTS + N_OUTPUTS);
    plain_prepare((char *)m + PLAIN);
    const unsigned failed = plain_begin((char *)m + PLAIN, t, h, 3u) & of;
    from_plain(m, STATES, 2 * N_STATES + N_OUTPUTS);
    if (failed) from_plain(m, 0, BEFORE_VALUES);
    return failed;
}
#else
EXPORT unsigned cosim_lanes_begin(void *memory, double t, double h, unsigned of) {
    Component *const m = (Component *)memory;
    const double time = *(const double *)&m->time;
    lanes *const next = m->k[0];
    unsigned failed = 0;
    (void)t;
    (void)h;
#ifdef HAS_SIDES
    taken.tied = 0;
#endif
#if HAS_START
    const FmuArguments begin = arguments(m, 0.0, X);
    memcpy(next, X, N_STATES * sizeof(lanes));
    start_states(&begin, next);
    memcpy(X, next, N_STATES * sizeof(lanes));
    failed |= not_finite(m, of, X, NULL, N_STATES, STATE_NOT_FINITE, time);
#endif
    solve_at(m, time, 1);
    evaluate(m, time, next);
#ifdef HAS_SIDES
    note_tie(&m->sides, time);
#endif
    return failed | not_finite(m, of & ~failed, Y, shown, N_SHOWN, OUTPUT_NOT_FINITE, time);
}
#endif
EXPORT unsigned cosim_lanes_step(void *memory, double t, double h, unsigned of) {
    Component *const m = (Component *)memory;
#ifdef HAS_SIDES
    taken.sides = 0;
    taken.tied = 0;
#endif
    const unsigned failed = step_of_any(m, t, h, of);
#ifdef HAS_SIDES
    note_sides(&m->sides, t);
#endif
    return failed;
}

/* Rows of a group's memory that can depend on something: all but the profiles and sides. The last of them are those
 * that last from step to step, after the values: solutions that were found, and what depends on parameters only. */
EXPORT size_t cosim_lanes_numbers(void) { return offsetof(Component, fixed) / sizeof(lanes) + N_FIXED; }

/* Where a group's memory holds the warm starts of the quadratic programs. */
EXPORT size_t cosim_lanes_memory(void) { return offsetof(Component, memory); }

/* Where a group's memory holds what sides it has taken, if it does. */
EXPORT size_t cosim_lanes_sides(void) {
#ifdef HAS_SIDES
    return offsetof(Component, sides);
#else
    return 0;
#endif
}

#if LANES_TARGET && defined(__clang__)
#pragma clang attribute pop
#endif
