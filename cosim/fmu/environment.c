/* What Python calls of environment.h: a shared library of its own. */
#include "environment.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT uint32_t cosim_environment_bits(void) { return environment_bits(); }
EXPORT uint32_t cosim_environment_restore(uint32_t before) { return environment_restore(before); }
