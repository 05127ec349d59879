/* An FMU that does one bad deed in one phase of its life, FMI 2.0 or 3.0: `resources/deed.txt` says "PHASE DEED". y
 * counts steps and adds u; it does nothing wrong before its tenth step, or that of HOSTILE_STEP, and with HOSTILE_SLOW
 * each takes a millisecond. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <fcntl.h>
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#if FMI == 2
#include "fmi2Functions.h"
#define NAME(n) fmi2##n
typedef fmi2Component Instance;
typedef fmi2Status Status;
#define OK fmi2OK
#else
#include "fmi3Functions.h"
#define NAME(n) fmi3##n
typedef fmi3Instance Instance;
typedef fmi3Status Status;
#define OK fmi3OK
#endif


static char phase[32], deed[32];
static double u, y, bad;
static int steps, status, faulty_step = 10;
static bool slow;
#if FMI == 2
static const fmi2CallbackFunctions *callbacks;
#else
static fmi3LogMessageCallback message;
#endif

static void say(const char *text) {
#if FMI == 2
    callbacks->logger(callbacks->componentEnvironment, "hostile", fmi2Warning, "deeds", "%s", text);
#else
    message(NULL, fmi3Warning, "deeds", text);
#endif
}

static int deeper(volatile int n) { return n ? deeper(n + 1) + n : 0; }

static void *later(void *nothing) {
    *(volatile int *)nothing = 1;
    return nothing;
}

static void scribble(void) { /* over all memory that it shares with others */
    FILE *maps = fopen("/proc/self/maps", "r");
    char line[512], how[8];
    unsigned long begin, end;
    while (maps && fgets(line, sizeof line, maps))
        if (sscanf(line, "%lx-%lx %7s", &begin, &end, how) == 3 && strcmp(how, "rw-s") == 0)
            memset((void *)begin, 0xff, 1 << 18);
    if (maps) fclose(maps);
}

/* Into every descriptor but the standard ones: a pickle that makes the file HOSTILE_PROOF in whatever process reads it,
 * bare or behind its length as a message; or bytes without end; or the beginning of a message of 2^62 bytes. */
static void forge(const char *how) {
    char text[4200];
    const char *proof = getenv("HOSTILE_PROOF");
    const uint64_t length =
        (uint64_t)snprintf(text, sizeof text, "cposix\nsystem\n(S'touch %s'\ntR.", proof ? proof : "");
    const uint64_t claimed = (uint64_t)1 << 62;
    for (int fd = 3; fd < 64; fd++) {
        if (fcntl(fd, F_GETFD) < 0) continue;
        if (strcmp(how, "message") == 0 && write(fd, &length, 8) != 8) continue;
        if (strcmp(how, "claim") == 0 && write(fd, &claimed, 8) != 8) continue;
        if (write(fd, text, length) < 0) continue;
        if (strcmp(how, "flood") == 0) while (write(fd, text, sizeof text) > 0) {}
    }
    _exit(0);
}

/* A process that is nobody's child, in a session of its own; its number is written into the file HOSTILE_PROOF before
 * this returns. */
static void detach(void) {
    const char *proof = getenv("HOSTILE_PROOF");
    int there[2];
    char byte;
    if (pipe(there) != 0) return;
    if (fork() == 0) {
        setsid();
        if (fork() != 0) _exit(0);
        FILE *file = proof ? fopen(proof, "w") : NULL;
        if (file) fprintf(file, "%d", (int)getpid()), fclose(file);
        if (write(there[1], "", 1) == 1) for (;;) pause();
        _exit(1);
    }
    if (read(there[0], &byte, 1) != 1) return;
    close(there[0]), close(there[1]);
}

static void commit(void) {
#define IS(name) (strcmp(deed, #name) == 0)
    if (IS(segfault)) *(volatile int *)0 = 1;
    if (IS(abort)) abort();
    if (IS(exit)) exit(3);
    if (strcmp(deed, "exit-0") == 0) exit(0);
    if (IS(quit)) _exit(0);
    if (IS(hang)) for (volatile int i = 0;; i++) {}
    if (IS(sleep)) for (;;) pause();
    if (IS(devour))
        for (;;) {
            char *p = malloc(1 << 22);
            memset(p, 1, 1 << 22);
        }
    if (IS(greedy)) {
        void *p;
        while ((p = malloc(1 << 22)) != NULL) memset(p, 1, 1 << 22);
        status = 3;
    }
    if (IS(overflow)) status = deeper(1) & 0;
    if (IS(trap)) __builtin_trap();
    if (IS(divide)) raise(SIGFPE);
    if (IS(kill)) kill(getpid(), SIGKILL);
    if (IS(stop)) kill(getpid(), SIGSTOP);
    if (IS(terminate)) raise(SIGTERM);
    if (IS(close)) {
        for (int i = 0; i < 1024; i++) close(i);
        for (;;) pause();
    }
    if (IS(round)) fesetround(FE_UPWARD);
#if defined(__x86_64__)
    if (IS(flush)) __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040);
