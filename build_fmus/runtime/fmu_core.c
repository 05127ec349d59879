/* Values, initialization, stepping and state of an FMU instance: everything that does not depend on the FMI version.
 *
 * An instance is one block of memory: bookkeeping, then the state block (all that a snapshot copies), then work arrays.
 * The first instance of a sampled component has its state block in the binary, where the A2L file says. Nothing is
 * allocated after creation except snapshots, which FMI makes the host own. */

#include "fmu_core.h"

#include <stdarg.h>
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_base.h"
#include "fmu_math.h"
#include "integrators.h"
#include "saved_state.h"
#include "stability.h"

static const FmuModel *const M = &fmu_model;

enum { WARNED_LIMIT = 1, WARNED_CONSTANT = 2 };

struct FmuInstance {
    FmuBase base;
    int uses_events;  /* event mode: the clock may tick */
    unsigned warned; /* one bit per kind of warning about inputs; beside the state, so that saved states do not depend
                        on it */
    State *state;
    double *p, *u, *x, *dx, *y;             /* into state->v */
    double *of_role[FMU_OUTPUT + 1];        /* the same by role, and time */
    double *next;                           /* n_states: start values or the next states until they are found finite */
    Integrator integrator;
    double *seed, *sensitivity;             /* n_states + n_inputs + n_parameters; n_states + n_outputs */
    double *w;                              /* what the component's functions work in */
    double *f;                              /* what follows from the parameters alone, while it is `prepared` */
    int32_t *prepared;
    int32_t own_prepared;                   /* of instances on the heap */
    double *qp_memory;                      /* into state->v */
    double *qp_data, *qp_solution, *qp_trial; /* quadratic programs; trial: their memory while nothing is committed */
    void *qp_scratch;
    double *checks;                         /* n_checks */
    Stability stability;
    double *point_u, *point_x;              /* inputs and states of an operating point */
    int present_is_a_point;                 /* while a check looks at the operating points */
    double *before;                         /* parameters and inputs before they were set */
};

static void rhs(void *instance, double t, const double *x, double *dx);
static void jacobian(void *instance, double t, const double *x, double *J, double *by_time);
static int linearize(void *instance, int point, double *A);

static size_t n_values(void) {
    return (size_t)M->n_parameters + (size_t)M->n_inputs + 2u * (size_t)M->n_states + (size_t)M->n_outputs +
           (size_t)M->n_qp_memory;
}

static size_t state_size(void) { return sizeof(State) + n_values() * sizeof(double); }

typedef char state_head_fits[offsetof(State, v) == FMU_STATE_HEAD * sizeof(double) ? 1 : -1];

#ifdef _MSC_VER
#include <intrin.h>
#define EXCHANGE(at, value) _InterlockedExchange((volatile long *)(at), value)
#else
#define EXCHANGE(at, value) __atomic_exchange_n(at, value, __ATOMIC_SEQ_CST)
#endif

/* The memory of the first instance, unless another instance has it. */
static FmuFirstInstance *take_first(void) { return M->first && !EXCHANGE(&M->first->taken, 1) ? M->first : NULL; }

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }

/* ------------------------------------------------------------------ life cycle */

FmuInstance *fmu_create(int is_co_simulation, size_t adapter_size, FmuLog log) {
    const size_t nx = (size_t)M->n_states, nu = (size_t)M->n_inputs, np = (size_t)M->n_parameters;
    const size_t ny = (size_t)M->n_outputs;
    const size_t sizes[] = {
        aligned(sizeof(FmuInstance)),
        aligned(adapter_size),
        aligned(state_size()),
        aligned(nx * sizeof(double)),
        aligned((nx + nu + np) * sizeof(double)),
        aligned((nx + ny) * sizeof(double)),
        aligned(((size_t)M->n_work + (size_t)M->n_fixed) * sizeof(double)),
        M->is_continuous ? integrator_memory(M->solver, M->n_states) : 0,
        aligned(((size_t)M->n_qp_data + (size_t)M->n_qp_solution + (size_t)M->n_qp_memory) * sizeof(double)),
        M->qp ? aligned(M->qp->scratch_size()) : 0,
        aligned((size_t)M->n_checks * sizeof(double)),
        M->is_continuous && is_co_simulation ? stability_memory(M->solver, M->n_states) : 0,
        M->is_continuous && is_co_simulation ? aligned((2u * nu + nx + np) * sizeof(double)) : 0,
    };
    size_t total = 0;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) total += sizes[i];
    char *block = calloc(1, total);
    if (!block) return NULL;
    void *part[sizeof sizes / sizeof *sizes];
    for (size_t i = 0, offset = 0; i < sizeof sizes / sizeof *sizes; offset += sizes[i], i++) part[i] = block + offset;

    FmuInstance *self = part[0];
    FmuFirstInstance *first = take_first();
    self->state = first ? (State *)(void *)(first + 1) : part[2];
    self->prepared = first ? &first->prepared : &self->own_prepared;
    fmu_base_use(&self->base, is_co_simulation, part[1], log, &self->state->mode);
    self->p = self->state->v;
    self->u = self->p + np;
    self->x = self->u + nu;
    self->dx = self->x + nx;
    self->y = self->dx + nx;
    self->of_role[FMU_TIME] = &self->state->time;
    self->of_role[FMU_PARAMETER] = self->p;
    self->of_role[FMU_INPUT] = self->u;
    self->of_role[FMU_STATE] = self->x;
    self->of_role[FMU_DERIVATIVE] = self->dx;
    self->of_role[FMU_OUTPUT] = self->y;
    self->next = part[3];
    self->seed = part[4];
    self->sensitivity = part[5];
    self->w = part[6];
    self->f = self->w + M->n_work;
    self->integrator = (Integrator){.method = M->solver,
        .n = M->n_states,
        .system = self,
        .rhs = rhs,
        .jacobian = jacobian,
        .nominals = M->nominals,
        .velocity_of = M->velocity_of};
    if (M->is_continuous) integrator_use(&self->integrator, part[7]);
    self->qp_memory = self->y + ny;
    self->qp_data = part[8];
    self->qp_solution = self->qp_data + M->n_qp_data;
    self->qp_trial = self->qp_solution + M->n_qp_solution;
    self->qp_scratch = part[9];
    if (M->qp) M->qp->setup(self->qp_scratch);
    self->checks = part[10];
    self->stability = (Stability){.method = M->solver, .n = M->n_states, .velocity_of = M->velocity_of,
                                  .n_points = M->n_points + 1, .system = self, .linearize = linearize};
    if (M->is_continuous && is_co_simulation) stability_use(&self->stability, part[11]);
    self->point_u = part[12];
    self->point_x = self->point_u + nu;
    self->before = self->point_x + nx;
    (void)fmu_reset(self);
    return self;
}

