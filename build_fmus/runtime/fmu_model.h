/* What the generated code of one component tells the runtime. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H

#include <stddef.h>
#include <stdint.h>

/* Numbers of equations: `scalar` ones are no elements of arrays; `local` ones, inside of a function, have no
 * derivatives where numbers have some (cosim/batch/runtime/numbers.h). */
#ifndef LANES /* else a vector of numbers, one for each of the copies side by side */
typedef double real;
typedef real scalar, local;
#endif

/* What the functions of a component are evaluated at, and memory for their work. */
typedef struct {
    double t;                 /* [s] */
    const real *x, *u, *p;    /* states, inputs, parameters */
    const real *f;            /* what follows from the parameters alone */
    const real *s;            /* solutions of the quadratic programs */
    const real *dx, *du, *dp; /* direction of a derivative */
    real *w;
} FmuArguments;

typedef void (*FmuFunction)(const FmuArguments *at, real *result);
typedef void (*FmuFunctions)(const FmuArguments *at, real *result, real *second);

typedef enum { FMU_FLOAT64, FMU_INT32, FMU_BOOLEAN, FMU_STRING } FmuType; /* texts: of systems only */
typedef enum { FMU_TIME, FMU_PARAMETER, FMU_INPUT, FMU_STATE, FMU_DERIVATIVE, FMU_OUTPUT } FmuRole;
typedef enum { FMU_RK4, FMU_AM2, FMU_ROS2, FMU_SEMI_IMPLICIT } FmuSolver;
#define MAX_STEPS_PER_CALL 10000000.0 /* solver steps or samples in one doStep: beyond it the step size is a mistake */

/* One FMI variable; its value reference is its index in the table. */
typedef struct {
    const char *name;
    FmuType type;
    FmuRole role;
    int slot;        /* first element in the vector of the role */
    int size;        /* number of elements (1 unless the FMU was built with FMI 3 arrays) */
    int is_exact;    /* state with a start value that may be set before and during initialization */
    int is_tunable;  /* parameter that may be set after initialization */
    double min, max;
    double must_equal,
        tolerance; /* input that takes a constant of its source: which one, to within; both 0 for others */
} FmuVariable;

#define FMU_NO_LIMITS .min = -INFINITY, .max = INFINITY

/* States that are no FMI variables. */
typedef struct {
    const char *name;
    int slot, size;
} FmuHidden;

/* Quadratic programs that a discrete component solves at each sample, one after the other (qp.c). */
typedef struct {
    size_t (*scratch_size)(void);   /* bytes */
    void (*setup)(void *scratch);   /* once, on zeroed scratch */
    void (*solve)(void *scratch, double *memory, const double *data, double *solution);
    int (*memory_ok)(
        const double *memory); /* whether `memory` can be what `solve` left: that of a state from elsewhere */
} FmuQpFunctions;

extern const FmuQpFunctions fmu_qp_functions;

/* A point at which the build has found the solver stable: start values but for some inputs and states. */
typedef struct {
    int slot;     /* of the input, or n_inputs + slot of the state */
    double value;
} FmuSetting;

typedef struct {
    const char *name;
    const FmuSetting *settings;
    int n_settings;
} FmuPoint;

/* Memory of the first instance of a process, which has the addresses in the A2L file; its state follows. Further
 * instances are on the heap. */
typedef struct {
    unsigned char mark[16]; /* by which the build finds it in the binary */
    int32_t taken;
    int32_t prepared; /* what follows from the parameters alone agrees with them */
} FmuFirstInstance;

#define FMU_STATE_HEAD 7 /* numbers before the values of a state (saved_state.h) */

/* What is not given is 0 or NULL: a component without that. */
typedef struct {
    const char *name;
    const char *token;
    FmuFirstInstance *first;
    int is_continuous;
    FmuSolver solver;
    double sample_time;                    /* [s], discrete components */
    int has_clock; /* FMI 3.0: samples can be taken in event mode, when a clock ticks; its reference is n_variables */
    unsigned long long clock_counter, clock_resolution; /* sample_time as a fraction */
    const FmuVariable *variables;
    int n_variables;
    const FmuHidden *hidden;
    int n_hidden;
    int n_parameters, n_inputs, n_states, n_outputs;
    int n_work;                            /* numbers that the functions work in */
    int n_fixed;                           /* numbers that follow from the parameters alone */
    const double *start;                   /* start values of parameters, inputs, states in this order */
    FmuFunction prepare;                   /* p -> f, when parameters have changed */
    FmuFunction start_states;              /* x, u, p -> x; NULL where no start is calculated */
    FmuFunction derivatives;               /* continuous: t, x, u, p -> dx/dt */
    FmuFunction outputs;                   /* continuous: t, x, u, p -> y */
    FmuFunctions sample;                   /* discrete: t, x, u, p, s -> y, next x */
    FmuFunctions directional;              /* continuous: t, x, u, p, dx, du, dp -> d(dx/dt), dy */
    FmuFunction directional_start;         /* x, u, p, dx, du, dp -> dx; NULL where no start is calculated */
    FmuFunctions jacobian; /* t, x, u, p -> d(dx/dt)/dx column by column, d(dx/dt)/dt; may be NULL but for ros2 */
    const double *nominals,
        *bounds; /* of the states of continuous components: beyond their bounds they have blown up */
    const int *velocity_of; /* semi_implicit: for each state the index of its derivative among the states, or -1 */
    const FmuPoint *points;                /* continuous components */
    int n_points;
    FmuFunction program_data;              /* t, x, u, p -> data of the quadratic programs */
    FmuFunction checks;                    /* t, x, u, p -> values that must be > 0 after initialization */
    const char *const *check_messages;
    int n_checks;
    const FmuQpFunctions *qp;
    int n_qp_data, n_qp_solution, n_qp_memory;
} FmuModel;

extern const FmuModel fmu_model;

/* Continuous components declare solver.step [s] as their first parameter. */
#define FMU_SOLVER_STEP_SLOT 0

#endif
