/* The process of one isolated FMU: loads its library and does, one after the other, the calls that the master hands
 * over.
 *
 *     worker SOCKET MEMORY SIZE LIMIT PARENT
 *
 * SOCKET and MEMORY are inherited file descriptors (MEMORY -1: everything travels through the socket), SIZE the bytes
 * of the region, LIMIT the bytes that the FMU may allocate (0: any), PARENT the process without which this one ends. It
 * forks at once: the first process watches the second one (launcher.c). */
#include "shared.h"

#include "environment.h"
#include "integrator.h"
#include "intermediate.h"
#include "launcher.h"

#include <dlfcn.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>

enum { SPIN_NS = 100000, LARGEST_SUCCESS = LINK_WARNING, SAMPLE = 1 << 22 };

typedef struct { void *logger, *allocate, *release, *finished, *environment; } Callbacks2;

typedef struct {
    uint32_t type, n_references;
    uint64_t n_values;
    uint32_t *references;
} Planned;

static Region region;
static bool shared;
static int bell, version;
static pid_t parent;
static rlim_t limit;
static void *library, *instance;
static void *setters[LINK_TYPES], *getters[LINK_TYPES], *do_step;
static Planned plan[LINK_PLANNED];
static int n_plan;
static Integrator *integrator;   /* of a Model Exchange FMU */
static IntermediateUpdate update; /* of the present step */
static char *blob;
static size_t blob_size;

/* ------------------------------------------------------------------ the FMU's surroundings */

static uint32_t expected;

static void restore_environment(void) {
    if (environment_differs(expected)) region.answer->environment |= (uint8_t)environment_restore(expected);
}

/* Whether nothing more can be allocated. Also called where a signal has ended the FMU. */
static bool no_memory(void) {
    if (!limit) return false;
    void *p = mmap(NULL, SAMPLE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) return true;
    munmap(p, SAMPLE);
    return false;
}

static void dying(int number) {
    if (shared) region.answer->no_memory = no_memory();
    signal(number, SIG_DFL);
    raise(number);
}

static void catch_signals(void) {
    static char stack[1 << 16];
    const stack_t own = {.ss_sp = stack, .ss_size = sizeof stack};
    struct sigaction act = {.sa_handler = dying, .sa_flags = SA_ONSTACK | SA_NODEFER | SA_RESETHAND};
    sigaltstack(&own, NULL);
    sigaction(SIGSEGV, &act, NULL);
    sigaction(SIGBUS, &act, NULL);
    sigaction(SIGABRT, &act, NULL);
    signal(SIGINT, SIG_IGN); /* Ctrl-C is the master's */
    signal(SIGPIPE, SIG_IGN);
}

static rlim_t used_memory(void) {
    rlim_t pages = 0;
#if defined(__linux__)
    FILE *file = fopen("/proc/self/statm", "r"); /* size resident shared text lib data */
    if (file) {
        unsigned long long data = 0;
        if (fscanf(file, "%*u %*u %*u %*u %*u %llu", &data) == 1) pages = (rlim_t)data;
        fclose(file);
    }
#endif
    return pages * (rlim_t)sysconf(_SC_PAGESIZE);
}

static void limit_memory(void) {
    if (!limit) return;
    const rlim_t most = used_memory() + limit;
    const struct rlimit r = {most, most};
    setrlimit(RLIMIT_DATA, &r);
#if !defined(__linux__)
    setrlimit(RLIMIT_AS, &r);
#endif
}

/* Ends the process when the master is gone, whatever the FMU does meanwhile. */
static void *watch(void *nothing) {
    for (;;) {
        struct pollfd gone = {bell, 0, 0};
        if (poll(&gone, 1, 500) > 0 || getppid() != parent) break;
    }
    kill(0, SIGKILL); /* with all that the FMU has started */
    return nothing;
}

/* ------------------------------------------------------------------ messages */

static void say(int status, const char *category, const char *text) {
    Answer *h = region.answer;
    const size_t first = strnlen(category, 255), second = strnlen(text, 8191), need = 4 + first + 1 + second + 1;
    if (need > LINK_LOG - h->log_used) {
        h->log_lost++;
        return;
    }
    char *p = region.log + h->log_used;
    memcpy(p, &(int32_t){status}, 4);
    memcpy(p + 4, category, first);
    p[4 + first] = 0;
    memcpy(p + 4 + first + 1, text, second);
    p[need - 1] = 0;
    h->log_used += (uint32_t)need;
}