FmuStatus fmu_open(FmuInstance *self, const char *resources) {
    (void)self;
    (void)resources;
    return FMU_OK;
}

void fmu_free(FmuInstance *self) {
    const int first = self->prepared != &self->own_prepared;
    free(self);
    if (first) (void)EXCHANGE(&M->first->taken, 0);
}

void fmu_set_mode(FmuInstance *self, FmuMode mode) { self->state->mode = (int32_t)mode; }
double fmu_time(const FmuInstance *self) { return self->state->time; }
void fmu_use_events(FmuInstance *self) { self->uses_events = 1; }
int fmu_uses_events(const FmuInstance *self) { return self->uses_events; }

int fmu_ended(const FmuInstance *self) {
    (void)self;
    return 0;
}

static void touch(FmuInstance *self) {
    self->state->start_valid = 0;
    self->state->outputs_valid = 0;
    self->state->derivatives_valid = 0;
}

FmuStatus fmu_reset(FmuInstance *self) {
    memset(self->state, 0, state_size());
    self->warned = 0;
    *self->prepared = 0;
    self->state->mode = MODE_INSTANTIATED;
    const size_t n = (size_t)M->n_parameters + (size_t)M->n_inputs + (size_t)M->n_states;
    if (n) memcpy(self->p, M->start, n * sizeof(double));
    return FMU_OK;
}

FmuStatus fmu_setup(FmuInstance *self, double start_time, int has_stop, double stop_time) {
    if (!isfinite(start_time)) return fmu_fail(self, FMU_ERROR, "startTime %g is not finite", start_time);
    if (has_stop && !(isfinite(stop_time) && stop_time >= start_time))
        return fmu_fail(self, FMU_ERROR, "stopTime %g is not a time after startTime %g", stop_time, start_time);
    self->state->start_time = self->state->time = start_time;
    self->state->has_stop = has_stop;
    self->state->stop_time = has_stop ? stop_time : 0.0;
    touch(self);
    return FMU_OK;
}

/* ------------------------------------------------------------------ evaluation */

/* Name of the variable or hidden state that element i of a role belongs to. */
static const char *name_of(FmuRole role, int i) {
    for (int k = 0; k < M->n_variables; k++) {
        const FmuVariable *v = &M->variables[k];
        if (v->role == role && i >= v->slot && i < v->slot + v->size) return v->name;
    }
    for (int k = 0; k < M->n_hidden; k++) {
        const FmuHidden *h = &M->hidden[k];
        if (role == FMU_STATE && i >= h->slot && i < h->slot + h->size) return h->name;
    }
    return "";
}

/* Name of the first of n values of a role that is not finite, or NULL. */
static const char *not_finite(const double *values, int n, FmuRole role) {
    int finite = 1;
    for (int i = 0; i < n; i++) finite &= fabs(values[i]) <= DBL_MAX; /* all of them without a branch */
    if (finite) return NULL;
    for (int i = 0; i < n; i++)
        if (!isfinite(values[i])) return name_of(role, i);
    return NULL;
}

static FmuStatus check_finite(FmuInstance *self, const double *values, int n, FmuRole role) {
    const char *name = not_finite(values, n, role);
    return name ? fmu_fail(self, FMU_ERROR, "%s is not finite at time %.9g s", name, self->state->time) : FMU_OK;
}

static FmuArguments arguments(FmuInstance *self, double t, const double *x) {
    const FmuArguments at = {
        .t = t, .x = x, .u = self->u, .p = self->p, .f = self->f, .s = self->qp_solution, .w = self->w};
    if (M->prepare && !*self->prepared) M->prepare(&at, self->f);
    *self->prepared = 1;
    return at;
}

static void rhs(void *instance, double t, const double *x, double *dx) {
    const FmuArguments at = arguments(instance, t, x);
    if (M->derivatives) M->derivatives(&at, dx);
}

static void jacobian(void *instance, double t, const double *x, double *J, double *by_time) {
    const FmuArguments at = arguments(instance, t, x);
    if (M->jacobian) M->jacobian(&at, J, by_time);
}

/* Start states: `x` with what is calculated in it. */
static void start_states(FmuInstance *self, const double *x, const double *u, double *result) {
    FmuArguments at = arguments(self, 0.0, x);
    at.u = u;
    memcpy(result, x, (size_t)M->n_states * sizeof(double));
    if (M->start_states) M->start_states(&at, result);
}

/* Solve the quadratic programs, if there are any; `memory` holds their warm starts and receives the next ones. */
static void solve_programs(FmuInstance *self, double t, double *memory) {
    if (!M->qp) return;
    const FmuArguments at = arguments(self, t, self->x);
    M->program_data(&at, self->qp_data);
    M->qp->solve(self->qp_scratch, memory, self->qp_data, self->qp_solution);
}

/* Bring calculated start states up to date while they still follow inputs and parameters. */
static FmuStatus refresh_start(FmuInstance *self) {
    State *s = self->state;
    const int still_starting = M->is_continuous ? s->mode == MODE_INITIALIZATION : !s->started;
    if (s->start_valid || !still_starting) return FMU_OK;
    if (M->start_states) {
        start_states(self, self->x, self->u, self->next);
        const FmuStatus status = check_finite(self, self->next, M->n_states, FMU_STATE);
        if (status != FMU_OK) return status;
        memcpy(self->x, self->next, (size_t)M->n_states * sizeof(double));
    }
    s->start_valid = 1;
    return FMU_OK;
}

static double next_sample(const State *s) { return s->start_time + (double)s->sample * M->sample_time; }

static FmuStatus refresh_outputs(FmuInstance *self) {
    State *s = self->state;
    FmuStatus status = refresh_start(self);
    if (status != FMU_OK || s->outputs_valid) return status;
    const int ticks = s->mode == MODE_TICK;
    if (M->is_continuous || !s->started || ticks) { /* else a discrete component holds the outputs of its last sample */
        const double t = ticks ? next_sample(s) : s->time;
        if (M->qp) memcpy(self->qp_trial, self->qp_memory, (size_t)M->n_qp_memory * sizeof(double));
        solve_programs(self, t, self->qp_trial);
        const FmuArguments at = arguments(self, t, self->x);
        if (M->outputs) M->outputs(&at, self->y);
        if (M->sample)
            M->sample(&at, self->y, self->next); /* the next states are those of a sample that is not taken yet */
        status = check_finite(self, self->y, M->n_outputs, FMU_OUTPUT);
        if (status != FMU_OK) return status;
    }
    s->outputs_valid = 1;
    return FMU_OK;
}

