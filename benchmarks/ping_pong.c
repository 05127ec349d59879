/* The least that a call into another process costs: two processes that hand a number back and forth in shared memory,
 * looking for it all the time. Prints nanoseconds per round, the median of all batches. */
#define _GNU_SOURCE
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { BATCHES = 400, ROUNDS = 500 };

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    return (*(const double *)a > *(const double *)b) - (*(const double *)a < *(const double *)b);
}

int main(void) {
    typedef struct { _Alignas(64) _Atomic uint32_t there; _Alignas(64) _Atomic uint32_t back; } Shared;
    Shared *s = mmap(NULL, sizeof *s, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    const pid_t child = fork();
    if (child == 0)
        for (uint32_t seen = 0;;) {
            while (atomic_load_explicit(&s->there, memory_order_acquire) == seen) {}
            seen = atomic_load(&s->there);
            if (seen == UINT32_MAX) _exit(0);
            atomic_store_explicit(&s->back, seen, memory_order_release);
        }
    static double found[BATCHES];
    uint32_t n = 0;
    for (int i = 0; i < BATCHES; i++) {
        const double begin = now();
        for (int k = 0; k < ROUNDS; k++) {
            atomic_store_explicit(&s->there, ++n, memory_order_release);
            while (atomic_load_explicit(&s->back, memory_order_acquire) != n) {}
        }
        found[i] = (now() - begin) / ROUNDS;
    }
    atomic_store(&s->there, UINT32_MAX);
    waitpid(child, NULL, 0);
    qsort(found, BATCHES, sizeof *found, ascending);
    printf("%.1f\n", found[BATCHES / 2]);
    return 0;
}