static void say2(void *environment, const char *name, int status, const char *category, const char *format, ...) {
    static char text[8192];
    va_list arguments;
    (void)environment, (void)name;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format ? format : "", arguments);
    va_end(arguments);
    say(status, category ? category : "", text);
}

static void say3(void *environment, int status, const char *category, const char *text) {
    (void)environment;
    say(status, category ? category : "", text ? text : "");
}

/* ------------------------------------------------------------------ loading */

static void *function(const char *name) {
    char full[80];
    snprintf(full, sizeof full, "fmi%d%s", version, name);
    return dlsym(library, full);
}

static void find_values(void) {
    static const char *names[LINK_TYPES] = {"Real", "Integer", "Boolean", "String", "Float64", "Float32", "Int8",
        "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String", "Binary", "Clock"};
    for (int i = version == 2 ? LINK_Real : LINK_Float64; i < (version == 2 ? LINK_Float64 : LINK_TYPES); i++) {
        char full[40];
        snprintf(full, sizeof full, "Set%s", names[i]);
        setters[i] = function(full);
        snprintf(full, sizeof full, "Get%s", names[i]);
        getters[i] = function(full);
    }
    do_step = function("DoStep");
}

/* The library, then the names that must be in it, all with their ends. */
static uint32_t load(void) {
    const char *path = region.request, *names = path + strlen(path) + 1;
    version = (int)region.ask->a;
    limit_memory();
    library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    const char *said = library ? "" : dlerror(), *python = getenv("SUSPENSION_FMUS_LIBPYTHON");
    if (!library && python && (strstr(said, "symbol: Py") || strstr(said, "symbol: _Py")) &&
        dlopen(python, RTLD_NOW | RTLD_GLOBAL)) {
        library = dlopen(path, RTLD_NOW | RTLD_LOCAL); /* those of PythonFMU expect it in the process */
        if (!library) said = dlerror();
    }
    if (!library) {
        snprintf(region.reply, 4096, "%s", said);
        region.answer->reply_used = (uint32_t)strlen(region.reply) + 1;
        return LINK_ERROR;
    }
    char *out = region.reply;
    for (const char *p = names; *p;) { /* separated by blanks */
        char name[80];
        const size_t n = strcspn(p, " ");
        snprintf(name, sizeof name, "%.*s", (int)n, p);
        if (!dlsym(library, name)) out += snprintf(out, sizeof name + 1, "%s ", name);
        p += n + strspn(p + n, " ");
    }
    *out = 0;
    region.answer->reply_used = (uint32_t)(out - region.reply) + 1;
    find_values();
    environment_restore(expected); /* some libraries change it when they are loaded: -ffast-math does */
    return LINK_OK;
}

static uint32_t instantiate(void) {
    const char *name = region.request, *token = name + strlen(name) + 1, *resources = token + strlen(token) + 1;
    const bool exchange = region.ask->a != 0;
    void *make = function(version == 2   ? "Instantiate"
                          : exchange ? "InstantiateModelExchange"
                                     : "InstantiateCoSimulation");
    if (!make) return LINK_ERROR;
    if (version == 2) {
        static Callbacks2 callbacks;
        callbacks = (Callbacks2){(void *)say2, (void *)calloc, (void *)free, NULL, NULL};
        instance = ((void *(*)(const char *, int, const char *, const char *, const Callbacks2 *, int, int))make)(
            name, !exchange, token, resources, &callbacks, 0, 1);
    } else if (exchange) {
        instance = ((void *(*)(const char *, const char *, const char *, bool, bool, void *, void *))make)(
            name, token, resources, false, true, NULL, (void *)say3);
    } else {
        const size_t n = (size_t)(region.ask->b >> 2), used = (size_t)(resources + strlen(resources) + 1 - name);
        instance = ((void *(*)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *,
            size_t, void *, void *, void *))make)(
            name, token, resources, false, true, (region.ask->b & 1) != 0, (region.ask->b & 2) != 0,
            n ? (const uint32_t *)(const void *)(region.request + ALIGNED(used)) : NULL, n, &update, (void *)say3,
            n ? (void *)intermediate_update : NULL);
    }
    return instance ? LINK_OK : LINK_ERROR;
}

/* ------------------------------------------------------------------ values */

static char *after(const LinkValues *v, size_t bytes) {
    return (char *)(v + 1) + ALIGNED((size_t)v->n_references * 4) + ALIGNED(bytes);
}