static FmuStatus refresh_derivatives(FmuInstance *self) {
    FmuStatus status = refresh_start(self);
    if (status != FMU_OK || self->state->derivatives_valid) return status;
    rhs(self, self->state->time, self->x, self->dx);
    status = check_finite(self, self->dx, M->n_states, FMU_DERIVATIVE);
    if (status == FMU_OK) self->state->derivatives_valid = 1;
    return status;
}

FmuStatus fmu_enter_initialization(FmuInstance *self) {
    self->state->mode = MODE_INITIALIZATION;
    touch(self);
    return FMU_OK;
}

/* Relations between parameters that their ranges cannot express. */
static FmuStatus check_relations(FmuInstance *self) {
    if (!M->checks) return FMU_OK;
    const FmuArguments at = arguments(self, self->state->time, self->x);
    M->checks(&at, self->checks);
    for (int i = 0; i < M->n_checks; i++)
        if (!(self->checks[i] > 0.0)) return fmu_fail(self, FMU_ERROR, "%s", M->check_messages[i]);
    return FMU_OK;
}

/* ------------------------------------------------------------------ the solver step and the parameters */

/* d(dx/dt)/dx at a declared operating point, or after them at the present state unless that was one of them. */
static int linearize(void *instance, int point, double *A) {
    FmuInstance *self = instance;
    const size_t nx = (size_t)M->n_states, nu = (size_t)M->n_inputs, np = (size_t)M->n_parameters;
    const int present = point == M->n_points;
    const double *start = M->start + np, t = present ? self->state->time : 0.0;
    double *u = self->point_u, *x = self->point_x;
    if (present) {
        if (self->present_is_a_point) return 0;
        memcpy(u, self->u, nu * sizeof(double));
        memcpy(x, self->x, nx * sizeof(double));
    } else {
        const FmuPoint *at = &M->points[point];
        memcpy(u, start, nu * sizeof(double));
        for (int i = 0; i < at->n_settings; i++)
            if (at->settings[i].slot < M->n_inputs) u[at->settings[i].slot] = at->settings[i].value;
        start_states(self, start + nu, u, x);
        for (int i = 0; i < at->n_settings; i++)
            if (at->settings[i].slot >= M->n_inputs) x[at->settings[i].slot - M->n_inputs] = at->settings[i].value;
        if (point == 0) self->present_is_a_point = 0;
        if (self->state->time == 0.0 && memcmp(x, self->x, nx * sizeof(double)) == 0 &&
            memcmp(u, self->u, nu * sizeof(double)) == 0)
            self->present_is_a_point = 1;
    }
    FmuArguments at = arguments(self, t, x);
    at.u = u;
    if (M->jacobian) {
        M->jacobian(&at, A, self->next);
        return 1;
    }
    memset(self->seed, 0, (nx + nu + np) * sizeof(double));
    at.dx = self->seed;
    at.du = self->seed + nx;
    at.dp = self->seed + nx + nu;
    for (size_t j = 0; j < nx; j++) {
        self->seed[j] = 1.0;
        M->directional(&at, self->sensitivity, self->sensitivity + nx);
        self->seed[j] = 0.0;
        memcpy(A + j * nx, self->sensitivity, nx * sizeof(double));
    }
    return 1;
}

static const char *solver_name(FmuSolver solver) {
    switch (solver) {
        case FMU_RK4: return "rk4";
        case FMU_AM2: return "am2";
        case FMU_ROS2: return "ros2";
        default: return "semi_implicit";
    }
}

/* Whether the solver follows the dynamics that the parameters make, which the build has found for their start values.
 */
static FmuStatus check_solver_step(FmuInstance *self) {
    if (!M->is_continuous || !self->base.is_co_simulation || !M->n_states) return FMU_OK;
    if (memcmp(self->p, M->start, (size_t)M->n_parameters * sizeof(double)) == 0) return FMU_OK;
    double shortest = 0.0;
    for (int i = 0; i < M->n_variables; i++)
        if (M->variables[i].role == FMU_PARAMETER && M->variables[i].slot == FMU_SOLVER_STEP_SLOT)
            shortest = M->variables[i].min;
    const double step = self->p[FMU_SOLVER_STEP_SLOT];
    Instability wrong = {0, 0, 0.0, 0.0, 0.0};
    if (stability_check(&self->stability, step, shortest, &wrong)) return FMU_OK;
    char where[128] = "the present state", advice[64] = "no solver.step within its limits would do";
    if (wrong.point < M->n_points)
        (void)snprintf(where, sizeof where, "operating point '%s'", M->points[wrong.point].name);
    if (wrong.step > 0.0) (void)snprintf(advice, sizeof advice, "a solver.step of %.3g s would do", wrong.step);
    if (!wrong.found)
        return fmu_fail(
            self, FMU_ERROR, "with the parameters set, the dynamics of %s at %s are not finite", M->name, where);
    return fmu_fail(self, FMU_ERROR,
        "with the parameters set, solver %s with solver.step %g s is unstable at %s (eigenvalue %.4g%+.4gi 1/s); %s",
        solver_name(M->solver), step, where, wrong.real, wrong.imag, advice);
}

FmuStatus fmu_exit_initialization(FmuInstance *self) {
    FmuStatus status = check_relations(self);
    if (status == FMU_OK) status = refresh_outputs(self);
    if (status == FMU_OK && M->is_continuous) status = refresh_derivatives(self);
    if (status == FMU_OK) status = check_solver_step(self);
    const FmuMode next = self->base.is_co_simulation && !self->uses_events ? MODE_STEP : MODE_EVENT;
    self->state->mode = (int32_t)(status != FMU_OK ? MODE_ERROR : next);
    if (status == FMU_OK) (void)fmu_fail(self, FMU_OK, "%s initialized at %.9g s", M->name, self->state->time);
    return status;
}

/* ------------------------------------------------------------------ values */

static inline double *storage(const FmuInstance *self, const FmuVariable *v) {
    return self->of_role[v->role] + v->slot;
}

/* The variable behind reference i, or NULL after an error. */
static inline const FmuVariable *lookup(
    FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t i) {
    if (refs[i] >= (unsigned)M->n_variables) {
        (void)fmu_fail(self, FMU_ERROR, "%s: unknown value reference %u", function, refs[i]);
        return NULL;
    }
    const FmuVariable *v = &M->variables[refs[i]];
    if (v->type != type) {
        (void)fmu_fail(self, FMU_ERROR, "%s: variable %s is of type %s", function, v->name, fmu_type_name(v->type));
        return NULL;
    }
    return v;
}

