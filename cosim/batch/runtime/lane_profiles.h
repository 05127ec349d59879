/* Random profiles of each copy are computed by the code of one (library.py), and are given in place of solutions. */
#if HAS_PROFILES
#include "random_profiles.h"
#define fmu_profiles(of, at, kept) ((void)(of), (void)(kept), (at)->s)
#endif
