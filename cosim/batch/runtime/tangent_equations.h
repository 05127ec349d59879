/* Generated equations over numbers with tangents: what equations.h and fmu_math.h call by these names. Included before
 * model.c. */
#include "tangents.h"

#undef FMU_MATH
#define FMU_MATH(name) tangent_##name
#undef sqrt
#define sqrt(x) tangent_sqrt(x)
#undef fabs
#define fabs(x) tangent_fabs(x)
#undef copysign
#define copysign(x, y) tangent_copysign(x, y)

#define all(x) lanes_all(x)
#define any(c) (c)
#define number(c) ((double)(c))
#define square(x) tangent_square(x)
#define sign(x) tangent_sign(x)
#define when(c, a) tangent_when(c, a)
#define if_else(c, a, b) tangent_if_else(c, a, b)
#define look_up(array, n, index) tangent_look_up(array, n, index)
#define store(array, n, index, value) tangent_store(array, n, index, value)
#define smallest(array, n) tangent_smallest(array, n)
#define largest(array, n) tangent_largest(array, n)
#define product(z, x, y, rows, inner, columns) tangent_product(z, x, y, rows, inner, columns)
#define add_product(z, x, y, rows, inner, columns) tangent_add_product(z, x, y, rows, inner, columns)