static uint32_t call_values(
    uint32_t type, void *call, const uint32_t *references, size_t n, void *values, size_t n_values) {
    if (version == 2 || type == LINK_Clock)
        return ((uint32_t (*)(void *, const uint32_t *, size_t, void *))call)(instance, references, n, values);
    return ((uint32_t (*)(void *, const uint32_t *, size_t, void *, size_t))call)(
        instance, references, n, values, n_values);
}

static bool text(uint32_t type) { return type == LINK_String2 || type == LINK_String3; }

typedef uint32_t (*Binaries)(void *, const uint32_t *, size_t, size_t *, const uint8_t **, size_t);

static uint32_t set_binaries(const LinkValues *v, const char *values, const char **at) {
    size_t *sizes = calloc(v->n_values + 1, sizeof *sizes);
    const uint8_t **bytes = calloc(v->n_values + 1, sizeof *bytes);
    const char *p = values + v->n_values * 8;
    for (size_t i = 0; sizes && bytes && i < v->n_values; p += sizes[i++]) {
        uint64_t size;
        memcpy(&size, values + i * 8, 8);
        sizes[i] = (size_t)size, bytes[i] = (const uint8_t *)p;
    }
    *at = values + ALIGNED(p - values);
    const uint32_t status = sizes && bytes && setters[v->type]
        ? ((Binaries)setters[v->type])(instance, (const uint32_t *)(v + 1), v->n_references, sizes, bytes, v->n_values)
        : LINK_ERROR;
    free(sizes), free(bytes);
    return status;
}

static uint32_t get_binaries(const LinkValues *v) {
    size_t *sizes = calloc(v->n_values + 1, sizeof *sizes), used = v->n_values * 8;
    const uint8_t **bytes = calloc(v->n_values + 1, sizeof *bytes);
    uint32_t status = sizes && bytes && used <= region.area
        ? ((Binaries)getters[v->type])(instance, (const uint32_t *)(v + 1), v->n_references, sizes, bytes, v->n_values)
        : LINK_ERROR;
    for (size_t i = 0; status <= LARGEST_SUCCESS && i < v->n_values; used += sizes[i++]) {
        if (sizes[i] > region.area - used) {
            status = LINK_ERROR;
            break;
        }
        memcpy(region.reply + i * 8, &(uint64_t){sizes[i]}, 8);
        if (sizes[i]) memcpy(region.reply + used, bytes[i], sizes[i]);
    }
    region.answer->reply_used = status <= LARGEST_SUCCESS ? (uint32_t)used : 0;
    free(sizes), free(bytes);
    return status;
}

/* Sets what a record says, and moves on to the next one. */
static uint32_t set_record(const char **at) {
    const LinkValues *v = (const LinkValues *)(const void *)*at;
    char *values = after(v, 0);
    if (v->type == LINK_Binary) return set_binaries(v, values, at);
    if (!text(v->type)) {
        *at = values + ALIGNED(v->n_values * value_size(v->type));
        return setters[v->type]
                   ? call_values(
                         v->type, setters[v->type], (uint32_t *)(void *)(v + 1), v->n_references, values, v->n_values)
                   : LINK_ERROR;
    }
    const char **texts = calloc(v->n_values + 1, sizeof *texts);
    if (!texts || !setters[v->type]) return free(texts), LINK_ERROR;
    char *p = values;
    for (size_t i = 0; i < v->n_values; i++) texts[i] = p, p += strlen(p) + 1;
    *at = values + ALIGNED(p - values);
    const uint32_t status =
        call_values(v->type, setters[v->type], (uint32_t *)(void *)(v + 1), v->n_references, texts, v->n_values);
    free(texts);
    return status;
}

static uint32_t get_record(const char *at) {
    const LinkValues *v = (const LinkValues *)(const void *)at;
    uint32_t *references = (uint32_t *)(void *)(v + 1);
    if (!getters[v->type]) return LINK_ERROR;
    if (v->type == LINK_Binary) return get_binaries(v);
    if (!text(v->type)) {
        region.answer->reply_used = (uint32_t)(v->n_values * value_size(v->type));
        return call_values(v->type, getters[v->type], references, v->n_references, region.reply, v->n_values);
    }
    const char **texts = calloc(v->n_values + 1, sizeof *texts);
    if (!texts) return LINK_ERROR;
    const uint32_t status =
        call_values(v->type, getters[v->type], references, v->n_references, texts, v->n_values);
    size_t used = 0;
    for (size_t i = 0; status <= LARGEST_SUCCESS && i < v->n_values; i++) {
        const char *found = texts[i] ? texts[i] : "";
        const size_t n = strnlen(found, region.area - used);
        if (n == region.area - used) break;
        memcpy(region.reply + used, found, n);
        region.reply[used + n] = 0;
        used += n + 1;
    }
    region.answer->reply_used = (uint32_t)used;
    free(texts);
    return status;
}

