/* Pairs of random profiles with given spectra, computed from parameters alone. */
#ifndef RANDOM_PROFILES_H
#define RANDOM_PROFILES_H

#include "fmu_model.h"

typedef struct {
    int least, most;        /* nodes: powers of two */
    double step;            /* between nodes */
    double lowest, highest; /* wave numbers [1/unit of step] that there are */
    int n_parameters;
    FmuFunction settings;   /* p -> seed, length */
    FmuFunction
        spectra; /* t: wave number, p -> power spectral densities (one-sided) of what both share and of what differs */
} FmuProfiles;

/* The left profile at `most` nodes, then the right one; nodes beyond the length, and the period, are not defined.
 *
 * `kept` is memory of the instance for 1 + n_parameters + 2 most numbers, zeros at first: the profiles stay there until
 * a parameter changes. So they are no part of a saved state, and one from elsewhere brings its own. */
const double *fmu_profiles(const FmuProfiles *of, const FmuArguments *at, double *kept);

#endif
