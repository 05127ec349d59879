/* Constants of a program for the back end OSQP: the program in w and v, where z = T w and row i of A is multiplied by
 * e[i]. */
#ifndef QP_OSQP_H
#define QP_OSQP_H

typedef struct {
    const double *transform, *inverse;  /* T and inv(T), n x n */
    const double *row_scale;            /* e */
    const int *p_columns, *p_rows;      /* T'HT, upper triangle by columns */
    const double *p_values;
    const int *a_columns, *a_rows;      /* e A T by columns */
    const double *a_values;
    const double *lower,
        *inverse_diagonal; /* L D L' = T'HT + sigma I + rho (eAT)'(eAT); L packed below its ones, row by row */
} QpOsqpFactors;

typedef struct {
    double rho, sigma, alpha;
    double tolerance, infeasibility_tolerance;
    int max_iterations, check_interval;
} QpOsqpSettings;

#endif
