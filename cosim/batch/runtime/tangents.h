/* A number with its derivatives in TANGENTS directions: the type, its operators, and what numbers.h is written with. */
#ifndef TANGENTS_H
#define TANGENTS_H

#include "expressions.h"

enum { PART = 8, PARTS = TANGENTS / PART };
typedef double Part __attribute__((vector_size(8 * PART)));

#define EACH_PART(expression) \
    _Pragma("GCC unroll 8") for (int i = 0; i < PARTS; i++) expression

struct Tangent;

/* Operands of a statement; one that does not move is overwritten by the next. */
struct Operands {
    double *slopes;
    const Tangent **of;
    int n;
};

struct Tangent : Expression<Tangent> {
    enum { OPERANDS = 1 };
    double v;
    uint64_t moves; /* 0: all derivatives are 0; then as many unused numbers as alignment takes */
    Part d[PARTS];
    Tangent() = default;
    Tangent(double x) : v(x), moves(0) { EACH_PART(d[i] = Part{}); }
    template <class E> MEMBER Tangent(const Expression<E> &e) { *this = e; }
    template <class E> MEMBER Tangent &operator=(const Expression<E> &e) {
        double slopes[E::OPERANDS];
        const Tangent *of[E::OPERANDS];
        Operands to = {slopes, of, 0};
        e.self().note(to, 1.0);
        v = e.self().v;
        add_up(to);
        return *this;
    }
    MEMBER void note(Operands &to, double slope) const {
        to.slopes[to.n] = slope;
        to.of[to.n] = this;
        to.n += moves != 0;
    }
    inline void add_up(const Operands &these);
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

/* Derivatives of a statement, which may be one of its operands. */
__attribute__((noinline)) void Tangent::add_up(const Operands &these) {
    moves = these.n != 0;
    Part sum[PARTS];
    if (these.n) EACH_PART(sum[i] = scaled(these.slopes[0], these.of[0]->d[i]));
    else EACH_PART(sum[i] = Part{});
    for (int k = 1; k < these.n; k++) EACH_PART(sum[i] += scaled(these.slopes[k], these.of[k]->d[i]));
    EACH_PART(d[i] = sum[i]);
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
