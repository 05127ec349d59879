/* A number with its derivatives in TANGENTS directions: the type, and what numbers.h is written with. */
#ifndef TANGENTS_H
#define TANGENTS_H

#include "expressions.h"

/* A part fills a vector register: of longer vectors GCC makes code that is several times slower. */
enum { PARTS = TANGENTS / PART };
typedef double Part __attribute__((vector_size(8 * PART)));

#define EACH_PART(expression) \
    _Pragma("GCC unroll 32") for (int i = 0; i < PARTS; i++) expression

struct Tangent;
enum { TOGETHER = 4 }; /* operands that one call adds up: they are in registers */
template <int N> struct Operands {
    double slopes[N + TOGETHER]; /* the last are not read */
    const Tangent *of[N + TOGETHER];
};

struct Tangent : Expression<Tangent> {
    enum { OPERANDS = 1 };
    double v;
    uint64_t moves; /* 0: all derivatives are 0; then as many unused numbers as alignment takes */
    Part d[PARTS];
    Tangent() = default;
    Tangent(double x) : v(x), moves(0) { EACH_PART(d[i] = Part{}); }
    template <class E> MEMBER Tangent(const Expression<E> &e) { *this = e; }
    template <class E> MEMBER Tangent &operator=(const Expression<E> &e);
    template <int AT, class To> MEMBER void note(To &to, double slope) const {
        to.slopes[AT] = slope;
        to.of[AT] = this;
    }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
typedef Tangent Number;
#define OPERATION NOINLINE

/* A product with the slope. Where x does not move, its part is 0, also where the slope is infinite. */
INLINE Part scaled(double slope, const Part &d) {
    if (__builtin_expect(slope - slope == 0.0, 1)) return slope * d;
    Part r;
    for (int i = 0; i < PART; i++) r[i] = d[i] == 0.0 ? 0.0 : slope * d[i];
    return r;
}
INLINE Part added(const Part &sum, double slope, const Part &d) {
#if LANES_TARGET == 512
    if (__builtin_expect(slope - slope == 0.0, 1))
        return (Part)_mm512_fmadd_pd(_mm512_set1_pd(slope), (__m512d)d, (__m512d)sum);
#endif
    return sum + scaled(slope, d);
}

/* The derivatives of r, which may be one of its operands: the first N of these. */
template <int N>
NOINLINE void add_up(Tangent *r, double by_a, const Tangent *a, double by_b, const Tangent *b, double by_c,
    const Tangent *c, double by_d, const Tangent *d) {
    Part sum[PARTS];
    EACH_PART(sum[i] = Part{});
    if (a->moves) EACH_PART(sum[i] = scaled(by_a, a->d[i]));
    if (N > 1 && b->moves) EACH_PART(sum[i] = added(sum[i], by_b, b->d[i]));
    if (N > 2 && c->moves) EACH_PART(sum[i] = added(sum[i], by_c, c->d[i]));
    if (N > 3 && d->moves) EACH_PART(sum[i] = added(sum[i], by_d, d->d[i]));
    r->moves = a->moves | (N > 1 ? b->moves : 0) | (N > 2 ? c->moves : 0) | (N > 3 ? d->moves : 0);
    EACH_PART(r->d[i] = sum[i]);
}
template <class E> MEMBER Tangent &Tangent::operator=(const Expression<E> &e) {
    enum { N = E::OPERANDS, LAST = N > TOGETHER ? (N - TOGETHER - 1) / (TOGETHER - 1) * (TOGETHER - 1) + TOGETHER : 0 };
    Operands<N> all;
    e.self().template note<0>(all, 1.0);
    v = e.self().v;
    const double *const s = all.slopes;
    const Tangent *const *const x = all.of;
    if (N <= TOGETHER) {
        enum { SECOND = N > 1, THIRD = N > 2 ? 2 : 0, FOURTH = N > 3 ? 3 : 0 };
        add_up<(N < TOGETHER ? N : TOGETHER)>(
            this, s[0], x[0], s[SECOND], x[SECOND], s[THIRD], x[THIRD], s[FOURTH], x[FOURTH]);
        return *this;
    }
    Tangent sum;
    add_up<TOGETHER>(&sum, s[0], x[0], s[1], x[1], s[2], x[2], s[3], x[3]);
    _Pragma("GCC unroll 64") for (int k = TOGETHER; k < LAST; k += TOGETHER - 1)
        add_up<TOGETHER>(&sum, 1.0, &sum, s[k], x[k], s[k + 1], x[k + 1], s[k + 2], x[k + 2]);
    add_up<N - LAST + 1>(
        this, 1.0, &sum, s[LAST], x[LAST], s[LAST + 1], x[LAST + 1], s[LAST + 2], x[LAST + 2]);
    return *this;
}
NOINLINE Tangent chain(double value, int n, const double *slopes, const Tangent *const *of) {
    Tangent r(value);
    for (int k = 0; k < n; k++) {
        r.moves |= of[k]->moves;
        EACH_PART(r.d[i] += scaled(slopes[k], of[k]->d[i]));
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
    for (int i = 0; (x.moves || y.moves) && i < PARTS; i++)
        if (any_of(x.d[i] != y.d[i])) return 1;
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
    const double *const a = (const double *)was.d, *const b = (const double *)now.d;
    int r = fabs(now.v - was.v) > 1e-12 * fmax(fabs(was.v), 1.0);
    for (int i = 0; i < TANGENTS; i++) r |= fabs(b[i] - a[i]) > 1e-12 * fabs(a[i]);
    return r;
}
INLINE int lanes_changed(const Tangent &was, const Tangent &now) { return memcmp(&was, &now, sizeof was) != 0; }

#endif