static double read_double(const void *values, size_t i) { return ((const double *)values)[i]; }
static void write_double(void *values, size_t i, double value) { ((double *)values)[i] = value; }

/* Inlined below with the conversion of the type, so that no number of a real variable is passed by a call. */
static inline FmuStatus get_with(FmuInstance *self, const char *function, FmuType type, const unsigned *refs,
    size_t n_refs, void *values, size_t count, FmuWrite write) {
    FmuStatus status = fmu_check_arrays(self, function, refs, n_refs, values, count);
    unsigned fresh =
        self->state->mode == MODE_ERROR ? ~0u : 0u; /* one bit per role; after an error: the values as they are */
    size_t k = 0;
    for (size_t i = 0; i < n_refs && status == FMU_OK; i++) {
        const FmuVariable *v = lookup(self, function, type, refs, i);
        if (!v) return FMU_ERROR;
        if (k + (size_t)v->size > count)
            return fmu_fail(
                self, FMU_ERROR, "%s: nValues is %zu, too few for the variables up to %s", function, count, v->name);
        if (!(fresh >> v->role & 1u)) {
            status = v->role == FMU_OUTPUT       ? refresh_outputs(self)
                     : v->role == FMU_DERIVATIVE ? refresh_derivatives(self)
                     : v->role == FMU_STATE      ? refresh_start(self)
                                                 : FMU_OK;
            if (status != FMU_OK) return status;
            fresh |= 1u << v->role;
        }
        const double *from = storage(self, v);
        for (int j = 0; j < v->size; j++) write(values, k++, from[j]);
    }
    if (status == FMU_OK && k != count)
        status = fmu_fail(self, FMU_ERROR, "%s: nValues is %zu, the variables have %zu", function, count, k);
    return status;
}

static inline FmuStatus check_settable(FmuInstance *self, const char *function, const FmuVariable *v) {
    const unsigned mode = (unsigned)self->state->mode;
    const unsigned before = MODE_INSTANTIATED | MODE_INITIALIZATION;
    unsigned modes = 0;
    switch (v->role) {
        case FMU_PARAMETER:
            modes =
                before | (v->is_tunable ? (self->uses_events ? MODE_EVENT | MODE_TICK : MODE_EVENT | MODE_STEP) : 0u);
            break;
        case FMU_INPUT: /* Integers and Booleans are discrete: they change at events only. With a clock, between its
                           ticks too, for importers that do not tick it: the next sample sees what was set last. */
            modes = before | MODE_EVENT | MODE_TICK | MODE_STEP | (v->type == FMU_FLOAT64 ? MODE_CONTINUOUS_TIME : 0u);
            break;
        case FMU_STATE: modes = v->is_exact ? before : 0u; break;
        default: break;
    }
    if (modes & mode) return FMU_OK;
    if (!modes) return fmu_fail(self, FMU_ERROR, "%s: variable %s is calculated and cannot be set", function, v->name);
    return fmu_fail(self, FMU_ERROR, "%s: variable %s cannot be set in state '%s'", function, v->name,
                    fmu_mode_name(self->state->mode));
}

static int in_range(const FmuVariable *v, double value) { return value >= v->min && value <= v->max; }

/* Real inputs are signals: what overshoots a limit is clipped by the equations, and is no error. */
static int is_signal(const FmuVariable *v) { return v->role == FMU_INPUT && v->type == FMU_FLOAT64; }

/* Tell once per instance that an input goes beyond its limits, and once that a constant is not the expected one. The
 * call succeeds all the same: there are tools that end a simulation at Warning. */
static void warn_of_input(FmuInstance *self, const char *function, const FmuVariable *v, double value) {
    if (!in_range(v, value) && !(self->warned & WARNED_LIMIT)) {
        self->warned |= WARNED_LIMIT;
        (void)fmu_fail(self, FMU_WARNING,
            "%s: value %.9g for %s is outside its range [%.9g, %.9g]; the equations take the nearest value inside, "
            "for every real input, and say so only once",
            function, value, v->name, v->min, v->max);
    }
    if (value != 0.0 && v->tolerance > 0.0 && !(fabs(value - v->must_equal) <= v->tolerance) &&
        !(self->warned & WARNED_CONSTANT)) {
        self->warned |= WARNED_CONSTANT;
        (void)fmu_fail(self, FMU_WARNING,
            "%s: %s is %.9g, but %s is made for a source where it is %.9g: take one, or build this FMU for the "
            "source; 0 for none (said only once)",
            function, v->name, value, M->name, v->must_equal);
    }
}

static inline FmuStatus set_with(FmuInstance *self, const char *function, FmuType type, const unsigned *refs,
    size_t n_refs, const void *values, size_t count, FmuRead read) {
    FmuStatus status = fmu_check_arrays(self, function, refs, n_refs, values, count);
    if (status != FMU_OK) return status;
    /* First look at everything, then store: a call that fails changes nothing. */
    size_t k = 0;
    int parameters = 0;
    for (size_t i = 0; i < n_refs; i++) {
        const FmuVariable *v = lookup(self, function, type, refs, i);
        if (!v) return FMU_ERROR;
        parameters |= v->role == FMU_PARAMETER;
        status = check_settable(self, function, v);
        if (status != FMU_OK) return status;
        if (k + (size_t)v->size > count)
            return fmu_fail(
                self, FMU_ERROR, "%s: nValues is %zu, too few for the variables up to %s", function, count, v->name);
        for (int j = 0; j < v->size; j++, k++) {
            const double value = read(values, k);
            if (!isfinite(value))
                return fmu_fail(self, FMU_ERROR, "%s: value %g for %s is not finite", function, value, v->name);
            if (!in_range(v, value) && !is_signal(v))
                return fmu_fail(self, FMU_ERROR, "%s: value %.9g for %s is outside its range [%.9g, %.9g]", function,
                    value, v->name, v->min, v->max);
        }
    }
    if (k != count) return fmu_fail(self, FMU_ERROR, "%s: nValues is %zu, the variables have %zu", function, count, k);
    /* What was set before is checked at the start. */
    const int running = parameters && self->state->mode == MODE_STEP && M->is_continuous;
    const size_t n_parameters = (size_t)M->n_parameters * sizeof(double);
    const size_t n_kept = n_parameters + (size_t)M->n_inputs * sizeof(double);
    if (running) memcpy(self->before, self->p, n_kept);
    for (size_t i = 0, n = 0; i < n_refs; i++) {
        const FmuVariable *v = &M->variables[refs[i]];
        double *to = storage(self, v);
        for (int j = 0; j < v->size; j++) {
            to[j] = read(values, n++);
            if (is_signal(v) && (!in_range(v, to[j]) || v->tolerance > 0.0)) warn_of_input(self, function, v, to[j]);
        }
    }
    if (parameters) *self->prepared = 0;
    if (running && memcmp(self->before, self->p, n_parameters) != 0 && check_solver_step(self) != FMU_OK) {
        memcpy(self->p, self->before, n_kept);
        *self->prepared = 0;
        return FMU_ERROR;
    }
    if (n_refs) touch(self);
    return FMU_OK;
}