static uint32_t learn(const char *at) {
    for (int i = 0; i < n_plan; i++) free(plan[i].references);
    n_plan = 0;
    for (uint64_t i = 0; i < region.ask->a && i < LINK_PLANNED; i++) {
        const LinkValues *v = (const LinkValues *)(const void *)at;
        uint32_t *references = malloc(v->n_references * 4 + 4);
        if (!references) return LINK_ERROR;
        memcpy(references, v + 1, (size_t)v->n_references * 4);
        plan[n_plan++] = (Planned){v->type, v->n_references, v->n_values, references};
        at = after(v, 0);
    }
    return LINK_OK;
}

/* Inputs that follow: as the master says. */
static void follow(const char *at, bool stepping) {
    const LinkValues *v = (const LinkValues *)(const void *)at;
    update.stepping = stepping && region.ask->b;
    if (update.stepping) {
        update = (IntermediateUpdate){.instance = instance,
            .set = (EngineValues3)setters[LINK_Float64],
            .references = (const uint32_t *)(v + 1),
            .n_references = v->n_references,
            .n = (uint32_t)((v->n_values - 2) / 3),
            .begins = region.ask->b >> 1 & 1,
            .line = (double *)(void *)after(v, 0)};
        intermediate_begin(&update);
    } else if (region.ask->b) memcpy(region.reply, &update.report, region.answer->reply_used = sizeof update.report);
}

static uint32_t step(const char *rest) {
    Answer *h = region.answer;
    const double t = region.ask->t, length = region.ask->h;
    const bool prior = region.ask->a != 0;
    uint32_t status;
    memset(h->flags, 0, sizeof h->flags);
    h->last = t;
    follow(rest, true);
    if (integrator) {
        status = integrator_step2(integrator, t, length, prior);
        h->last = integrator->memory.time;
    } else if (version == 2) {
        status = ((uint32_t(*)(void *, double, double, int))do_step)(instance, t, length, prior);
    } else {
        bool event = false, terminate = false, early = false;
        double last = t;
        status = ((uint32_t (*)(void *, double, double, bool, bool *, bool *, bool *, double *))do_step)(
            instance, t, length, prior, &event, &terminate, &early, &last);
        h->flags[0] = event, h->flags[2] = terminate, h->flags[3] = early;
        h->last = last;
    }
    follow(rest, false);
    if (update.report.end && status <= LARGEST_SUCCESS) return LINK_ERROR;
    if (status > LARGEST_SUCCESS) return status;
    char *p = region.results;
    for (int i = 0; i < n_plan; i++) {
        const Planned *g = &plan[i];
        h->failed = LINK_FETCHING + (uint32_t)i;
        const uint32_t one =
            call_values(g->type, getters[g->type], g->references, g->n_references, p + 8, g->n_values);
        memcpy(p, &one, 4);
        p += 8 + ALIGNED(g->n_values * value_size(g->type));
    }
    h->results_used = (uint32_t)(p - region.results);
    h->failed = 0;
    return status;
}

/* ------------------------------------------------------------------ the calls */

#define CALL(name, parameters, arguments)                               \
    do {                                                                \
        void *const f_ = function(name);                                \
        return f_ ? ((uint32_t(*) parameters)f_)arguments : LINK_ERROR; \
    } while (0)
#define NAMED(two, three) (version == 2 ? (two) : (three))

static uint32_t enter(const double *given) {
    const int has_tolerance = given[0] != 0, has_stop = given[3] != 0;
    if (version == 2)
        CALL("SetupExperiment", (void *, int, double, double, int, double),
            (instance, has_tolerance, given[1], given[2], has_stop, given[4]));
    CALL("EnterInitializationMode", (void *, bool, double, double, bool, double),
        (instance, has_tolerance, given[1], given[2], has_stop, given[4]));
}

