/* The programs of one component, in the generated qp_data.c. */
#ifndef QP_MODEL_H
#define QP_MODEL_H

#include "qp.h"

extern const int qp_count;
extern const Qp qp_list[];

#endif
