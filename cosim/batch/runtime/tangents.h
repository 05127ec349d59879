/* A number with its derivatives in TANGENTS directions: the type, its operators, and what numbers.h is written with. */
#ifndef TANGENTS_H
#define TANGENTS_H

enum { PART = 8, PARTS = TANGENTS / PART };
typedef double Part __attribute__((vector_size(8 * PART)));

struct Tangent {
    double v; /* then as many unused numbers as alignment takes */
    Part d[PARTS];
    Tangent() = default;
    Tangent(double x) : v(x) {
        for (Part &part : d) part = Part{};
    }
    double &operator[](int) { return v; }
    double operator[](int) const { return v; }
};
typedef Tangent Number;
#define OPERATION NOINLINE

#define EACH_PART(expression) \
    _Pragma("GCC unroll 8") for (int i = 0; i < PARTS; i++) expression

typedef decltype(Part() != Part()) PartMask;
INLINE int any_of(const PartMask &of) {
    int any = 0;
    for (int i = 0; i < PART; i++) any |= of[i] != 0;
    return any;
}
INLINE int depends(const Tangent &x) {
    PartMask any = {};
    EACH_PART(any |= x.d[i] != 0.0);
    return any_of(any);
}
INLINE int depends(const Tangent &x, const Tangent &y) {
    PartMask any = {};
    EACH_PART(any |= x.d[i] != y.d[i]);
    return any_of(any);
}

/* The chain rule. Where x does not move, its part is 0, also where the slope is infinite. */
INLINE Part scaled(double slope, const Part &d) {
    if (slope - slope == 0.0) return slope * d;
    Part r;
    for (int i = 0; i < PART; i++) r[i] = d[i] == 0.0 ? 0.0 : slope * d[i];
    return r;
}
INLINE Tangent chain(double value, double slope, const Tangent &x) {
    Tangent r;
    r.v = value;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]));
    return r;
}
INLINE Tangent chain(double value, double slope, const Tangent &x, double second, const Tangent &y) {
    Tangent r;
    r.v = value;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]) + scaled(second, y.d[i]));
    return r;
}
NOINLINE Tangent chain(double value, int n, const double *slopes, const Tangent *const *of) {
    Tangent r(value);
    for (int k = 0; k < n; k++) {
        EACH_PART(r.d[i] += scaled(slopes[k], of[k]->d[i]));
    }
    return r;
}

NOINLINE Tangent operator+(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v + y.v;
    EACH_PART(r.d[i] = x.d[i] + y.d[i]);
    return r;
}
NOINLINE Tangent operator-(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v - y.v;
    EACH_PART(r.d[i] = x.d[i] - y.d[i]);
    return r;
}
NOINLINE Tangent operator*(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v * y.v;
    EACH_PART(r.d[i] = y.v * x.d[i] + x.v * y.d[i]);
    return r;
}
NOINLINE Tangent operator/(const Tangent &x, const Tangent &y) {
    Tangent r;
    r.v = x.v / y.v;
    const double slope = 1.0 / y.v, by = -r.v * slope;
    EACH_PART(r.d[i] = scaled(slope, x.d[i]) + scaled(by, y.d[i]));
    return r;
}
NOINLINE Tangent operator-(const Tangent &x) {
    Tangent r;
    r.v = -x.v;
    EACH_PART(r.d[i] = -x.d[i]);
    return r;
}
NOINLINE Tangent moved(double value, const Tangent &x) {
    Tangent r = x;
    r.v = value;
    return r;
}
NOINLINE Tangent operator+(const Tangent &x, double y) { return moved(x.v + y, x); }
NOINLINE Tangent operator+(double x, const Tangent &y) { return moved(x + y.v, y); }
NOINLINE Tangent operator-(const Tangent &x, double y) { return moved(x.v - y, x); }
NOINLINE Tangent operator-(double x, const Tangent &y) { return chain(x - y.v, -1.0, y); }
NOINLINE Tangent operator*(const Tangent &x, double y) { return chain(x.v * y, y, x); }
NOINLINE Tangent operator*(double x, const Tangent &y) { return chain(x * y.v, x, y); }
NOINLINE Tangent operator/(const Tangent &x, double y) { return chain(x.v / y, 1.0 / y, x); }
NOINLINE Tangent operator/(double x, const Tangent &y) { return chain(x / y.v, -(x / y.v) / y.v, y); }
INLINE Tangent &operator+=(Tangent &x, const Tangent &y) { return x = x + y; }
INLINE Tangent &operator*=(Tangent &x, const Tangent &y) { return x = x * y; }

/* Whether a number is not the same, beyond rounding and at all. A derivative may be of any size. */
INLINE int lanes_moved(const Tangent &was, const Tangent &now) {
    const double *const a = (const double *)was.d, *const b = (const double *)now.d;
    int r = fabs(now.v - was.v) > 1e-12 * fmax(fabs(was.v), 1.0);
    for (int i = 0; i < TANGENTS; i++) r |= fabs(b[i] - a[i]) > 1e-12 * fabs(a[i]);
    return r;
}
INLINE int lanes_changed(const Tangent &was, const Tangent &now) { return memcmp(&was, &now, sizeof was) != 0; }

#endif