static uint32_t free_instance(void) {
    void *f = function("FreeInstance");
    if (f && instance) ((void (*)(void *))f)(instance);
    instance = NULL;
    return LINK_OK;
}

static uint32_t a_state(const char *name, bool by_address) {
    void *state = (void *)(uintptr_t)region.ask->a;
    void *f = function(name);
    if (!f) return LINK_ERROR;
    const uint32_t status = by_address ? ((uint32_t (*)(void *, void **))f)(instance, &state)
                                       : ((uint32_t (*)(void *, void *))f)(instance, state);
    region.answer->value = (uint64_t)(uintptr_t)state;
    return status;
}

static uint32_t state_size(void) {
    size_t size = 0;
    void *f = function(NAMED("SerializedFMUstateSize", "SerializedFMUStateSize"));
    if (!f) return LINK_ERROR;
    const uint32_t status =
        ((uint32_t (*)(void *, void *, size_t *))f)(instance, (void *)(uintptr_t)region.ask->a, &size);
    region.answer->value = size;
    return status;
}

static bool room(size_t size) {
    if (size <= blob_size) return true;
    char *bigger = realloc(blob, size);
    if (!bigger) return false;
    blob = bigger;
    blob_size = size;
    return true;
}

static uint32_t serialize(void) {
    if (!room(region.ask->b)) return say(LINK_ERROR, "", "no memory for its serialized state"), LINK_ERROR;
    CALL(NAMED("SerializeFMUstate", "SerializeFMUState"), (void *, void *, char *, size_t),
        (instance, (void *)(uintptr_t)region.ask->a, blob, region.ask->b));
}

static uint32_t deserialize(void) {
    void *state = NULL, *f = function(NAMED("DeSerializeFMUstate", "DeserializeFMUState"));
    if (!f || !room(region.ask->b)) return LINK_ERROR;
    const uint32_t status =
        ((uint32_t (*)(void *, const char *, size_t, void **))f)(instance, blob, region.ask->b, &state);
    region.answer->value = (uint64_t)(uintptr_t)state;
    return status;
}

static uint32_t derivative(void) {
    const LinkValues *by = (const LinkValues *)(const void *)region.request;
    const double *seed = (const double *)(const void *)after(by, 0);
    const LinkValues *of = (const LinkValues *)(const void *)after(by, by->n_values * 8);
    double *result = (double *)(void *)region.reply;
    region.answer->reply_used = (uint32_t)(of->n_values * 8);
    const uint32_t *r_of = (const uint32_t *)(of + 1), *r_by = (const uint32_t *)(by + 1);
    if (version == 2)
        CALL("GetDirectionalDerivative",
            (void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, double *),
            (instance, r_of, of->n_references, r_by, by->n_references, seed, result));
    CALL("GetDirectionalDerivative",
        (void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, size_t, double *, size_t),
        (instance, r_of, of->n_references, r_by, by->n_references, seed, by->n_values, result, of->n_values));
}

/* An integrator for the instance, at the end of its initialization. */
static uint32_t integrate(void) {
    IntegratorSetup setup;
    if (region.ask->used < sizeof setup) return LINK_ERROR;
    memcpy(&setup, region.request, sizeof setup);
    const size_t size = integrator_size(&setup);
    if (!size || region.ask->used < sizeof setup + 8 * (size_t)setup.n_references) return LINK_ERROR;
    void *memory = realloc(integrator, size), *calls[INTEGRATOR_FUNCTIONS];
    if (!memory) return say(LINK_ERROR, "", "no memory for its integrator"), LINK_ERROR;
    for (uint32_t i = 0; i < INTEGRATOR_FUNCTIONS; i++) {
        const char *const name = integrator_function(setup.version, i);
        calls[i] = name ? function(name) : NULL;
    }
    integrator = integrator_make(
        memory, &setup, (const uint32_t *)(const void *)(region.request + sizeof setup), instance, calls);
    return integrator_begin(integrator, region.ask->t);
}

/* What the integrator remembers is replaced, or told together with its report. */
static uint32_t remember(void) {
    if (!integrator) return LINK_ERROR;
    if (region.ask->a) return memcpy(&integrator->memory, region.request, sizeof integrator->memory), LINK_OK;
    memcpy(region.reply, &integrator->memory, sizeof integrator->memory);
    memcpy(region.reply + sizeof integrator->memory, &integrator->report, sizeof integrator->report);
    region.answer->reply_used = (uint32_t)(sizeof integrator->memory + sizeof integrator->report);
    return LINK_OK;
}

