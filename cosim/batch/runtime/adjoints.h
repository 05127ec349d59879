/* A number of which it is known how it follows from others: the type, and what numbers.h is written with.
 *
 * A statement of generated code, with all its operators, is one entry of a tape (batch.h): the indices of the numbers
 * that it reads, and the derivatives of the result by them. The index of the result is that of the entry. Index 0 is a
 * number that depends on nothing; of statements that read only such numbers nothing is kept. */
#ifndef ADJOINTS_H
#define ADJOINTS_H

struct Adjoint;
typedef Adjoint Number;
#include "expressions.h"

static __thread Tape *tape; /* of the run at hand, for all components */
extern "C" EXPORT void cosim_use_tape(Tape *of) { tape = of; }

struct alignas(16) Adjoint { /* whole rows, whatever lies between numbers */
    typedef Names<-1> Read;
    double v;
    uint64_t index;
    Adjoint() = default;
    MEMBER Adjoint(double x) : v(x), index(0) {}
    MEMBER Adjoint(double x, uint64_t of) : v(x), index(of) {}
    template <class E, IS_EXPRESSION(E)> MEMBER Adjoint(const E &e) { *this = e; }
    template <class E, IS_EXPRESSION(E)> MEMBER Adjoint &operator=(const E &e) {
        Operands<typename E::Read> all;
        static_assert(all.n <= (int)TAPE_SPARE, "a statement has more operands than the tape has space for");
        e.template note<0>(all, 1.0);
        v = e.v;
        /* Such as a limit: the number itself where it moves as that does, also for comparisons with it. */
        if (all.n == 1 && all.slopes[0] == 1.0) index = all.of[0]->index;
        else enter(all.n, all.slopes, all.of);
        return *this;
    }
    MEMBER void enter(int n, const double *slopes, const Adjoint *const *of) {
        /* Without branches: the compiler then keeps both counts in registers from one statement to the next. */
        Tape *const t = tape;
        const TapeCount begin = t->n_operands < t->most ? t->n_operands : t->most;
        TapeCount at = begin;
        _Pragma("GCC unroll 64") for (int k = 0; k < n; k++) {
            t->slopes[at] = slopes[k];
            t->operands[at] = (uint32_t)of[k]->index;
            at += of[k]->index != 0;
        }
        t->n_operands = at;
        t->n += at != begin;
        t->ends[t->n & t->mask] = (uint32_t)at;
        index = at != begin ? t->n : 0;
    }
    template <int AT, class To> MEMBER void note(To &to, double slope) const { to.template note<AT>(slope, *this); }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
#define OPERATION INLINE

NOINLINE Adjoint chain(double value, int n, const double *slopes, const Adjoint *const *of) {
    Adjoint r(value);
    r.enter(n, slopes, of);
    return r;
}
INLINE Adjoint moved(double value, const Adjoint &x) { return Adjoint(value, x.index); }
INLINE int depends(const Adjoint &x) { return x.index != 0; }
INLINE int depends(const Adjoint &x, const Adjoint &y) { return x.index != y.index; }
INLINE int meet(const Adjoint &, const Adjoint &, double) { return 0; } /* not known before the way back */
INLINE void note_moves(Adjoint *, size_t) {}

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