FmuStatus fmu_get(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
    double *values, size_t count) {
    return get_with(self, function, type, refs, n_refs, values, count, write_double);
}

FmuStatus fmu_set(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                  const double *values, size_t count) {
    return set_with(self, function, type, refs, n_refs, values, count, read_double);
}

FmuStatus fmu_get_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     void *values, size_t count, FmuWrite write) {
    return get_with(self, function, type, refs, n_refs, values, count, write);
}

FmuStatus fmu_set_as(FmuInstance *self, const char *function, FmuType type, const unsigned *refs, size_t n_refs,
                     const void *values, size_t count, FmuRead read) {
    return set_with(self, function, type, refs, n_refs, values, count, read);
}

/* A component has no texts. */
FmuStatus fmu_get_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
                        const char *values[], size_t count) {
    (void)refs, (void)values;
    return n_refs + count ? fmu_fail(self, FMU_ERROR, "%s: %s has no String variables", function, M->name) : FMU_OK;
}

FmuStatus fmu_set_texts(FmuInstance *self, const char *function, const unsigned *refs, size_t n_refs,
                        const char *const values[], size_t count) {
    (void)values;
    return fmu_get_texts(self, function, refs, n_refs, NULL, count);
}

/* ------------------------------------------------------------------ partial derivatives */

/* Where the derivative of a variable is computed; NULL for what is no unknown. */
static const double *sensitivity_of(const FmuInstance *self, const FmuVariable *v) {
    switch (v->role) {
        case FMU_DERIVATIVE: return self->sensitivity + v->slot;
        case FMU_OUTPUT: return self->sensitivity + M->n_states + v->slot;
        case FMU_STATE: return self->seed + v->slot;
        default: return NULL;
    }
}

/* Where the direction along a variable is given; NULL for what is no known. */
static double *seed_of(FmuInstance *self, const FmuVariable *v) {
    const int starting = self->state->mode == MODE_INITIALIZATION;
    switch (v->role) {
        case FMU_STATE: return v->is_exact || !starting ? self->seed + v->slot : NULL;
        case FMU_INPUT: return self->seed + M->n_states + v->slot;
        case FMU_PARAMETER: return self->seed + M->n_states + M->n_inputs + v->slot;
        default: return NULL;
    }
}

static size_t n_seeds(void) { return (size_t)M->n_states + (size_t)M->n_inputs + (size_t)M->n_parameters; }

/* Whether unknowns and knowns are such, with so many numbers, and seeds are finite. */
static FmuStatus check_partial(
    FmuInstance *self, const char *function, const FmuPartial *of, size_t n_unknowns, size_t n_knowns) {
    if (!M->is_continuous)
        return fmu_fail(self, FMU_ERROR, "%s: a discrete component has no partial derivatives", function);
    const FmuStatus status = refresh_start(self);
    if (status != FMU_OK) return status;
    for (int known = 0; known < 2; known++) {
        const unsigned *refs = known ? of->knowns : of->unknowns;
        const size_t n = known ? of->n_knowns : of->n_unknowns, expected = known ? n_knowns : n_unknowns;
        size_t count = 0;
        for (size_t i = 0; i < n; i++) {
            const FmuVariable *v = lookup(self, function, FMU_FLOAT64, refs, i);
            if (!v) return FMU_ERROR;
            if (known ? !seed_of(self, v) : !sensitivity_of(self, v))
                return fmu_fail(self, FMU_ERROR, "%s: %s is not %s", function, v->name,
                    known ? "a known (state, input or parameter)" : "an unknown");
            for (int j = 0; known != of->is_adjoint && j < v->size && count + (size_t)j < expected; j++)
                if (!isfinite(of->seed[count + (size_t)j]))
                    return fmu_fail(self, FMU_ERROR, "%s: seed for %s is not finite", function, v->name);
            count += (size_t)v->size;
        }
        if (count != expected)
            return fmu_fail(self, FMU_ERROR, "%s: %zu %s values for %zu %s", function, expected,
                known != of->is_adjoint ? "seed" : "sensitivity", count, known ? "knowns" : "unknowns");
    }
    return FMU_OK;
}

/* Derivatives along `self->seed`; those of the unknowns must be finite. */
static FmuStatus differentiate(FmuInstance *self, const char *function, const FmuPartial *of) {
    const size_t nx = (size_t)M->n_states;
    FmuArguments at = arguments(self, self->state->time, self->x);
    at.dx = self->seed;
    at.du = at.dx + nx;
    at.dp = at.du + M->n_inputs;
    if (self->state->mode == MODE_INITIALIZATION && M->directional_start) {
        memcpy(self->next, self->seed, nx * sizeof(double));
        M->directional_start(&at, self->next);
        memcpy(self->seed, self->next, nx * sizeof(double));
    }
    if (M->directional) M->directional(&at, self->sensitivity, self->sensitivity + nx);
    for (size_t i = 0; i < of->n_unknowns; i++) {
        const FmuVariable *v = &M->variables[of->unknowns[i]];
        const double *from = sensitivity_of(self, v);
        for (int j = 0; j < v->size; j++)
            if (!isfinite(from[j]))
                return fmu_fail(self, FMU_ERROR, "%s: the directional derivative of %s is not finite at time %.9g s",
                    function, v->name, self->state->time);
    }
    return FMU_OK;
}

/* Sensitivities of the unknowns along one direction. */
static FmuStatus directional(FmuInstance *self, const char *function, const FmuPartial *of, double *sensitivity) {
    const double *seed = of->seed;
    memset(self->seed, 0, n_seeds() * sizeof(double));
    for (size_t i = 0; i < of->n_knowns; i++) {
        const FmuVariable *v = &M->variables[of->knowns[i]];
        memcpy(seed_of(self, v), seed, (size_t)v->size * sizeof(double));
        seed += v->size;
    }
    const FmuStatus status = differentiate(self, function, of);
    for (size_t i = 0; status == FMU_OK && i < of->n_unknowns; i++) {
        const FmuVariable *v = &M->variables[of->unknowns[i]];
        memcpy(sensitivity, sensitivity_of(self, v), (size_t)v->size * sizeof(double));
        sensitivity += v->size;
    }
    return status;
}

