/* A number of which it is known how it follows from others: the type, its operators, and what numbers.h is written
 * with.
 *
 * A statement of generated code, with all its operators, is one entry of a tape (batch.h): the indices of the numbers
 * that it reads, and the derivatives of the result by them. The index of the result is that of the entry. Index 0 is a
 * number that depends on nothing; of statements that read only such numbers nothing is kept. */
#ifndef ADJOINTS_H
#define ADJOINTS_H

static __thread Tape *tape; /* of the run at hand, for all components */
extern "C" EXPORT void cosim_use_tape(Tape *of) { tape = of; }

#define MEMBER inline __attribute__((always_inline))

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

/* An operand, or an operation on operands, of type E; `v` is its value. Operands are references: a statement's parts
 * live as long as it. */
template <class E> struct Expression {
    MEMBER const E &self() const { return static_cast<const E &>(*this); }
};

struct alignas(16) Adjoint : Expression<Adjoint> { /* whole rows, whatever lies between numbers */
    enum { OPERANDS = 1 };
    double v;
    uint64_t index;
    Adjoint() = default;
    MEMBER Adjoint(double x) : v(x), index(0) {}
    MEMBER Adjoint(double x, uint64_t of) : v(x), index(of) {}
    template <class E> MEMBER Adjoint(const Expression<E> &e) : v(e.self().v) {
        static_assert(E::OPERANDS <= TAPE_SPARE, "a statement has more operands than the tape has space for");
        /* Without branches: the compiler then keeps both counts in registers from one statement to the next. */
        Tape *const t = tape;
        const TapeCount begin = t->n_operands < t->most ? t->n_operands : t->most;
        Operands to = {t->slopes, t->operands, begin};
        e.self().note(to, 1.0);
        t->n_operands = to.at;
        t->n += to.at != begin;
        t->ends[t->n & t->mask] = (uint32_t)to.at;
        index = to.at != begin ? t->n : 0;
    }
    MEMBER void note(Operands &to, double slope) const { to.note(slope, index); }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
typedef Adjoint Number;
#define OPERATION INLINE

/* The chain rule. */
template <class X> struct OfOne : Expression<OfOne<X>> {
    enum { OPERANDS = X::OPERANDS };
    double v, slope;
    const X &x;
    MEMBER OfOne(double value, double by_x, const X &of) : v(value), slope(by_x), x(of) {}
    MEMBER void note(Operands &to, double by) const { x.note(to, by * slope); }
};
template <class X, class Y> struct OfTwo : Expression<OfTwo<X, Y>> {
    enum { OPERANDS = X::OPERANDS + Y::OPERANDS };
    double v, slope, second;
    const X &x;
    const Y &y;
    MEMBER OfTwo(double value, double by_x, const X &of, double by_y, const Y &and_of)
        : v(value), slope(by_x), second(by_y), x(of), y(and_of) {}
    MEMBER void note(Operands &to, double by) const {
        x.note(to, by * slope);
        y.note(to, by * second);
    }
};
INLINE Adjoint chain(double value, double slope, const Adjoint &x) { return OfOne<Adjoint>(value, slope, x); }
INLINE Adjoint chain(double value, double slope, const Adjoint &x, double second, const Adjoint &y) {
    return OfTwo<Adjoint, Adjoint>(value, slope, x, second, y);
}
struct OfMany : Expression<OfMany> {
    enum { OPERANDS = TAPE_SPARE }; /* at most */
    double v;
    int n;
    const double *slopes;
    const Adjoint *const *of;
    MEMBER void note(Operands &to, double) const {
        for (int k = 0; k < n; k++) of[k]->note(to, slopes[k]);
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

#define OF_TWO(operator_, value, by_x, by_y)                                                             \
    template <class X, class Y>                                                                          \
    MEMBER OfTwo<X, Y> operator operator_(const Expression<X> &left, const Expression<Y> &right) {       \
        const X &x = left.self();                                                                        \
        const Y &y = right.self();                                                                       \
        const double r = value;                                                                          \
        return OfTwo<X, Y>(r, by_x, x, by_y, y);                                                         \
    }
#define WITH_NUMBER(operator_, value, by_x, value_of_number, by_y)                          \
    template <class X> MEMBER OfOne<X> operator operator_(const Expression<X> &of, double y) { \
        const X &x = of.self();                                                             \
        return OfOne<X>(value, by_x, x);                                                    \
    }                                                                                       \
    template <class Y> MEMBER OfOne<Y> operator operator_(double x, const Expression<Y> &of) { \
        const Y &y = of.self();                                                             \
        const double r = value_of_number;                                                   \
        return OfOne<Y>(r, by_y, y);                                                        \
    }
OF_TWO(+, x.v + y.v, 1.0, 1.0)
OF_TWO(-, x.v - y.v, 1.0, -1.0)
OF_TWO(*, x.v * y.v, y.v, x.v)
OF_TWO(/, x.v / y.v, 1.0 / y.v, -r / y.v)
WITH_NUMBER(+, x.v + y, 1.0, x + y.v, 1.0)
WITH_NUMBER(-, x.v - y, 1.0, x - y.v, -1.0)
WITH_NUMBER(*, x.v * y, y, x * y.v, x)
WITH_NUMBER(/, x.v / y, 1.0 / y, x / y.v, -r / y.v)
template <class X> MEMBER OfOne<X> operator-(const Expression<X> &of) {
    return OfOne<X>(-of.self().v, -1.0, of.self());
}
INLINE Adjoint operator+(const Adjoint &x, double y) { return moved(x.v + y, x); }
INLINE Adjoint operator+(double x, const Adjoint &y) { return moved(x + y.v, y); }
INLINE Adjoint operator-(const Adjoint &x, double y) { return moved(x.v - y, x); }
template <class E> MEMBER Adjoint &operator+=(Adjoint &x, const Expression<E> &e) { return x = x + e.self(); }
template <class E> MEMBER Adjoint &operator*=(Adjoint &x, const Expression<E> &e) { return x = x * e.self(); }

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
        if (any)
            for (uint32_t j = begin; j < end; j++) {
                const double slope = t->slopes[j];
                double *const to = of + (size_t)t->operands[j] * N;
                if (__builtin_expect(finite, 1) || slope != 0.0) /* what does not move counts for nothing */
                    for (int k = 0; k < N; k++) to[k] += by[k] * slope;
            }
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