static uint32_t tell_status(void) {
    const int kind = (int)region.ask->a;
    int yes = 0;
    uint32_t status;
    void *f = function(region.ask->b ? "GetBooleanStatus" : "GetRealStatus");
    if (!f) return LINK_ERROR;
    if (region.ask->b) status = ((uint32_t(*)(void *, int, int *))f)(instance, kind, &yes);
    else status = ((uint32_t(*)(void *, int, double *))f)(instance, kind, &region.answer->last);
    region.answer->value = yes != 0;
    return status;
}

static uint32_t plain(const char *name) { CALL(name, (void *), (instance)); }

/* Event mode: 0 enter, 1 leave, 2 update discrete states. Configuration mode: 3 enter, 4 leave. */
static uint32_t events(void) {
    static const char *names[] = {
        "EnterEventMode", "EnterStepMode", "", "EnterConfigurationMode", "ExitConfigurationMode"};
    if (region.ask->a != 2) return region.ask->a < 5 ? plain(names[region.ask->a]) : LINK_ERROR;
    bool flags[5] = {false};
    double next = 0.0;
    void *f = function("UpdateDiscreteStates");
    if (!f) return LINK_ERROR;
    const uint32_t status = ((uint32_t (*)(void *, bool *, bool *, bool *, bool *, bool *, double *))f)(
        instance, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next);
    region.answer->value = 0;
    for (int i = 0; i < 5; i++) region.answer->value |= (uint64_t)flags[i] << i;
    region.answer->last = next;
    return status;
}

/* Interval (a: 0, as a fraction 1) or shift (2, 3) of the clock b. */
static uint32_t interval(void) {
    static const char *names[] = {"GetIntervalDecimal", "GetIntervalFraction", "GetShiftDecimal", "GetShiftFraction"};
    LinkInterval *const x = (LinkInterval *)(void *)region.reply;
    const uint32_t clock = (uint32_t)region.ask->b;
    *x = (LinkInterval){.resolution = 1, .qualifier = 1};
    region.answer->reply_used = sizeof *x;
    switch (region.ask->a) {
        case 0: CALL(names[0], (void *, const uint32_t *, size_t, double *, int32_t *),
            (instance, &clock, 1, &x->seconds, &x->qualifier));
        case 1: CALL(names[1], (void *, const uint32_t *, size_t, uint64_t *, uint64_t *, int32_t *),
            (instance, &clock, 1, &x->counter, &x->resolution, &x->qualifier));
        case 2: CALL(names[2], (void *, const uint32_t *, size_t, double *), (instance, &clock, 1, &x->seconds));
        case 3: CALL(names[3], (void *, const uint32_t *, size_t, uint64_t *, uint64_t *),
            (instance, &clock, 1, &x->counter, &x->resolution));
    }
    return LINK_ERROR;
}

static uint32_t dispatch(const char *rest) {
    switch ((LinkOp)region.ask->op) {
        case LINK_LOAD: return load();
        case LINK_INSTANTIATE: return instantiate();
        case LINK_FREE: return free_instance();
        case LINK_SETUP: return enter((const double *)(const void *)rest);
        case LINK_ENTER:
            return version == 2 ? plain("EnterInitializationMode") : enter((const double *)(const void *)rest);
        case LINK_EXIT: return plain("ExitInitializationMode");
        case LINK_TERMINATE: return plain("Terminate");
        case LINK_RESET: n_plan = 0; return plain("Reset");
        case LINK_SET: return LINK_OK; /* all that was to be set is */
        case LINK_GET: return get_record(rest);
        case LINK_PLAN: return learn(rest);
        case LINK_STEP: return step(rest);
        case LINK_STATUS: return tell_status();
        case LINK_GET_STATE: return a_state(NAMED("GetFMUstate", "GetFMUState"), true);
        case LINK_SET_STATE: return a_state(NAMED("SetFMUstate", "SetFMUState"), false);
        case LINK_FREE_STATE: return a_state(NAMED("FreeFMUstate", "FreeFMUState"), true);
        case LINK_STATE_SIZE: return state_size();
        case LINK_SERIALIZE: return serialize();
        case LINK_DESERIALIZE: return deserialize();
        case LINK_READ_BYTES:
            memcpy(region.reply, blob + region.ask->a, region.ask->b);
            region.answer->reply_used = (uint32_t)region.ask->b;
            return LINK_OK;
        case LINK_WRITE_BYTES:
            if (!room(region.ask->b)) return LINK_ERROR;
            memcpy(blob + region.ask->a, region.request, region.ask->used);
            return LINK_OK;
        case LINK_DERIVATIVE: return derivative();
        case LINK_INTEGRATE: return integrate();
        case LINK_INTEGRATOR: return remember();
        case LINK_EVENTS: return events();
        case LINK_INTERVAL: return interval();
    }
    return LINK_ERROR;
}

