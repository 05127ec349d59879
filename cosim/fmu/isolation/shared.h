/* The region of memory behind link.h, for the two C files that use it. */
#ifndef SHARED_H
#define SHARED_H

#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* for what POSIX and Linux have beyond C11 */
#endif

#include "link.h"

#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#if !defined(MSG_NOSIGNAL)
#define MSG_NOSIGNAL 0 /* macOS; both sides ignore SIGPIPE */
#endif

/* What is written by one side and read by the other has to travel, line by line of the cache: one line for each
 * direction, with its values right behind it. */
typedef struct {
    _Atomic uint32_t number;    /* of the call */
    _Atomic uint32_t worker_waits;
    uint32_t op;
    uint32_t n_sets;            /* records in the request area that are set before anything else */
    double t, h;
    uint64_t a, b;              /* other arguments */
    uint64_t used;              /* bytes of the request area */
} Ask;

typedef struct {
    _Atomic uint32_t number;    /* of the call that is done */
    _Atomic uint32_t master_waits;
    uint32_t status;
    uint32_t failed; /* what is being done: 0 the call itself, k > 0 the k-th of the records that are set before it,
                        LINK_FETCHING + k the k-th fetch after a step */
    uint64_t value;             /* the reply, without the areas */
    double last;
    uint32_t log_used, reply_used, results_used; /* bytes of the areas */
    uint32_t log_lost;          /* messages dropped because the buffer was full */
    bool flags[4];              /* event, (not used), terminate, early */
    uint8_t environment;        /* what it changed: environment.h */
    uint8_t no_memory;          /* the limit is reached */
} Answer;

typedef struct {
    Ask *ask;
    char *request;
    Answer *answer;
    char *results, *reply, *log;
    size_t area;                /* bytes of request, results and reply */
} Region;

enum { LINE = 64, HEADER = 256, PAGE = 4096 };
#define ALIGNED(n) (((size_t)(n) + 7) & ~(size_t)7)

static inline bool region_of(Region *r, void *memory, size_t size) {
    if (size < LINK_LOG + 6 * PAGE) return false;
    const size_t third = (size - LINK_LOG) / 3 / PAGE * PAGE;
    r->ask = memory;
    r->answer = (void *)((char *)memory + third);
    r->request = (char *)r->ask + HEADER;
    r->results = (char *)r->answer + HEADER;
    r->log = (char *)memory + 2 * third; /* not at the end: an FMU may write there while it is read */
    r->reply = r->log + LINK_LOG;
    r->area = third - HEADER;
    return sizeof(Ask) <= LINE && sizeof(Answer) <= LINE;
}

static inline size_t value_size(uint32_t type) {
    static const unsigned char size[LINK_TYPES] = {
        8, 4, 4, 0, 8, 4, 1, 1, 2, 2, 4, 4, 8, 8, sizeof(bool), 0, 0, sizeof(bool)};
    return type < LINK_TYPES ? size[type] : 0;
}

static inline int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static inline void breathe(void) {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

/* Look for another value of a number than `old`, for `ns` nanoseconds; after a while with a place for others on this
 * core, since there may be more processes that look than cores. */
static inline bool spin(const _Atomic uint32_t *number, uint32_t old, int64_t ns) {
    for (int i = 0; i < 400; i++)
        if (atomic_load_explicit(number, memory_order_acquire) != old) return true;
    for (const int64_t end = ns > 0 ? now_ns() + ns : 0; ns > 0 && now_ns() < end; sched_yield())
        for (int i = 0; i < 8; i++) {
            if (atomic_load_explicit(number, memory_order_acquire) != old) return true;
            breathe();
        }
    return false;
}

/* One byte for whoever waits at the other end; false: it is gone. A full pipe needs no further byte. */
static inline bool ring(int fd) {
    return send(fd, "", 1, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0 || errno == EAGAIN || errno == EINTR;
}

#endif
