/* What Python calls of environment.h, and a guard against FMUs that end the process: a shared library of its own. */
#include "environment.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#if !defined(_WIN32)
#include <unistd.h>
#endif

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT uint32_t cosim_environment_bits(void) { return environment_bits(); }
EXPORT uint32_t cosim_environment_restore(uint32_t before) { return environment_restore(before); }

static const char *volatile sentence; /* NULL: Python ends by itself */

#if !defined(_WIN32)
static void at_exit(void) {
    const char *const text = sentence;
    if (!text) return;
    if (write(2, text, strlen(text)) < 0) _exit(1);
    _exit(1);
}
#endif

/* An `exit` of C code, which Python does not see, ends with this sentence and exit code 1; NULL: no longer. Not on
 * Windows, where each library may have an `exit` of its own. */
EXPORT void cosim_guard_exit(const char *text) {
    static bool guarded;
    sentence = text;
#if !defined(_WIN32)
    if (!guarded && text) atexit(at_exit);
#endif
    guarded = true;
}
