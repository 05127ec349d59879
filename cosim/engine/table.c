#include "table.h"

enum { OK = 0, ERROR = 3 }; /* statuses of FMI */

/* Outputs as of time t, in the operations of cosim/tables/table.py. */
uint32_t table_step(void *table, double t, double h, int no_set_prior) {
    Table *const s = table;
    (void)h;
    (void)no_set_prior;
    if (!(t <= s->end)) return ERROR;
    size_t row = s->row;
    while (row + 1 < s->rows && s->valid_from[row + 1] <= t) row++;
    while (row > 0 && s->valid_from[row] > t) row--;
    s->row = row;
    const double *const a = s->values + row * s->width;
    size_t i = 0;
    s->weight = 0.0;
    if (row + 1 < s->rows) {
        const double *const b = a + s->width;
        double w = (t - s->times[row]) / (s->times[row + 1] - s->times[row]);
        if (w < 0.0) w = 0.0;
        s->weight = w;
        for (; i < s->n_linear; i++) {
            const uint32_t c = s->columns[i];
            s->y[s->places[i]] = a[c] + w * (b[c] - a[c]);
        }
    }
    for (; i < s->n; i++) s->y[s->places[i]] = a[s->columns[i]];
    *s->now = t;
    return OK;
}
