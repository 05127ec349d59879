/* A number with its derivatives in TANGENTS directions: the type, and what numbers.h is written with. */
#ifndef TANGENTS_H
#define TANGENTS_H

struct Tangent;
typedef Tangent Number;
#include "expressions.h"

/* A part fills a vector register: of longer vectors GCC makes code that is several times slower. */
enum { PARTS = TANGENTS / PART };
typedef double Part __attribute__((vector_size(8 * PART)));

#define EACH_OF(n, k, statement) \
    _Pragma("GCC unroll 64") for (int k = 0; k < n; k++) { statement; }

struct Tangent {
    typedef Names<-1> Read;
    double v;
    uint64_t moves; /* 0: all derivatives are 0, and d has no values; d begins at a multiple of its alignment */
    Part d[PARTS];
    Tangent() = default;
    Tangent(double x) : v(x), moves(0) {}
    Tangent(const Tangent &x) { *this = x; }
    Tangent &operator=(const Tangent &x);
    template <class E, IS_EXPRESSION(E)> MEMBER Tangent(const E &e) { *this = e; }
    template <class E, IS_EXPRESSION(E)> MEMBER Tangent &operator=(const E &e);
    template <int AT, class To> MEMBER void note(To &to, double slope) const { to.template note<AT>(slope, *this); }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
#define OPERATION NOINLINE

/* The derivatives of a number, which are 0 if it does not move. */
static const Part still[PARTS] = {};
INLINE const Part *parts_of(const Tangent &x) { return x.moves ? x.d : still; }
INLINE double slope_of(const Tangent &x, int k) { return ((const double *)parts_of(x))[k]; }

NOINLINE void copy_parts(Tangent *r, const Tangent *x) { EACH_OF(PARTS, i, r->d[i] = x->d[i]) }
inline Tangent &Tangent::operator=(const Tangent &x) { /* GCC calls it from code without vectors */
    v = x.v;
    moves = x.moves;
    if (moves) copy_parts(this, &x);
    return *this;
}

INLINE bool is_finite(double slope) { return __builtin_expect(slope - slope == 0.0, 1); }
/* A product with the slope. Where x does not move, its part is 0, also where the slope is infinite. */
INLINE Part scaled(double slope, const Part &d) {
    if (is_finite(slope)) return slope * d;
    Part r;
    for (int i = 0; i < PART; i++) r[i] = d[i] == 0.0 ? 0.0 : slope * d[i];
    return r;
}
/* With one more product; the slope is finite. */
INLINE Part added(const Part &sum, double slope, const Part &d) {
#if LANES_TARGET == 512
    return (Part)_mm512_fmadd_pd(_mm512_set1_pd(slope), (__m512d)d, (__m512d)sum);
#elif LANES_TARGET == 2
    return (Part)_mm256_fmadd_pd(_mm256_set1_pd(slope), (__m256d)d, (__m256d)sum);
#else
    return sum + slope * d;
#endif
}

/* N parts of the derivatives of r, from the same of M operands; their sums are in registers. */
template <int N, int M> INLINE void add_up_parts(Part *r, const double *slopes, const Tangent *const *of, int from) {
    Part sum[N];
    const Part *const first = parts_of(*of[0]) + from;
    if (is_finite(slopes[0])) EACH_OF(N, i, sum[i] = slopes[0] * first[i])
    else EACH_OF(N, i, sum[i] = scaled(slopes[0], first[i]))
    EACH_OF(M - 1, j, {
        const int k = j + 1;
        const double slope = slopes[k];
        const Part *const d = of[k]->d + from;
        if (!of[k]->moves) continue;
        if (is_finite(slope)) EACH_OF(N, i, sum[i] = added(sum[i], slope, d[i]))
        else EACH_OF(N, i, sum[i] += scaled(slope, d[i]))
    })
    EACH_OF(N, i, r[from + i] = sum[i])
}
/* The derivatives of r, which may be one of its M operands. AVX2 has 16 registers: for 13 sums and a slope. */
enum { BLOCK = PARTS <= 13 ? PARTS : (PARTS + 1) / 2, REST = PARTS - BLOCK };
template <int M> INLINE void add_up(Tangent *r, const double *slopes, const Tangent *const *of) {
    uint64_t moves = 0;
    for (int k = 0; k < M; k++) moves |= of[k]->moves;
    add_up_parts<BLOCK, M>(r->d, slopes, of, 0);
    if (REST) add_up_parts<REST ? REST : 1, M>(r->d, slopes, of, BLOCK);
    r->moves = moves;
}
enum { FEW = 4 }; /* operands that a call has in registers */
template <int M>
NOINLINE void add_up_few(Tangent *r, double by_a, const Tangent *a, double by_b, const Tangent *b, double by_c,
    const Tangent *c, double by_d, const Tangent *d) {
    const double slopes[] = {by_a, by_b, by_c, by_d};
    const Tangent *const of[] = {a, b, c, d};
    add_up<M>(r, slopes, of);
}
template <int M> NOINLINE void add_up_many(Tangent *r, const double *slopes, const Tangent *const *of) {
    add_up<M>(r, slopes, of);
}
template <class E, class> MEMBER Tangent &Tangent::operator=(const E &e) {
    if constexpr (__is_base_of(Tangent, E)) return *this = static_cast<const Tangent &>(e);
    Operands<typename E::Read> all;
    e.template note<0>(all, 1.0);
    v = e.v;
    enum { N = all.n, SECOND = N > 1, THIRD = N > 2 ? 2 : 0, FOURTH = N > 3 ? 3 : 0 };
    const double *const s = all.slopes;
    const Tangent *const *const x = all.of;
    if (N > FEW) add_up_many<N>(this, s, x);
    else
        add_up_few<N < FEW ? N : FEW>(
            this, s[0], x[0], s[SECOND], x[SECOND], s[THIRD], x[THIRD], s[FOURTH], x[FOURTH]);
    return *this;
}
NOINLINE Tangent chain(double value, int n, const double *slopes, const Tangent *const *of) {
    Tangent r(value);
    EACH_OF(PARTS, i, r.d[i] = Part{})
    for (int k = 0; k < n; k++) {
        if (!of[k]->moves) continue;
        r.moves = 1;
        EACH_OF(PARTS, i, r.d[i] += scaled(slopes[k], of[k]->d[i]))
    }
    return r;
}

typedef decltype(Part() != Part()) PartMask;
INLINE int any_of(const PartMask &of) {
    typedef decltype(of[0] + 0) Word;
    typedef Word Half __attribute__((vector_size(4 * PART)));
    Half half[2];
    memcpy(half, &of, sizeof of);
    half[0] |= half[1];
    Word any = 0;
    for (int i = 0; i < PART / 2; i++) any |= half[0][i];
    return any != 0;
}
INLINE int depends(const Tangent &x) {
    for (int i = 0; x.moves && i < PARTS; i++)
        if (any_of(x.d[i] != 0.0)) return 1;
    return 0;
}
INLINE int depends(const Tangent &x, const Tangent &y) {
    const Part *const a = parts_of(x), *const b = parts_of(y);
    for (int i = 0; a != b && i < PARTS; i++)
        if (any_of(a[i] != b[i])) return 1;
    return 0;
}
/* Whether they are equal after a move along a direction by this much at most, and move apart beyond rounding. Nearly
 * always sums of squares say at once that no direction is long enough. */
INLINE int meet(const Tangent &x, const Tangent &y, double within) {
    const Part *const a = parts_of(x), *const b = parts_of(y);
    const double gap = fabs(x.v - y.v);
    Part sums[2] = {};
    EACH_OF(PARTS, i, sums[i % 2] += (a[i] - b[i]) * (a[i] - b[i]))
    if (!any_of((2.0 * within * within * (sums[0] + sums[1]) < gap * gap) == 0)) return 0; /* a NaN is not less */
    for (int k = 0; k < TANGENTS; k++) {
        const double one = slope_of(x, k), other = slope_of(y, k), apart = fabs(one - other);
        if (within * apart >= gap && apart > 1e-12 * (1.0 + fabs(one) + fabs(other))) return 1;
    }
    return 0;
}
/* Where derivatives were written from elsewhere. */
INLINE void note_moves(Tangent *x, size_t n) {
    for (size_t i = 0; i < n; i++) {
        x[i].moves = 1;
        x[i].moves = (uint64_t)depends(x[i]);
    }
}
INLINE Tangent moved(double value, const Tangent &x) {
    Tangent r = x;
    r.v = value;
    return r;
}

/* Whether a number is not the same, beyond rounding and at all. A derivative may be of any size. */
INLINE int lanes_moved(const Tangent &was, const Tangent &now) {
    int r = fabs(now.v - was.v) > 1e-12 * fmax(fabs(was.v), 1.0);
    for (int k = 0; k < TANGENTS; k++)
        r |= fabs(slope_of(now, k) - slope_of(was, k)) > 1e-12 * fabs(slope_of(was, k));
    return r;
}
INLINE int lanes_changed(const Tangent &was, const Tangent &now) {
    return memcmp(&was.v, &now.v, sizeof was.v) != 0 || memcmp(parts_of(was), parts_of(now), sizeof was.d) != 0;
}

#endif
