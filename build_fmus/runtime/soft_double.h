/* Double precision on a processor whose unit has none: what the library of its compiler does not have, or rounds
 * wrongly. All results are correctly rounded. */
#ifndef SOFT_DOUBLE_H
#define SOFT_DOUBLE_H

#if defined(__ARM_FP) && !(__ARM_FP & 8)
#include <float.h>
#include <math.h>
#include <stdint.h>

enum { SOFT_BIAS = 1023, SOFT_SPECIAL = 0x7ff };
#define SOFT_SIGN 0x8000000000000000u
#define SOFT_FRACTION 0xfffffffffffffu
#define SOFT_ONE 0x10000000000000u /* in front of the fraction */

/* A processor without a unit for double precision would call a library's square root. */
#undef sqrt
#define sqrt(x) soft_sqrt(x)
/* The root of the significand, bit by bit. */
static __attribute__((unused)) double soft_sqrt(double x) {
    if (!(x > 0.0) || x > DBL_MAX) return x == 0.0 || x > 0.0 ? x : (double)NAN;
    int shift = 0;
    union { double number; uint64_t bits; } v = {x};
    if (x < DBL_MIN) { v.number = x * 18014398509481984.0; shift = -27; } /* 2^54 */
    const int exponent = (int)(v.bits >> 52) - SOFT_BIAS, odd = exponent & 1;
    uint64_t rest = ((v.bits & SOFT_FRACTION) | SOFT_ONE) << odd << 1, root = 0, trial = 0;
    for (uint64_t bit = 2 * SOFT_ONE; bit; bit >>= 1) {
        const uint64_t t = trial + bit;
        if (t <= rest) { trial = t + bit; rest -= t; root += bit; }
        rest <<= 1;
    }
    root += rest != 0 ? root & 1 : 0;
    v.bits = (root >> 1) + ((uint64_t)((exponent - odd) / 2 + shift + SOFT_BIAS - 1) << 52);
    return v.number;
}

/* The sum of two doubles. The significands are moved to the left by three bits, of which the last one tells whether
 * anything was lost behind it. (libgcc 12.2 rounds wrongly where the larger one is a power of two, the other one has
 * the opposite sign, and their exponents differ by 33.) */
static uint64_t soft_sum(uint64_t a, uint64_t b) {
    if ((a << 1) < (b << 1)) { /* a is the larger one */
        const uint64_t larger = b;
        b = a;
        a = larger;
    }
    int exponent = (int)(a >> 52) & SOFT_SPECIAL;
    const int other = (int)(b >> 52) & SOFT_SPECIAL;
    if (exponent == SOFT_SPECIAL) { /* NaN, infinity, or their difference */
        const uint64_t quiet = SOFT_ONE >> 1;
        return (a & SOFT_FRACTION) != 0 || (other == SOFT_SPECIAL && a != b) ? a | quiet : a;
    }
    uint64_t sum = (a & SOFT_FRACTION) << 3, less = (b & SOFT_FRACTION) << 3;
    if (exponent != 0) sum |= SOFT_ONE << 3;
    else exponent = 1;
    if (other != 0) less |= SOFT_ONE << 3;
    const int behind = exponent - (other != 0 ? other : 1);
    if (behind > 56) less = less != 0;
    else if (behind > 0) less = less >> behind | ((less << (64 - behind)) != 0);
    sum = ((a ^ b) & SOFT_SIGN) != 0 ? sum - less : sum + less;
    if (sum == 0) return a & b & SOFT_SIGN;
    if ((sum >> 56) != 0) {
        sum = sum >> 1 | (sum & 1u);
        exponent++;
    } else {
        const uint32_t high = (uint32_t)(sum >> 32);
        int shift = (high != 0 ? __builtin_clz(high) : 32 + __builtin_clz((uint32_t)sum)) - 8;
        if (shift > exponent - 1) shift = exponent - 1; /* a subnormal number */
        sum <<= shift;
        exponent -= shift;
    }
    const uint32_t rest = (uint32_t)sum & 7u;
    sum >>= 3;
    if (rest > 4 || (rest == 4 && (sum & 1u) != 0)) sum++;
    if (exponent >= SOFT_SPECIAL) return (a & SOFT_SIGN) | (uint64_t)SOFT_SPECIAL << 52;
    return (a & SOFT_SIGN) | (((uint64_t)(exponent - 1) << 52) + sum);
}

/* What the compiler calls for sums (Run-time ABI for the Arm Architecture), in this library instead of its own. */
uint64_t soft_add(uint64_t a, uint64_t b) __asm__("__aeabi_dadd");
uint64_t soft_subtract(uint64_t a, uint64_t b) __asm__("__aeabi_dsub");
uint64_t soft_subtract_from(uint64_t a, uint64_t b) __asm__("__aeabi_drsub");
uint64_t soft_add(uint64_t a, uint64_t b) { return soft_sum(a, b); }
uint64_t soft_subtract(uint64_t a, uint64_t b) { return soft_sum(a, b ^ SOFT_SIGN); }
uint64_t soft_subtract_from(uint64_t a, uint64_t b) { return soft_sum(b, a ^ SOFT_SIGN); }
#endif

#endif