static void work(void) {
    Answer *h = region.answer;
    const char *at = region.request;
    uint32_t status = LINK_OK;
    const uint32_t n_sets = region.ask->n_sets;
    h->reply_used = h->results_used = h->log_used = h->log_lost = 0;
    h->environment = h->no_memory = 0;
    for (uint32_t i = 0; i < n_sets && status <= LARGEST_SUCCESS; i++) {
        h->failed = i + 1; /* before it is done: it may be the last thing that is */
        status = set_record(&at);
    }
    if (status <= LARGEST_SUCCESS) {
        h->failed = 0;
        status = dispatch(at);
    }
    h->status = status;
    restore_environment();
    if (status > LARGEST_SUCCESS) h->no_memory = no_memory();
}

/* ------------------------------------------------------------------ the loop */

static bool read_all(void *to, size_t n) {
    for (char *p = to; n > 0;) {
        const ssize_t done = read(bell, p, n);
        if (done == 0 || (done < 0 && errno != EINTR)) return false;
        if (done > 0) p += done, n -= (size_t)done;
    }
    return true;
}

static bool write_all(const void *bytes, size_t n) {
    for (const char *p = bytes; n > 0;) {
        const ssize_t done = write(bell, p, n);
        if (done < 0 && errno != EINTR) return false;
        if (done > 0) p += done, n -= (size_t)done;
    }
    return true;
}

static void serve_memory(int64_t spin_ns) {
    Ask *ask = region.ask;
    for (uint32_t seen = 0;;) {
        if (!spin(&ask->number, seen, spin_ns)) {
            atomic_store(&ask->worker_waits, 1);
            while (atomic_load(&ask->number) == seen) {
                char rung[64];
                if (read(bell, rung, sizeof rung) == 0) return;
            }
            atomic_store(&ask->worker_waits, 0);
        }
        __builtin_prefetch(region.request); /* another line of the cache, which is on its way while this one is read */
        seen = atomic_load(&ask->number);
        work();
        atomic_fetch_add(&region.answer->number, 1);
        if (atomic_load(&region.answer->master_waits) && !ring(bell)) return;
    }
}

static void serve_socket(void) {
    const Answer *a = region.answer;
    while (
        read_all(region.ask, HEADER) && region.ask->used <= region.area && read_all(region.request, region.ask->used)) {
        work();
        if (!write_all(a, HEADER + a->results_used) || !write_all(region.reply, a->reply_used) ||
            !write_all(region.log, a->log_used))
            return;
    }
}

int main(int n, char **argument) {
    if (n != 6) return 2;
    bell = atoi(argument[1]);
    const int memory = atoi(argument[2]);
    const size_t size = strtoull(argument[3], NULL, 10);
    limit = (rlim_t)strtoull(argument[4], NULL, 10);
    parent = launch_worker((pid_t)atoi(argument[5]), (const int[]){bell, memory}, memory >= 0 ? 2 : 1);
    shared = memory >= 0;
    void *p = mmap(NULL, size, PROT_READ | PROT_WRITE, shared ? MAP_SHARED : MAP_PRIVATE | MAP_ANONYMOUS, memory, 0);
    if (p == MAP_FAILED || !region_of(&region, p, size)) return 2;
    if (shared) close(memory);
    setvbuf(stdout, NULL, _IOLBF, 0); /* what the FMU prints is there when it crashes */
    expected = environment_bits();
    catch_signals();
    pthread_t watcher;
    pthread_attr_t small;
    pthread_attr_init(&small);
    pthread_attr_setstacksize(&small, 1 << 16);
    if (pthread_create(&watcher, &small, watch, NULL)) return 2;
    if (shared) serve_memory(sysconf(_SC_NPROCESSORS_ONLN) > 1 ? SPIN_NS : 0);
    else serve_socket();
    _exit(0); /* the FMU's destructors have nothing to say any more */
}
