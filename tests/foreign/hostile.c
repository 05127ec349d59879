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
#include <stdio.h>
#include <unistd.h>

#include "../fmi_names.h"

static char phase[32], deed[32];
static double u, y, bad;
static int steps, status, faulty_step = 10;
static bool slow;
static Logger log_;

static void say(const char *text) {
    FMI2_OR_3(log_->logger(log_->componentEnvironment, "hostile", fmi2Warning, "deeds", "%s", text),
        log_(NULL, fmi3Warning, "deeds", text));
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
    if (IS(hang)) {
        const char *proof = getenv("HOSTILE_PROOF");
        FILE *file = proof ? fopen(proof, "w") : NULL;
        if (file) fclose(file);
        for (volatile int i = 0;; i++) {}
    }
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
    if (IS(traps)) feenableexcept(FE_DIVBYZERO);
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
    status = F(OK);
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
    return status == F(OK) ? &instance : NULL;
}

static void step(double h) {
    steps++;
    if (slow) usleep(1000);
    y += 1 + h * u;
    at("step");
    y += bad;
}

static Status passed(const char *now) {
    at(now);
    return (Status)status;
}
static Status set(double value) {
    u = value;
    return passed("set");
}
static Status get(double *value) {
    at("get");
    *value = y + bad;
    return (Status)status;
}

INSTANTIATE((log_ = logger, made()))
void F(FreeInstance)(Instance c) { at("free"); }
SETUP(passed("setup"), passed("enter"))
Status F(ExitInitializationMode)(Instance c) { return passed("exit"); }
Status F(Terminate)(Instance c) { return passed("terminate"); }
Status F(Reset)(Instance c) {
    y = u = bad = 0;
    steps = 0;
    return passed("reset");
}
ACCESS(REAL, double, return n ? get(value) : F(OK), return n ? set(*value) : F(OK))
DO_STEP((step(h), (Status)status))

/* A state is the number of steps and y; its bytes are the same. */
typedef struct { double y; int64_t steps; } State;

Status STATE(Get, )(Instance c, Saved *state) {
    at("save");
    State *s = *state ? *state : malloc(sizeof *s);
    *s = (State){y, steps};
    *state = s;
    return (Status)status;
}
Status STATE(Set, )(Instance c, Saved state) {
    const State *s = state;
    at("restore");
    y = s->y, steps = (int)s->steps;
    return (Status)status;
}
Status STATE(Free, )(Instance c, Saved *state) { return free(*state), *state = NULL, F(OK); }
Status STATE(Serialized, Size)(Instance c, Saved state, size_t *n) {
    at("size");
    *n = strcmp(deed, "huge") == 0 && strcmp(phase, "size") == 0 ? (size_t)1 << 60 : sizeof(State);
    return (Status)status;
}
Status STATE(Serialize, )(Instance c, Saved state, Byte bytes[], size_t n) {
    at("serialize");
    memcpy(bytes, state, sizeof(State));
    return (Status)status;
}
Status DESERIALIZE(Instance c, const Byte bytes[], size_t n, Saved *state) {
    at("deserialize");
    if (n != sizeof(State)) return F(Error);
    *state = malloc(n);
    memcpy(*state, bytes, n);
    return (Status)status;
}
