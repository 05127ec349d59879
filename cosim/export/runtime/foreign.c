/* Libraries of third-party FMUs, which travel in the resources of the system's FMU. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <string.h>

#include "component.h"

#if defined(_WIN32)
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define CLOSE(library) FreeLibrary((HMODULE)(library))
#define SUFFIX ".dll"
#define SYSTEM2 "win"
#define SYSTEM3 "windows"
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND(library, name) dlsym(library, name)
#define CLOSE(library) dlclose(library)
#if defined(__APPLE__)
#define SUFFIX ".dylib"
#define SYSTEM2 "darwin"
#define SYSTEM3 "darwin"
#else
#define SUFFIX ".so"
#define SYSTEM2 "linux"
#define SYSTEM3 "linux"
#if defined(__GLIBC__) && defined(__x86_64__)
/* The versions that every glibc has: a newer one has others by default, which older systems do not. */
__asm__(".symver dlopen,dlopen@GLIBC_2.2.5");
__asm__(".symver dlsym,dlsym@GLIBC_2.2.5");
__asm__(".symver dlclose,dlclose@GLIBC_2.2.5");
__asm__(".symver dlerror,dlerror@GLIBC_2.2.5");
#elif defined(__GLIBC__) && defined(__aarch64__)
__asm__(".symver dlopen,dlopen@GLIBC_2.17");
__asm__(".symver dlsym,dlsym@GLIBC_2.17");
__asm__(".symver dlclose,dlclose@GLIBC_2.17");
__asm__(".symver dlerror,dlerror@GLIBC_2.17");
#endif
#endif
#endif

#if defined(__aarch64__) || defined(_M_ARM64)
#define MACHINE3 "aarch64"
#define PLATFORM2 "aarch64-" SYSTEM3
#else
#define MACHINE3 "x86_64"
#define PLATFORM2 SYSTEM2 "64"
#endif
#define PLATFORM3 MACHINE3 "-" SYSTEM3

/* Data pointers to function pointers: what POSIX promises and C does not. */
#define FIND2(name)                                                                                                    \
    {                                                                                                                  \
        void *found = FIND(library, "fmi2" #name);                                                                     \
        memcpy(&f2->name, &found, sizeof found);                                                                       \
        if (!found && !(exchange && steps(#name))) missing = "fmi2" #name; \
    }
#define FIND3(name)                                                                                                    \
    {                                                                                                                  \
        void *found = FIND(library, "fmi3" #name);                                                                     \
        memcpy(&f3->name, &found, sizeof found);                                                                       \
        if (!found && !(exchange && steps(#name))) missing = "fmi3" #name; \
    }

/* Whether a function is only of Co-Simulation. */
static bool steps(const char *name) { return !strcmp(name, "DoStep") || !strcmp(name, "InstantiateCoSimulation"); }

void *foreign_open(const char *resources, const char *folder, const char *identifier, int version, void *functions,
    bool exchange, char *reason, size_t n_reason) {
    char path[4096 + 512];
    (void)snprintf(path, sizeof path, "%s/%s/binaries/%s/%s%s", resources, folder, version == 2 ? PLATFORM2 : PLATFORM3,
        identifier, SUFFIX);
    void *library = OPEN(path);
    if (!library) {
#if defined(_WIN32)
        (void)snprintf(
            reason, n_reason, "its library %s cannot be loaded (error %lu)", path, (unsigned long)GetLastError());
#else
        const char *said = dlerror();
        (void)snprintf(reason, n_reason, "its library cannot be loaded: %s", said ? said : path);
#endif
        return NULL;
    }
    const char *missing = NULL;
    if (version == 2) {
        Functions2 *f2 = functions;
        FMI2_OPTIONAL_CALLS(FIND2)
        missing = NULL; /* not every FMU has these */
        FMI2_CALLS(FIND2)
    } else {
        Functions3 *f3 = functions;
        FMI3_OPTIONAL_CALLS(FIND3)
        missing = NULL;
        FMI3_CALLS(FIND3)
    }
    if (!missing) return library;
    (void)snprintf(reason, n_reason, "its library lacks %s", missing);
    CLOSE(library);
    return NULL;
}

ExchangeCall foreign_find(void *library, int version, const char *name) {
    char full[64];
    (void)snprintf(full, sizeof full, "fmi%d%s", version, name);
    void *const found = FIND(library, full);
    ExchangeCall call;
    memcpy(&call, &found, sizeof found);
    return call;
}

void foreign_close(void *library) { CLOSE(library); }
