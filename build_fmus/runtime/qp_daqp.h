/* Constants of a program for the back end DAQP. */
#ifndef QP_DAQP_H
#define QP_DAQP_H

typedef struct {
    const double *rinv;    /* inverse of the upper Cholesky factor R of H = R'R, upper triangle packed row by row */
    const double *rows;    /* A inv(R) with rows of length 1, m x n */
    const double *scaling; /* what the rows were multiplied with; 1 for rows of zeros */
    int ill_conditioned;   /* the condition number of H exceeds 1e6 */
} QpDaqpFactors;

typedef struct {
    double tolerance; /* by which a row may be violated */
    int max_iterations;
} QpDaqpSettings;

#endif
