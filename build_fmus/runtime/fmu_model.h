/* What the generated code of one component tells the runtime. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H

#include <stddef.h>

typedef int (*FmuFunction)(const double **arg, double **res, int *iw, double *w, int mem);

typedef enum { FMU_FLOAT64, FMU_INT32, FMU_BOOLEAN } FmuType;
typedef enum { FMU_TIME, FMU_PARAMETER, FMU_INPUT, FMU_STATE, FMU_DERIVATIVE, FMU_OUTPUT } FmuRole;
typedef enum { FMU_RK4, FMU_AM2, FMU_ROS2, FMU_SEMI_IMPLICIT } FmuSolver;

/* One FMI variable; its value reference is its index in the table. */
typedef struct {
    const char *name;
    FmuType type;
    FmuRole role;
    int slot;        /* first element in the vector of the role */
    int size;        /* number of elements (1 unless the FMU was built with FMI 3 arrays) */
    int is_exact;    /* has a start value that may be set before and during initialization */
    int is_tunable;  /* parameter that may be set after initialization */
    double min, max; /* -INFINITY, INFINITY where not declared */
    double must_equal, tolerance; /* input that takes a constant of its source: which one, to within; INFINITY for others */
} FmuVariable;

/* Quadratic programs that a discrete component solves at each sample, one after the other (qp.c). */
typedef struct {
    size_t (*scratch_size)(void);   /* bytes */
    void (*setup)(void *scratch);   /* once, on zeroed scratch */
    void (*solve)(void *scratch, double *memory, const double *data, double *solution);
    int (*memory_ok)(const double *memory); /* whether `memory` can be what `solve` left: that of a state from elsewhere */
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

typedef struct {
    const char *name;
    const char *token;
    int is_continuous;
    FmuSolver solver;
    double sample_time;                    /* [s], discrete components */
    int n_variables;
    const FmuVariable *variables;
    int n_parameters, n_inputs, n_states, n_outputs;
    const double *start;                   /* parameters, inputs, states in this order */
    const double *nominals;                /* of the states */
    const char *const *state_names;
    int n_calculated;                      /* states with a calculated start */
    FmuFunction start_fn;                  /* (x, u, p) -> x0 */
    FmuFunction out_fn;                    /* (t, x, u, p) -> y */
    FmuFunction next_fn;                   /* continuous: (t, x, u, p) -> dx; discrete: (t, x, u, p) -> x_next, y */
    FmuFunction fwd_fn;                    /* (t, x, u, p, dx, du, dp) -> d(dx/dt), dy; NULL for discrete */
    FmuFunction fwd_start_fn;              /* (x, u, p, dx, du, dp) -> dx0; NULL for discrete */
    FmuFunction jac_fn;                    /* (t, x, u, p) -> d(dx/dt)/dx dense column-major, d(dx/dt)/dt; may be NULL but for ros2 */
    const FmuQpFunctions *qp;              /* NULL without quadratic programs */
    FmuFunction qp_fn;                     /* (t, x, u, p) -> their data; out_fn and next_fn then take their solutions as s too:
                                            * (t, x, u, p, s) */
    int n_qp_data, n_qp_solution, n_qp_memory;
    int sz_arg, sz_res, sz_iw, sz_w;       /* largest work sizes of the functions above and below */
    const int *velocity_of;                /* semi_implicit: for each state the index of its derivative among the states, or -1 */
    FmuFunction check_fn;                  /* (t, x, u, p) -> values that must be > 0 after initialization; NULL without checks */
    int n_checks;
    const char *const *check_messages;
    const double *bounds;                  /* of the states: beyond them they have blown up */
    const FmuPoint *points;                /* continuous components */
    int n_points;
} FmuModel;

extern const FmuModel fmu_model;

/* Continuous components declare solver.step [s] as their first parameter. */
#define FMU_SOLVER_STEP_SLOT 0

#endif