/* Sensitivities by the knowns of a sum of unknowns. One direction after the other: as many evaluations as there are
 * numbers of knowns, and no generated code beside that of the directional derivatives. */
static FmuStatus adjoint(FmuInstance *self, const char *function, const FmuPartial *of, double *sensitivity) {
    for (size_t i = 0; i < of->n_knowns; i++) {
        const FmuVariable *known = &M->variables[of->knowns[i]];
        for (int k = 0; k < known->size; k++) {
            memset(self->seed, 0, n_seeds() * sizeof(double));
            seed_of(self, known)[k] = 1.0;
            const FmuStatus status = differentiate(self, function, of);
            if (status != FMU_OK) return status;
            const double *weight = of->seed;
            double sum = 0.0;
            for (size_t u = 0; u < of->n_unknowns; u++) {
                const FmuVariable *v = &M->variables[of->unknowns[u]];
                for (int j = 0; j < v->size; j++) sum += *weight++ * sensitivity_of(self, v)[j];
            }
            if (!isfinite(sum))
                return fmu_fail(self, FMU_ERROR, "%s: the adjoint derivative by %s is not finite at time %.9g s",
                    function, known->name, self->state->time);
            *sensitivity++ = sum;
        }
    }
    return FMU_OK;
}

FmuStatus fmu_partial_derivative(FmuInstance *self, const char *function, const FmuPartial *of, double *sensitivity,
    size_t n_sensitivity) {
    const size_t n_unknowns = of->is_adjoint ? of->n_seed : n_sensitivity;
    const size_t n_knowns = of->is_adjoint ? n_sensitivity : of->n_seed;
    FmuStatus status = fmu_check_arrays(self, function, of->unknowns, of->n_unknowns, of->seed, of->n_seed);
    if (status == FMU_OK)
        status = fmu_check_arrays(self, function, of->knowns, of->n_knowns, sensitivity, n_sensitivity);
    if (status == FMU_OK) status = check_partial(self, function, of, n_unknowns, n_knowns);
    if (status != FMU_OK) return status;
    return of->is_adjoint ? adjoint(self, function, of, sensitivity) : directional(self, function, of, sensitivity);
}

/* ------------------------------------------------------------------ stepping */

static FmuStatus advance_continuous(FmuInstance *self, const char *function, double t, double h) {
    const double count = ceil(h / self->p[FMU_SOLVER_STEP_SLOT] * (1.0 - 1e-9));
    const int64_t n = count < 1.0 ? 1 : (int64_t)count;
    const double dt = h / (double)n;
    for (int64_t i = 0; i < n; i++) {
        const double ti = t + (double)i * dt;
        const int found = integrator_step(&self->integrator, ti, dt, i == 0, self->x);
        if (found < M->n_states) {
            self->state->time = ti;
            return fmu_fail(self, FMU_ERROR,
                            "%s: the matrix of solver ros2 of %s is singular or not finite at time %.9g s (state %s); "
                            "try another solver.step (here steps of %g s)",
                            function, M->name, ti, name_of(FMU_STATE, found), dt);
        }
        int within = 1;
        for (int j = 0; j < M->n_states; j++)
            within &= fabs(self->x[j]) <= M->bounds[j]; /* all of them without a branch */
        for (int j = 0; !within && j < M->n_states; j++)
            if (!(fabs(self->x[j]) <= M->bounds[j])) {
                self->state->time = ti + dt;
                return fmu_fail(self, FMU_ERROR,
                                "%s: state %s diverged at time %.9g s: it is %g, beyond its bound %g; check inputs and "
                                "parameters, or reduce solver.step",
                                function, name_of(FMU_STATE, j), ti + dt, self->x[j], M->bounds[j]);
            }
    }
    return FMU_OK;
}

static FmuStatus take_sample(FmuInstance *self) {
    State *s = self->state;
    const double instant = next_sample(s);
    FmuStatus status = refresh_start(self);
    if (status != FMU_OK) return status;
    s->started = 1;
    solve_programs(self, instant, self->qp_memory);
    const FmuArguments at = arguments(self, instant, self->x);
    M->sample(&at, self->y, self->next);
    status = check_finite(self, self->next, M->n_states, FMU_STATE);
    if (status == FMU_OK) status = check_finite(self, self->y, M->n_outputs, FMU_OUTPUT);
    if (status != FMU_OK) return status;
    memcpy(self->x, self->next, (size_t)M->n_states * sizeof(double));
    s->sample++;
    return FMU_OK;
}

FmuStatus fmu_tick(FmuInstance *self, const char *function) {
    const State *s = self->state;
    const double instant = next_sample(s);
    if (!(fabs(s->time - instant) <= 1e-6 * M->sample_time + 1e-9 * (1.0 + fabs(instant))))
        return fmu_fail(self, FMU_ERROR, "%s: the clock ticks at %.12g s, and the instance is at %.12g s", function,
            instant, s->time);
    self->state->mode = MODE_TICK;
    self->state->outputs_valid = 0;
    return FMU_OK;
}

FmuStatus fmu_take_sample(FmuInstance *self, const char *function) {
    (void)function;
    const FmuStatus status = take_sample(self);
    self->state->mode = status == FMU_OK ? MODE_EVENT : MODE_ERROR;
    self->state->outputs_valid = status == FMU_OK;
    return status;
}

static FmuStatus advance_discrete(FmuInstance *self, const char *function, double t, double h) {
    State *s = self->state;
    const double Ts = M->sample_time, end = t + h - 1e-6 * Ts;
    const double first = next_sample(s);
    if (!(first + 0.5 * Ts > first))
        return fmu_fail(
            self, FMU_ERROR, "%s: at time %g s samples every %g s cannot be told apart", function, first, Ts);
    if ((end - first) / Ts > MAX_STEPS_PER_CALL)
        return fmu_fail(self, FMU_ERROR, "%s: up to %.12g s there are %.3g missed samples, too many for one call",
            function, end, (end - first) / Ts);
    /* With event mode these are the samples that no tick of the clock has taken: an importer need not tick it. */
    while (next_sample(s) < end) {
        const FmuStatus status = take_sample(self);
        if (status != FMU_OK) return status;
    }
    return FMU_OK;
}

