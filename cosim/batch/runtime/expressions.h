/* Statements of generated code over numbers with derivatives: a statement, with all its operators, is one expression,
 * whose value is computed in its own order and whose derivatives by the numbers that it reads, its operands, are noted
 * together. tangents.h and adjoints.h say what becomes of operands. */
#ifndef EXPRESSIONS_H
#define EXPRESSIONS_H

#ifndef __clang__ /* what operands point to costs gcc more time than the rest of its work, and gains nothing */
#pragma GCC optimize("no-tree-pta")
#endif

#define MEMBER inline __attribute__((always_inline))

/* An operand, or an operation on operands, of type E; `v` is its value. Operands are references: a statement's parts
 * live as long as it. */
template <class E> struct Expression {
    MEMBER const E &self() const { return static_cast<const E &>(*this); }
};

/* The chain rule. `note` gives operands, of which the first is number AT of the statement, to `to`. */
template <class X> struct OfOne : Expression<OfOne<X>> {
    enum { OPERANDS = X::OPERANDS };
    double v, slope;
    const X &x;
    MEMBER OfOne(double value, double by_x, const X &of) : v(value), slope(by_x), x(of) {}
    template <int AT, class To> MEMBER void note(To &to, double by) const { x.template note<AT>(to, by * slope); }
};
template <class X, class Y> struct OfTwo : Expression<OfTwo<X, Y>> {
    enum { OPERANDS = X::OPERANDS + Y::OPERANDS };
    double v, slope, second;
    const X &x;
    const Y &y;
    MEMBER OfTwo(double value, double by_x, const X &of, double by_y, const Y &and_of)
        : v(value), slope(by_x), second(by_y), x(of), y(and_of) {}
    template <int AT, class To> MEMBER void note(To &to, double by) const {
        x.template note<AT>(to, by * slope);
        y.template note<AT + X::OPERANDS>(to, by * second);
    }
};
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

#endif
