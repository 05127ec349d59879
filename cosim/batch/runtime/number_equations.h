/* Generated equations over numbers with derivatives: what equations.h and fmu_math.h call by these names. Included
 * before model.c. */
#include "numbers.h"

#undef FMU_MATH
#define FMU_MATH(name) number_##name
#undef sqrt
#define sqrt(x) number_sqrt(x)
#undef fabs
#define fabs(x) number_fabs(x)
#undef copysign
#define copysign(x, y) number_copysign(x, y)

#define all(x) lanes_all(x)
#define any(c) (c)
#define number(c) ((double)(c))
#define square(x) number_square(x)
#define sign(x) number_sign(x)
#define when(c, a) number_when(c, a)
#define if_else(c, a, b) number_if_else(c, a, b)
#define look_up(array, n, index) number_look_up(array, n, index)
#define store(array, n, index, value) number_store(array, n, index, value)
#define smallest(array, n) number_smallest(array, n)
#define largest(array, n) number_largest(array, n)
#define product(z, x, y, rows, inner, columns) number_product(z, x, y, rows, inner, columns)
#define add_product(z, x, y, rows, inner, columns) number_add_product(z, x, y, rows, inner, columns)
#define solve_linear(x, lu, a, b, n, columns) number_solve_linear(x, lu, a, b, n, columns)

#define scalar Scalar<__COUNTER__>
#define local Local
