/* Generated equations over lanes: what equations.h and fmu_math.h call by these names, for all copies at once. Included
 * before model.c. */
#include "lanes.h"

#define SPREAD(x) ((x) - (lanes){0}) /* a number for all lanes; lanes as they are: x - 0 is x, also where x is -0 */

#undef FMU_MATH
#define FMU_MATH(name) lanes_##name
#undef sqrt
#define sqrt(x) lanes_sqrt(x)
#undef fabs
#define fabs(x) lanes_fabs(x)
#undef copysign
#define copysign(x, y) lanes_copysign(SPREAD(x), SPREAD(y))
#undef fmax
#define fmax(x, y) _Generic((x), double: lanes_fmax_of_one, default: lanes_fmax)(x, SPREAD(y))
#undef fmin
#define fmin(x, y) _Generic((x), double: lanes_fmin_of_one, default: lanes_fmin)(x, SPREAD(y))
#undef pow
#define pow(x, y) lanes_pow(SPREAD(x), SPREAD(y))
#undef atan2
#define atan2(y, x) lanes_atan2(SPREAD(y), SPREAD(x))
#undef fmod
#define fmod(x, y) lanes_fmod(SPREAD(x), SPREAD(y))
#undef hypot
#define hypot(x, y) lanes_hypot(SPREAD(x), SPREAD(y))
#undef remainder
#define remainder(x, y) lanes_remainder(SPREAD(x), SPREAD(y))

#define all(x) lanes_all(x)
#define any(c) lanes_any(c)
#define number(c) lanes_number(c)
#define square(x) lanes_square(x)
#define sign(x) lanes_sign(x)
#define when(c, a) lanes_when(c, SPREAD(a))
#define if_else(c, a, b) lanes_if_else(c, SPREAD(a), SPREAD(b))
#define look_up(array, n, index) \
    _Generic((array), const double *: lanes_look_up_table, default: lanes_look_up_lanes)(array, n, SPREAD(index))
#define store(array, n, index, value) lanes_store(array, n, SPREAD(index), SPREAD(value))
#define smallest(array, n) lanes_smallest(array, n)
#define largest(array, n) lanes_largest(array, n)
#define OF_ARRAYS(name, x, y)                                                                          \
    _Generic((x), const double *: lanes_##name##_table_lanes,                                          \
        default: _Generic((y), const double *: lanes_##name##_lanes_table, default: lanes_##name##_lanes_lanes))
#define product(z, x, y, rows, inner, columns) OF_ARRAYS(product, x, y)(z, x, y, rows, inner, columns)
#define add_product(z, x, y, rows, inner, columns) OF_ARRAYS(add_product, x, y)(z, x, y, rows, inner, columns)
