/* Statements of generated code over numbers with derivatives: a statement, with all its operators, is one expression,
 * whose value is computed in its own order and whose derivatives by the numbers that it reads, its operands, are noted
 * together. tangents.h and adjoints.h say what becomes of operands; they define `Number` before they include this. */
#ifndef EXPRESSIONS_H
#define EXPRESSIONS_H

#ifndef __clang__ /* what operands point to costs gcc more time than the rest of its work, and gains nothing */
#pragma GCC optimize("no-tree-pta")
#endif

#define MEMBER inline __attribute__((always_inline))

/* The names of what an expression reads, in its order: -1 for elements of arrays and numbers that are not kept. */
template <int... NAMES> struct Names {
    enum { COUNT = sizeof...(NAMES) };
};
template <int... A, int... B> Names<A..., B...> joined(Names<A...>, Names<B...>);

/* The slots of a statement's operands: those of one name have one slot. */
template <int N> struct Slots {
    int n, at[N + 1], name[N + 1];
    bool first[N + 1], named;
};
template <int... NAMES> constexpr Slots<sizeof...(NAMES)> slots_of(Names<NAMES...>) {
    constexpr int names[] = {NAMES..., -1};
    Slots<sizeof...(NAMES)> r = {};
    r.named = true;
    for (int i = 0; i < (int)sizeof...(NAMES); i++) {
        int same = 0;
        while (same < r.n && (names[i] < 0 || r.name[same] != names[i])) same++;
        r.first[i] = same == r.n;
        r.name[same] = names[i];
        r.at[i] = same;
        r.n += r.first[i];
        r.named &= names[i] >= 0;
    }
    return r;
}
template <class N> struct Operands {
    static constexpr auto slots = slots_of(N());
    static constexpr int n = slots.n;
    double slopes[n];
    const Number *of[n];
    template <int AT> MEMBER void note(double slope, const Number &x) {
        constexpr int k = slots.at[AT];
        slopes[k] = slots.first[AT] ? slope : slopes[k] + slope;
        of[k] = &x;
    }
};

/* An operand, or an operation on operands, has a value `v`, its names, and `note`, which gives operands to `to`; the
 * first of them is number AT of the statement. Operands are references: a statement's parts live as long as it. */
#define IS_EXPRESSION(E) class = typename E::Read

/* The chain rule. */
template <class X> struct OfOne {
    typedef typename X::Read Read;
    double v, slope;
    const X &x;
    MEMBER OfOne(double value, double by_x, const X &of) : v(value), slope(by_x), x(of) {}
    template <int AT, class To> MEMBER void note(To &to, double by) const { x.template note<AT>(to, by * slope); }
};
template <class X, class Y> struct OfTwo {
    typedef decltype(joined(typename X::Read(), typename Y::Read())) Read;
    double v, slope, second;
    const X &x;
    const Y &y;
    MEMBER OfTwo(double value, double by_x, const X &of, double by_y, const Y &and_of)
        : v(value), slope(by_x), second(by_y), x(of), y(and_of) {}
    template <int AT, class To> MEMBER void note(To &to, double by) const {
        x.template note<AT>(to, by * slope);
        y.template note<AT + X::Read::COUNT>(to, by * second);
    }
};
#define OF_TWO(operator_, value, by_x, by_y)                                                        \
    template <class X, class Y, IS_EXPRESSION(X), IS_EXPRESSION(Y)>                                 \
    MEMBER OfTwo<X, Y> operator operator_(const X &x, const Y &y) {                                 \
        const double r = value;                                                                     \
        return OfTwo<X, Y>(r, by_x, x, by_y, y);                                                    \
    }
#define WITH_NUMBER(operator_, value, by_x, value_of_number, by_y)                                  \
    template <class X, IS_EXPRESSION(X)> MEMBER OfOne<X> operator operator_(const X &x, double y) { \
        return OfOne<X>(value, by_x, x);                                                            \
    }                                                                                               \
    template <class Y, IS_EXPRESSION(Y)> MEMBER OfOne<Y> operator operator_(double x, const Y &y) { \
        const double r = value_of_number;                                                           \
        return OfOne<Y>(r, by_y, y);                                                                \
    }
OF_TWO(+, x.v + y.v, 1.0, 1.0)
OF_TWO(-, x.v - y.v, 1.0, -1.0)
OF_TWO(*, x.v * y.v, y.v, x.v)
OF_TWO(/, x.v / y.v, 1.0 / y.v, -r / y.v)
WITH_NUMBER(+, x.v + y, 1.0, x + y.v, 1.0)
WITH_NUMBER(-, x.v - y, 1.0, x - y.v, -1.0)
WITH_NUMBER(*, x.v * y, y, x * y.v, x)
WITH_NUMBER(/, x.v / y, 1.0 / y, x / y.v, -r / y.v)
template <class X, IS_EXPRESSION(X)> MEMBER OfOne<X> operator-(const X &x) {
    return OfOne<X>(-x.v, -1.0, x);
}

template <int... I> struct Indices {};
template <int N, int... I> struct Counted : Counted<N - 1, N - 1, I...> {};
template <int... I> struct Counted<0, I...> {
    typedef Indices<I...> type;
};

/* A `local` number of a function: its value, and its operands with its derivatives by them. A statement that reads it
 * has these operands in its place. */
template <class N> struct Local : Operands<N> {
    typedef Operands<N> Of;
    static_assert(Of::slots.named, "a local number reads one without a name");
    template <int... I> static Names<Of::slots.name[I]...> names_of(Indices<I...>);
    typedef typename Counted<Of::n>::type Each;
    typedef decltype(names_of(Each())) Read;
    double v;
    template <class E> MEMBER Local(const E &e) : v(e.v) { e.template note<0>(static_cast<Of &>(*this), 1.0); }
    template <int AT, class To> MEMBER void note(To &to, double by) const { note_each<AT>(to, by, Each()); }
    template <int AT, class To, int... I> MEMBER void note_each(To &to, double by, Indices<I...>) const {
        (to.template note<AT + I>(by * this->slopes[I], *this->of[I]), ...);
    }
};
template <class E> Local(const E &) -> Local<typename E::Read>;

#endif
