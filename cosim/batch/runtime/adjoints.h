/* A number of which it is known how it follows from others: the type, and what numbers.h is written with.
 *
 * A statement of generated code, with all its operators, is one entry of a tape (batch.h): the indices of the numbers
 * that it reads, and the derivatives of the result by them. The index of the result is that of the entry. Index 0 is a
 * number that depends on nothing; of statements that read only such numbers nothing is kept. */
#ifndef ADJOINTS_H
#define ADJOINTS_H

#include "expressions.h"

static __thread Tape *tape; /* of the run at hand, for all components */
extern "C" EXPORT void cosim_use_tape(Tape *of) { tape = of; }

/* Where the operands of a statement go. One that depends on nothing is overwritten by the next. */
struct Operands {
    double *slopes;
    uint32_t *indices;
    TapeCount at;
    MEMBER void note(double slope, uint64_t index) {
        slopes[at] = slope;
        indices[at] = (uint32_t)index;
        at += index != 0;
    }
};

struct alignas(16) Adjoint : Expression<Adjoint> { /* whole rows, whatever lies between numbers */
    enum { OPERANDS = 1 };
    double v;
    uint64_t index;
    Adjoint() = default;
    MEMBER Adjoint(double x) : v(x), index(0) {}
    MEMBER Adjoint(double x, uint64_t of) : v(x), index(of) {}
    template <class E> MEMBER Adjoint(const Expression<E> &e) : v(e.self().v) { enter(e); }
    /* Such as a limit: the number itself where it moves as that does, also for comparisons with it. */
    MEMBER Adjoint(const OfOne<Adjoint> &e) : v(e.v), index(e.x.index) {
        if (e.slope != 1.0) enter(e);
    }
    template <class E> MEMBER void enter(const Expression<E> &e) {
        static_assert(E::OPERANDS <= TAPE_SPARE, "a statement has more operands than the tape has space for");
        /* Without branches: the compiler then keeps both counts in registers from one statement to the next. */
        Tape *const t = tape;
        const TapeCount begin = t->n_operands < t->most ? t->n_operands : t->most;
        Operands to = {t->slopes, t->operands, begin};
        e.self().template note<0>(to, 1.0);
        t->n_operands = to.at;
        t->n += to.at != begin;
        t->ends[t->n & t->mask] = (uint32_t)to.at;
        index = to.at != begin ? t->n : 0;
    }
    template <int> MEMBER void note(Operands &to, double slope) const { to.note(slope, index); }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
typedef Adjoint Number;
#define OPERATION INLINE

struct OfMany : Expression<OfMany> {
    enum { OPERANDS = TAPE_SPARE }; /* at most */
    double v;
    int n;
    const double *slopes;
    const Adjoint *const *of;
    template <int> MEMBER void note(Operands &to, double) const {
        for (int k = 0; k < n; k++) of[k]->note<0>(to, slopes[k]);
    }
};
NOINLINE Adjoint chain(double value, int n, const double *slopes, const Adjoint *const *of) {
    OfMany all;
    all.v = value, all.n = n, all.slopes = slopes, all.of = of;
    return all;
}
INLINE Adjoint moved(double value, const Adjoint &x) { return Adjoint(value, x.index); }
INLINE int depends(const Adjoint &x) { return x.index != 0; }
INLINE int depends(const Adjoint &x, const Adjoint &y) { return x.index != y.index; }
INLINE void note_moves(Adjoint *, size_t) {}

INLINE Adjoint operator+(const Adjoint &x, double y) { return moved(x.v + y, x); }
INLINE Adjoint operator+(double x, const Adjoint &y) { return moved(x + y.v, y); }
INLINE Adjoint operator-(const Adjoint &x, double y) { return moved(x.v - y, x); }

/* What a number depends on is another entry in each round: batch.c takes more rounds instead. */
INLINE int lanes_moved(const Adjoint &was, const Adjoint &now) {
    return fabs(now.v - was.v) > 1e-12 * fmax(fabs(was.v), 1.0);
}
INLINE int lanes_changed(const Adjoint &was, const Adjoint &now) { return memcmp(&was.v, &now.v, sizeof was.v) != 0; }

/* From the derivatives of N results by each number of the tape, side by side in `of`, those by the numbers up to
 * `first`; the others become 0. */
template <int N> static void sweep_back(const Tape *t, double *of, TapeCount first) {
    uint32_t end = t->ends[t->n];
    for (TapeCount i = t->n; i > first; i--) {
        const uint32_t begin = t->ends[i - 1];
        double *const from = of + i * N, by[N];
        int any = 0, finite = 1;
        for (int k = 0; k < N; k++) {
            by[k] = from[k];
            any |= by[k] != 0.0;
            finite &= by[k] - by[k] == 0.0;
            from[k] = 0.0;
        }
        if (any && __builtin_expect(finite, 1))
            for (uint32_t j = begin; j < end; j++) {
                double *const to = of + (size_t)t->operands[j] * N;
                for (int k = 0; k < N; k++) to[k] += by[k] * t->slopes[j];
            }
        else if (any)
            for (uint32_t j = begin; j < end; j++)
                for (int k = 0; k < N && t->slopes[j] != 0.0; k++) /* what does not move counts for nothing */
                    of[(size_t)t->operands[j] * N + k] += by[k] * t->slopes[j];
        end = begin;
    }
}
extern "C" EXPORT void cosim_sweep_back(const Tape *t, double *of, TapeCount first, int32_t n) {
    if (n == 1) sweep_back<1>(t, of, first);
    else if (n == 2) sweep_back<2>(t, of, first);
    else if (n <= 4) sweep_back<4>(t, of, first);
    else sweep_back<8>(t, of, first);
}

#endif