#elif defined(__aarch64__)
    if (IS(flush)) __asm__ volatile("msr fpcr, %0" : : "r"((uint64_t)1 << 24));
#endif
    if (IS(status)) status = 77;
    if (IS(negative)) status = -1;
    if (IS(nan)) bad = NAN;
    if (IS(infinite)) bad = INFINITY;
    if (IS(chatter)) for (int i = 0; i < 100000; i++) say("a message of some length, again and again and again");
    if (IS(fork) && fork() >= 0) _exit(4);
    if (IS(shrink)) for (int i = 3; i < 64; i++) if (ftruncate(i, 0)) continue;
    if (IS(print)) {
        printf("this was printed\n");
        abort();
    }
    if (IS(child) && fork() == 0) for (;;) pause();
    if (IS(scribble)) scribble();
    if (IS(pickle) || IS(message) || IS(claim) || IS(flood)) forge(deed);
    if (IS(detach)) detach();
    if (IS(thread)) {
        pthread_t one;
        pthread_create(&one, NULL, later, NULL);
        for (;;) pause();
    }
    if (IS(words)) {
        say("these are my last words");
        abort();
    }
}

static void at(const char *now) {
    status = OK;
    if (strncmp(phase, "late-", 5) == 0) { /* only when it has made its steps */
        if (strcmp(phase + 5, now) == 0 && steps >= faulty_step) commit();
        return;
    }
    if (strcmp(phase, now) == 0 && (strcmp(now, "step") != 0 || steps == faulty_step)) commit();
}

static void find_deed(void) {
    Dl_info info;
    char path[4096];
    if (!dladdr((void *)find_deed, &info)) return;
    snprintf(path, sizeof path, "%s", info.dli_fname);
    for (int i = 0; i < 3; i++) *strrchr(path, '/') = 0; /* binaries, platform, file */
    strcat(path, "/resources/deed.txt");
    FILE *file = fopen(path, "r");
    if (file && fscanf(file, "%31s %31s", phase, deed) != 2) phase[0] = 0;
    if (file) fclose(file);
}

__attribute__((constructor)) static void loaded(void) {
    const char *late = getenv("HOSTILE_STEP");
    if (late) faulty_step = atoi(late);
    slow = getenv("HOSTILE_SLOW") != NULL;
    find_deed();
    at("load");
}

static Instance made(void) {
    static int instance;
    y = u = bad = 0;
    steps = 0;
    at("instantiate");
    return status == OK ? &instance : NULL;
}

static void step(double h) {
    steps++;
    if (slow) usleep(1000);
    y += 1 + h * u;
    at("step");
    y += bad;
}

#define PLAIN(name, phase)           \
    Status NAME(name)(Instance i) {  \
        (void)i;                     \
        at(phase);                   \
        return (Status)status;       \
    }
PLAIN(ExitInitializationMode, "exit")
PLAIN(Terminate, "terminate")
Status NAME(Reset)(Instance i) {
    (void)i;
    y = u = bad = 0;
    steps = 0;
    at("reset");
    return (Status)status;
}
void NAME(FreeInstance)(Instance i) {
    (void)i;
    at("free");
}

static Status set(const double *v) {
    u = v[0];
    at("set");
    return (Status)status;
}

static Status get(double *v) {
    at("get");
    v[0] = y + bad;
    return (Status)status;
}

/* A state is the number of steps and y; its bytes are the same. */
typedef struct { double y; int64_t steps; } State;