FmuStatus fmu_do_step(FmuInstance *self, const char *function, double time, double step) {
    State *s = self->state;
    if (!isfinite(step) || step <= 0.0)
        return fmu_fail(self, FMU_ERROR, "%s: communicationStepSize %g is not a positive number", function, step);
    const double tolerance = fmin(1e-9 * (1.0 + fabs(s->time)), 0.5 * step);
    if (!(fabs(time - s->time) <= tolerance))
        return fmu_fail(self, FMU_ERROR, "%s: currentCommunicationPoint %.12g, but the instance is at %.12g", function,
            time, s->time);
    if (!(time + 0.5 * step > time))
        return fmu_fail(self, FMU_ERROR, "%s: communicationStepSize %g s is below the time resolution at %g s",
            function, step, time);
    if (s->has_stop && time + step > s->stop_time + 1e-9 * (1.0 + fabs(s->stop_time)))
        return fmu_fail(
            self, FMU_ERROR, "%s: the step ends at %.12g, after stopTime %.12g", function, time + step, s->stop_time);
    const double pieces = step / (M->is_continuous ? self->p[FMU_SOLVER_STEP_SLOT] : M->sample_time);
    if (pieces > MAX_STEPS_PER_CALL)
        return fmu_fail(self, FMU_ERROR, "%s: communicationStepSize %g s asks for %.3g %s", function, step, pieces,
                        M->is_continuous ? "solver steps" : "samples");
    const FmuStatus status = M->is_continuous ? advance_continuous(self, function, time, step)
                                              : advance_discrete(self, function, time, step);
    s->outputs_valid = M->is_continuous ? 0 : status == FMU_OK && s->started;
    s->derivatives_valid = 0;
    if (status == FMU_OK) s->time = time + step;
    else s->mode = MODE_ERROR;
    return status;
}

/* ------------------------------------------------------------------ model exchange */

FmuStatus fmu_set_time(FmuInstance *self, const char *function, double time) {
    if (!isfinite(time)) return fmu_fail(self, FMU_ERROR, "%s: time %g is not finite", function, time);
    self->state->time = time;
    self->state->outputs_valid = self->state->derivatives_valid = 0;
    return FMU_OK;
}

static FmuStatus check_states(FmuInstance *self, const char *function, const void *values, size_t n) {
    if (n != (size_t)M->n_states)
        return fmu_fail(self, FMU_ERROR, "%s: %zu states, expected %d", function, n, M->n_states);
    return fmu_check_arrays(self, function, NULL, 0, values, n);
}

FmuStatus fmu_set_states(FmuInstance *self, const char *function, const double *x, size_t n) {
    FmuStatus status = check_states(self, function, x, n);
    for (size_t i = 0; i < n && status == FMU_OK; i++)
        if (!isfinite(x[i]))
            status = fmu_fail(self, FMU_ERROR, "%s: value %g for state %s is not finite", function, x[i],
                              name_of(FMU_STATE, (int)i));
    if (status != FMU_OK) return status;
    if (n) memcpy(self->x, x, n * sizeof(double));
    self->state->outputs_valid = self->state->derivatives_valid = 0;
    return FMU_OK;
}

FmuStatus fmu_get_states(FmuInstance *self, const char *function, double *x, size_t n) {
    FmuStatus status = check_states(self, function, x, n);
    if (status == FMU_OK) status = refresh_start(self);
    if (status == FMU_OK && n) memcpy(x, self->x, n * sizeof(double));
    return status;
}

FmuStatus fmu_get_derivatives(FmuInstance *self, const char *function, double *dx, size_t n) {
    FmuStatus status = check_states(self, function, dx, n);
    if (status == FMU_OK) status = refresh_derivatives(self);
    if (status == FMU_OK && n) memcpy(dx, self->dx, n * sizeof(double));
    return status;
}

FmuStatus fmu_get_nominals(FmuInstance *self, const char *function, double *nominals, size_t n) {
    FmuStatus status = check_states(self, function, nominals, n);
    if (status == FMU_OK && n) memcpy(nominals, M->nominals, n * sizeof(double));
    return status;
}

/* ------------------------------------------------------------------ snapshots */

static State *snapshot_state(const void *snapshot) { return (State *)((char *)snapshot + sizeof(FmuSnapshot)); }

/* The interfaces differ in their modes: 0 Model Exchange, 1 Co-Simulation, 3 with event mode. */
static uint32_t interface_of(const FmuInstance *self) {
    return (uint32_t)self->base.is_co_simulation + 2u * (uint32_t)(self->uses_events != 0);
}

/* Whether it is a header of this component: of a state in memory or, when `bytes`, of a serialized one. */
static FmuStatus check_header(FmuInstance *self, const char *function, const void *snapshot, int bytes) {
    if (!snapshot) return fmu_fail(self, FMU_ERROR, "%s: the FMU state is NULL", function);
    FmuSnapshot h;
    memcpy(&h, snapshot, sizeof h);
    if (h.magic != SNAPSHOT_MAGIC || (!bytes && h.checksum != (uint64_t)(uintptr_t)snapshot))
        return fmu_fail(self, FMU_ERROR, "%s: this is not a state of this FMU", function);
    if (h.version != SNAPSHOT_VERSION)
        return fmu_fail(
            self, FMU_ERROR, "%s: state format %u, this FMU reads %u", function, h.version, SNAPSHOT_VERSION);
    if (h.model != fmu_hash(M->token, strlen(M->token)) || h.length != state_size())
        return fmu_fail(
            self, FMU_ERROR, "%s: the state belongs to another component or build than %s", function, M->name);
    if (h.is_co_simulation != interface_of(self))
        return fmu_fail(self, FMU_ERROR, "%s: the state is one of a %s instance%s", function,
            h.is_co_simulation ? "Co-Simulation" : "Model Exchange",
            h.is_co_simulation == 3u ? " with event mode" : "");
    return FMU_OK;
}

static FmuStatus check_snapshot(FmuInstance *self, const char *function, const void *snapshot) {
    return check_header(self, function, snapshot, 0);
}

/* Whether a discrete component can have come as far as its state says: the last sample before the present time, the
 * next one not (advance_discrete), so that no step has more to catch up than its own length. */
static int sample_ok(const State *s, unsigned mode) {
    const double Ts = M->sample_time, next = s->start_time + (double)s->sample * Ts;
    if (s->sample < 0 || s->sample > INT64_MAX / 2) return 0;
    if (mode == MODE_ERROR) return 1;
    if (M->is_continuous || mode & (MODE_INSTANTIATED | MODE_INITIALIZATION)) return s->sample == 0 && !s->started;
    if (s->started != (s->sample > 0) || next < s->time - 1e-6 * Ts) return 0;
    return next <= s->time + Ts + 1e-8 * (1.0 + fabs(s->time));
}

