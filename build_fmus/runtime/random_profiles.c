/* Sums of waves with random phases, by a fast Fourier transform.
 *
 * A profile of n nodes has waves at the multiples of 1 / (n step). At each of them there are two: one lifts left and
 * right alike, the other lifts the left and lowers the right. Amplitudes follow from the spectra, phases from the seed.
 */

#include "random_profiles.h"

#include <stdint.h>
#include <string.h>

#include "fmu_math.h"

static const double TURN = 6.283185307179586;

/* SplitMix64 (Steele, Lea, Flood 2014): whole numbers only, so the same everywhere. */
static const uint64_t GOLDEN = UINT64_C(0x9e3779b97f4a7c15);

static uint64_t mixed(uint64_t z) {
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

/* Number k of a sequence, evenly distributed in [0, 1). */
static double uniform(uint64_t sequence, uint64_t k) {
    return (double)(mixed(sequence + (k + 1u) * GOLDEN) >> 11) * (1.0 / 9007199254740992.0);
}

/* z[k] <- sum over m of z[m] exp(2 pi i m k / n): radix 2, in place. */
static void transform(double *re, double *im, int n) {
    for (int i = 1, j = 0; i < n; i++) { /* bits of the index in reverse order */
        int bit = n >> 1;
        for (; j & bit; bit >>= 1) j ^= bit;
        j ^= bit;
        if (i < j) {
            const double a = re[i], b = im[i];
            re[i] = re[j], im[i] = im[j];
            re[j] = a, im[j] = b;
        }
    }
    for (int half = 1; half < n; half *= 2)
        for (int k = 0; k < half; k++) {
            const double angle = TURN * (double)k / (double)(2 * half), c = cos(angle), s = sin(angle);
            for (int i = k; i < n; i += 2 * half) {
                const int j = i + half;
                const double a = c * re[j] - s * im[j], b = c * im[j] + s * re[j];
                re[j] = re[i] - a, im[j] = im[i] - b;
                re[i] += a, im[i] += b;
            }
        }
}

/* Left and right as real and imaginary part of one transform. */
static void compute(const FmuProfiles *of, const FmuArguments *at, double *left, double *right) {
    double settings[2], spectra[2];
    of->settings(at, settings);
    const double seed = settings[0];
    const uint64_t sequence = mixed((seed >= 0.0 && seed < 9007199254740992.0 ? (uint64_t)seed : 0u) + GOLDEN);
    int n = of->least;
    while (n < of->most && (double)(n - 1) * of->step < settings[1]) n *= 2;
    const double period = (double)n * of->step;
    memset(left, 0, (size_t)of->most * sizeof(double));
    memset(right, 0, (size_t)of->most * sizeof(double));
    FmuArguments here = *at;
    for (int m = 1; m < n / 2; m++) {
        here.t = (double)m / period;
        if (here.t < of->lowest) continue;
        if (here.t > of->highest) break;
        of->spectra(&here, spectra);
        const double both = sqrt(2.0 * spectra[0] / period), opposite = sqrt(2.0 * spectra[1] / period);
        const double first = TURN * uniform(sequence, 2u * (uint64_t)m),
                     second = TURN * uniform(sequence, 2u * (uint64_t)m + 1u);
        const double br = both * cos(first), bi = both * sin(first), dr = opposite * cos(second),
                     di = opposite * sin(second);
        const double lr = br + dr, li = bi + di, rr = br - dr, ri = bi - di;
        left[m] = 0.5 * (lr - ri), right[m] = 0.5 * (li + rr);
        left[n - m] = 0.5 * (lr + ri), right[n - m] = 0.5 * (rr - li);
    }
    transform(left, right, n);
}

const double *fmu_profiles(const FmuProfiles *of, const FmuArguments *at, double *kept) {
    double *const made_for = kept + 1, *const left = made_for + of->n_parameters;
    const size_t size = (size_t)of->n_parameters * sizeof(double);
    if (kept[0] == 0.0 || memcmp(made_for, at->p, size) != 0) {
        compute(of, at, left, left + of->most);
        memcpy(made_for, at->p, size);
        kept[0] = 1.0;
    }
    return left;
}
