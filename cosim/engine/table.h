/* Signals from a table as a component: the step of one is a function of C, so that the engine need not call Python
 * back. Lines that do not begin with # are also read by cffi. */
#ifndef ENGINE_TABLE_H
#define ENGINE_TABLE_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    const double *times;      /* of the rows, increasing [s] */
    const double *valid_from; /* from when on each row counts, a little before its time: a time in a file is rounded */
    const double *values;     /* row by row, `width` of each */
    size_t rows, width;
    double end;               /* up to here the table tells anything */
    double *y;                /* the outputs */
    const uint32_t *columns, *places; /* of n outputs, the linear ones first: their columns, and where they are in y */
    size_t n, n_linear;
    size_t row;               /* that was found last */
    double weight;            /* of the row after it, for columns that are linear */
    double *now;              /* of which time the outputs are */
} Table;

uint32_t table_step(void *table, double t, double h, int no_set_prior);

#endif