static Status save(void **state) {
    at("save");
    State *s = *state ? *state : malloc(sizeof *s);
    *s = (State){y, steps};
    *state = s;
    return (Status)status;
}
static Status restore(const void *state) {
    const State *s = state;
    at("restore");
    y = s->y, steps = (int)s->steps;
    return (Status)status;
}
static Status forget(void **state) {
    free(*state);
    *state = NULL;
    return OK;
}
static Status size_of(size_t *n) {
    at("size");
    *n = strcmp(deed, "huge") == 0 && strcmp(phase, "size") == 0 ? (size_t)1 << 60 : sizeof(State);
    return (Status)status;
}
static Status serialize(const void *state, void *bytes) {
    at("serialize");
    memcpy(bytes, state, sizeof(State));
    return (Status)status;
}
static Status deserialize(const void *bytes, size_t n, void **state) {
    at("deserialize");
    if (n != sizeof(State)) return (Status)3;
    *state = malloc(n);
    memcpy(*state, bytes, n);
    return (Status)status;
}
#if FMI == 2
#define STATES(f) fmi2##f##FMUstate
Status fmi2SerializedFMUstateSize(Instance i, void *s, size_t *n) { return (void)i, (void)s, size_of(n); }
Status fmi2DeSerializeFMUstate(Instance i, const char *b, size_t n, void **s) { return (void)i, deserialize(b, n, s); }
Status fmi2SerializeFMUstate(Instance i, void *s, char *b, size_t n) { return (void)i, (void)n, serialize(s, b); }
#else
#define STATES(f) fmi3##f##FMUState
Status fmi3SerializedFMUStateSize(Instance i, void *s, size_t *n) { return (void)i, (void)s, size_of(n); }
Status fmi3DeserializeFMUState(Instance i, const uint8_t *b, size_t n, void **s) {
    return (void)i, deserialize(b, n, s);
}
Status fmi3SerializeFMUState(Instance i, void *s, uint8_t *b, size_t n) { return (void)i, (void)n, serialize(s, b); }
#endif
Status STATES(Get)(Instance i, void **s) { return (void)i, save(s); }
Status STATES(Set)(Instance i, void *s) { return (void)i, restore(s); }
Status STATES(Free)(Instance i, void **s) { return (void)i, forget(s); }

#if FMI == 2
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
Instance fmi2Instantiate(
    const char *n, fmi2Type t, const char *g, const char *r, const fmi2CallbackFunctions *c, int v, int l) {
    (void)n, (void)t, (void)g, (void)r, (void)v, (void)l;
    callbacks = c;
    return made();
}
Status fmi2SetupExperiment(Instance i, int d, double t, double a, int e, double b) {
    (void)i, (void)d, (void)t, (void)a, (void)e, (void)b;
    at("setup");
    return (Status)status;
}
PLAIN(EnterInitializationMode, "enter")
Status fmi2SetReal(Instance i, const unsigned *r, size_t n, const double *v) {
    return (void)i, (void)r, n ? set(v) : OK;
}
Status fmi2GetReal(Instance i, const unsigned *r, size_t n, double *v) { return (void)i, (void)r, n ? get(v) : OK; }
Status fmi2DoStep(Instance i, double t, double h, int p) {
    (void)i, (void)t, (void)p;
    step(h);
    return (Status)status;
}
#else
const char *fmi3GetVersion(void) { return "3.0"; }
Instance fmi3InstantiateCoSimulation(const char *n, const char *g, const char *r, bool v, bool l, bool e, bool early,
    const unsigned *q, size_t m, void *env, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback up) {
    (void)n, (void)g, (void)r, (void)v, (void)l, (void)e, (void)early, (void)q, (void)m, (void)env, (void)up;
    message = log;
    return made();
}
Status fmi3EnterInitializationMode(Instance i, bool d, double t, double a, bool e, double b) {
    (void)i, (void)d, (void)t, (void)a, (void)e, (void)b;
    at("enter");
    return (Status)status;
}
Status fmi3SetFloat64(Instance i, const unsigned *r, size_t n, const double *v, size_t m) {
    return (void)i, (void)r, (void)m, n ? set(v) : OK;
}
Status fmi3GetFloat64(Instance i, const unsigned *r, size_t n, double *v, size_t m) {
    return (void)i, (void)r, (void)m, n ? get(v) : OK;
}
Status fmi3DoStep(Instance i, double t, double h, bool p, bool *a, bool *b, bool *c, double *last) {
    (void)i, (void)p;
    *a = *b = *c = false;
    *last = t + h;
    step(h);
    return (Status)status;
}
#endif