/* What of a state block cannot be of this component, as whatever the equations and solvers take for granted must be;
 * NULL when there is nothing. After an error numbers are as the error left them, and nothing is computed from them any
 * more. */
static const char *wrong_in(const State *s, uint32_t interface) {
    const unsigned own = interface == 1u   ? MODE_STEP
                         : interface == 3u ? MODE_STEP | MODE_EVENT | MODE_TICK
                                           : MODE_EVENT | MODE_CONTINUOUS_TIME;
    const unsigned modes = MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_TERMINATED | MODE_ERROR | own;
    const unsigned mode = (unsigned)s->mode;
    if (!mode || mode & (mode - 1u) || mode & ~modes) return "its mode";
    const int32_t flags[] = {s->has_stop, s->started, s->start_valid, s->outputs_valid, s->derivatives_valid};
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++)
        if (flags[i] != 0 && flags[i] != 1) return "its flags";
    if (!isfinite(s->time) || !isfinite(s->start_time) || !isfinite(s->stop_time)) return "its time";
    if (s->has_stop && s->stop_time < s->start_time) return "its stop time";
    if (!sample_ok(s, mode)) return "its number of samples";

    const double *p = s->v, *u = p + M->n_parameters, *x = u + M->n_inputs, *dx = x + M->n_states,
                 *y = dx + M->n_states;
    for (int i = 0; i < M->n_variables; i++) {
        const FmuVariable *v = &M->variables[i];
        if (v->role != FMU_PARAMETER && v->role != FMU_INPUT) continue;
        for (int j = 0; j < v->size; j++) {
            const double value = (v->role == FMU_PARAMETER ? p : u)[v->slot + j];
            const int legal = v->type == FMU_FLOAT64   ? isfinite(value)
                              : v->type == FMU_BOOLEAN ? value == 0.0 || value == 1.0
                                                       : value == (double)fmu_to_int(value);
            if (!legal || (!in_range(v, value) && !is_signal(v))) return v->name;
        }
    }
    const char *name = NULL;
    if (mode != MODE_ERROR) name = not_finite(x, M->n_states, FMU_STATE);
    if (!name && mode != MODE_ERROR && s->derivatives_valid) name = not_finite(dx, M->n_states, FMU_DERIVATIVE);
    if (!name && mode != MODE_ERROR && (s->outputs_valid || s->started)) name = not_finite(y, M->n_outputs, FMU_OUTPUT);
    if (!name && M->qp && !M->qp->memory_ok(y + M->n_outputs)) name = "the warm start of its quadratic programs";
    return name;
}

static FmuStatus check_state(FmuInstance *self, const char *function, const State *s) {
    const char *wrong = wrong_in(s, interface_of(self));
    return wrong ? fmu_fail(self, FMU_ERROR, "%s: this cannot be a state of %s: %s", function, M->name, wrong) : FMU_OK;
}

FmuStatus fmu_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    if (!snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (*snapshot) { /* reuse the caller's block */
        FmuStatus status = check_snapshot(self, function, *snapshot);
        if (status != FMU_OK) return status;
    } else {
        *snapshot = malloc(sizeof(FmuSnapshot) + state_size());
        if (!*snapshot) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    }
    const FmuSnapshot h = {SNAPSHOT_MAGIC, SNAPSHOT_VERSION, interface_of(self), 0,
        fmu_hash(M->token, strlen(M->token)), state_size(), (uint64_t)(uintptr_t)*snapshot};
    memcpy(*snapshot, &h, sizeof h);
    memcpy(snapshot_state(*snapshot), self->state, state_size());
    return FMU_OK;
}

FmuStatus fmu_restore(FmuInstance *self, const char *function, const void *snapshot) {
    const FmuStatus status = check_snapshot(self, function, snapshot);
    if (status == FMU_OK) {
        memcpy(self->state, snapshot_state(snapshot), state_size());
        *self->prepared = 0;
    }
    return status;
}

FmuStatus fmu_free_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    if (!snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (!*snapshot) return FMU_OK;
    FmuStatus status = check_snapshot(self, function, *snapshot);
    if (status != FMU_OK) return status;
    free(*snapshot);
    *snapshot = NULL;
    return FMU_OK;
}

FmuStatus fmu_serialized_size(FmuInstance *self, const char *function, const void *snapshot, size_t *size) {
    FmuStatus status = check_snapshot(self, function, snapshot);
    if (status == FMU_OK && !size) status = fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (status == FMU_OK) *size = sizeof(FmuSnapshot) + state_size();
    return status;
}

FmuStatus fmu_serialize(
    FmuInstance *self, const char *function, const void *snapshot, unsigned char *bytes, size_t size) {
    FmuStatus status = check_snapshot(self, function, snapshot);
    if (status != FMU_OK) return status;
    if (!bytes || size < sizeof(FmuSnapshot) + state_size())
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are too few, need %zu", function, bytes ? size : 0,
                        sizeof(FmuSnapshot) + state_size());
    FmuSnapshot h;
    memcpy(&h, snapshot, sizeof h);
    h.checksum = fmu_hash(snapshot_state(snapshot), state_size());
    memcpy(bytes, &h, sizeof h);
    memcpy(bytes + sizeof h, snapshot_state(snapshot), state_size());
    return FMU_OK;
}

FmuStatus fmu_deserialize(
    FmuInstance *self, const char *function, const unsigned char *bytes, size_t size, void **snapshot) {
    if (!bytes || !snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    const size_t need = sizeof(FmuSnapshot) + state_size();
    if (size < sizeof(FmuSnapshot))
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are not a serialized state", function, size);
    FmuStatus status = check_header(self, function, bytes, 1);
    if (status != FMU_OK) return status;
    FmuSnapshot h;
    memcpy(&h, bytes, sizeof h);
    if (size != need || h.checksum != fmu_hash(bytes + sizeof h, state_size()))
        return fmu_fail(self, FMU_ERROR, "%s: the serialized state of %s is damaged", function, M->name);
    void *copy = malloc(need);
    if (!copy) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    h.checksum = (uint64_t)(uintptr_t)copy;
    memcpy(copy, &h, sizeof h);
    memcpy(snapshot_state(copy), bytes + sizeof h, state_size());
    status = check_state(self, function, snapshot_state(copy));
    if (status == FMU_OK) *snapshot = copy;
    else free(copy);
    return status;
}
