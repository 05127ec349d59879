/* The FMI functions of an FMU that runs in another process: each hands its arguments over and waits for the answer.
 *
 * Their instance is the Link. Inputs that are set between steps wait for the step and travel with it, and the outputs
 * that were fetched after the last steps come back with it: one step is one exchange. Everything that comes from the
 * worker is validated: sizes are compared with the areas, and it is never waited for longer than the limit. No heap
 * after link_open. */
#include "shared.h"

#include "intermediate.h"

#include <stdlib.h>
#include <sys/types.h>
#include <sys/wait.h>

#pragma GCC visibility push(default)

enum { MOST_PLANNED_REFERENCES = 1 << 16, LOOK_NS = 50000000 }; /* how often it is seen whether the worker lives */

typedef void (*LinkLogger)(int status, const char *category, const char *text);

typedef struct {
    uint32_t type, n_references, status;
    uint64_t n_values;
    const uint32_t *references;
    size_t at; /* in the results */
    const char *name; /* of the function */
} Planned;

typedef struct {
    Region region;
    bool shared;
    int fd;
    pid_t pid;
    int64_t timeout_ns, spin_ns;
    int end;                    /* LinkEnd */
    int generation;             /* of processes: a forked one must not use what its parent uses */
    LinkLogger log;
    const char *failed;         /* function that really failed, if that is not the one that was called */
    uint32_t environment, no_memory;
    bool stepping;              /* from the first step on: calls may wait for the next step */
    size_t waiting;             /* bytes of the request area that wait for it */
    uint32_t n_waiting;
    const char *waiting_for[LINK_PLANNED];
    Planned plan[LINK_PLANNED];
    int n_plan, n_planned;      /* known to the worker */
    IntermediateUpdate *update; /* of the master, whose inputs follow inside a step; NULL: none */
    bool fresh;                 /* the results are those of the last step, and nothing was changed since */
    uint32_t *references;       /* of the plan */
    size_t n_plan_references;
    char *text;                 /* strings as they were read last */
    size_t text_room;
} Link;

static volatile int cancelled;
static int generation;

void link_forked(void) { generation++; }

/* No further call follows. */
void link_release(Link *l) {
    if (!l->end) l->end = LINK_RELEASED;
}

static bool lost(Link *l) {
    if (!l->end && l->generation != generation) l->end = LINK_INHERITED;
    return l->end != LINK_ALIVE;
}

void link_cancel(int yes) { cancelled = yes; }

Link *link_open(void *memory, size_t size, bool shared, int fd, int pid, double timeout, double spin_us) {
    Link *l = calloc(1, sizeof *l);
    if (!l || !region_of(&l->region, memory, size)) return free(l), NULL;
    l->shared = shared;
    l->generation = generation;
    l->fd = fd;
    l->pid = (pid_t)pid;
    l->timeout_ns = timeout > 0 && timeout < 1e9 ? (int64_t)(timeout * 1e9) : 0;
    l->spin_ns = (int64_t)(spin_us * 1e3);
    l->references = malloc(MOST_PLANNED_REFERENCES * sizeof *l->references);
    if (!l->references) return free(l), NULL;
    return l;
}

void link_close(Link *l) {
    if (!l) return;
    free(l->references);
    free(l->text);
    free(l);
}

int link_end(const Link *l) { return l->end; }
const char *link_failed(const Link *l) { return l->failed; }
uint32_t link_environment(const Link *l) { return l->environment; }
uint32_t link_no_memory(const Link *l) { return l->no_memory; }

/* ------------------------------------------------------------------ one call */

static bool dead(const Link *l) {
    siginfo_t info;
    info.si_pid = 0;
    return waitid(P_PID, (id_t)l->pid, &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid != 0;
}

static int64_t deadline_of(const Link *l) { return l->timeout_ns ? now_ns() + l->timeout_ns : 0; }

/* Wait until there is something to read (POLLIN), or space to write (POLLOUT). 0, or why not. */
static int wait_for(Link *l, short what, int64_t deadline) {
    for (;;) {
        int64_t left = LOOK_NS;
        if (deadline) {
            left = deadline - now_ns();
            if (left > LOOK_NS) left = LOOK_NS;
        }
        struct pollfd wait = {l->fd, what, 0};
        const int found = poll(&wait, 1, left <= 0 ? 0 : (int)((left + 999999) / 1000000));
        if (cancelled) return LINK_CANCELLED;
        if (found > 0) return wait.revents & what ? LINK_ALIVE : LINK_DIED;
        if (found == 0 && dead(l)) return LINK_DIED;
        if (found == 0 && left <= 0)
            return LINK_TOO_SLOW; /* looked at once more: this process may have been stopped itself */
    }
}

static int read_all(Link *l, void *to, size_t n, int64_t deadline) {
    for (char *p = to; n > 0;) {
        const int end = wait_for(l, POLLIN, deadline);
        if (end) return end;
        const ssize_t done = read(l->fd, p, n);
        if (done == 0 || (done < 0 && errno != EINTR && errno != EAGAIN)) return LINK_DIED;
        if (done > 0) {
            p += done;
            n -= (size_t)done;
        }
    }
    return LINK_ALIVE;
}

static int write_all(Link *l, const void *from, size_t n, int64_t deadline) {
    for (const char *p = from; n > 0;) {
        const ssize_t done = send(l->fd, p, n, MSG_DONTWAIT | MSG_NOSIGNAL);
        if (done < 0 && errno != EINTR && errno != EAGAIN) return LINK_DIED;
        if (done > 0) {
            p += done;
            n -= (size_t)done;
        } else {
            const int end = wait_for(l, POLLOUT, deadline);
            if (end) return end;
        }
    }
    return LINK_ALIVE;
}

static int answered(Link *l, uint32_t before) {
    Answer *h = l->region.answer;
    if (spin(&h->number, before, l->spin_ns)) {
        __builtin_prefetch(
            l->region.results); /* another line of the cache, which is on its way while this one is read */
        return LINK_ALIVE;
    }
    int end = LINK_ALIVE;
    const int64_t deadline = deadline_of(l);
    atomic_store(&h->master_waits, 1);
    while (!end && atomic_load(&h->number) == before) {
        char bell[64];
        end = wait_for(l, POLLIN, deadline);
        if (!end && read(l->fd, bell, sizeof bell) == 0) end = LINK_DIED;
    }
    atomic_store(&h->master_waits, 0);
    return atomic_load(&h->number) == before ? end : LINK_ALIVE; /* it may have answered before it died */
}

static int by_socket(Link *l) {
    const int64_t deadline = deadline_of(l);
    const Region *r = &l->region;
    int end = write_all(l, r->ask, HEADER + r->ask->used, deadline);
    if (!end) end = read_all(l, r->answer, HEADER, deadline);
    if (end) return end;
    const Answer a = *r->answer;
    if (a.log_used > LINK_LOG || a.reply_used > r->area || a.results_used > r->area) return LINK_LIED;
    if (!(end = read_all(l, r->results, a.results_used, deadline)) &&
        !(end = read_all(l, r->reply, a.reply_used, deadline)))
        end = read_all(l, r->log, a.log_used, deadline);
    return end;
}

static int by_memory(Link *l) {
    const uint32_t before = atomic_load_explicit(&l->region.answer->number, memory_order_relaxed);
    /* A full fence: the worker's flag is read after it. Both count the same calls; where they do not, the worker has
     * written there. */
    if (atomic_fetch_add(&l->region.ask->number, 1) != before) return LINK_LIED;
    if (atomic_load(&l->region.ask->worker_waits) && !ring(l->fd)) return LINK_DIED;
    const int end = answered(l, before);
    return !end && atomic_load(&l->region.answer->number) != before + 1 ? LINK_LIED : end;
}

static void hand_over_log(Link *l) {
    const Answer *h = l->region.answer;
    const char *p = l->region.log;
    size_t left = h->log_used;
    if (left > LINK_LOG) left = 0;
    static _Thread_local char category[256], text[8192];
    while (left > 4) { /* status, category and text, each with its end */
        int32_t status;
        memcpy(&status, p, 4);
        p += 4, left -= 4;
        const size_t first = strnlen(p, left);
        if (first == left) break;
        strncpy(category, p, sizeof category - 1);
        p += first + 1, left -= first + 1;
        const size_t second = strnlen(p, left);
        if (second == left) break;
        strncpy(text, p, sizeof text - 1);
        p += second + 1, left -= second + 1;
        if (l->log) l->log(status, category, text);
    }
    if (h->log_lost && l->log) l->log(LINK_WARNING, "", "more messages of this call were left out");
}

static uint32_t transact(Link *l, LinkOp op) {
    Ask *ask = l->region.ask;
    const Answer *h = l->region.answer;
    l->failed = NULL;
    if (lost(l)) return LINK_FATAL;
    ask->op = op;
    ask->used = l->waiting;
    ask->n_sets = l->n_waiting;
    const int end = l->shared ? by_memory(l) : by_socket(l);
    l->waiting = 0;
    const uint32_t n_sets = l->n_waiting, failed = h->failed;
    l->n_waiting = 0;
    l->no_memory = h->no_memory;
    if (failed && failed <= n_sets && failed <= LINK_PLANNED) l->failed = l->waiting_for[failed - 1];
    if (op == LINK_STEP && failed >= LINK_FETCHING && failed - LINK_FETCHING < (uint32_t)l->n_planned)
        l->failed = l->plan[failed - LINK_FETCHING].name;
    if (end) {
        l->end = end;
        if (l->shared) hand_over_log(l); /* its last words */
        return LINK_FATAL;
    }
    if (h->log_used || h->log_lost) hand_over_log(l);
    l->environment = h->environment;
    const uint32_t status = h->status;
    return l->environment && status <= LINK_WARNING ? LINK_ERROR : status;
}

static uint32_t simple(Link *l, LinkOp op) {
    l->fresh = false;
    return transact(l, op);
}

static uint32_t with(Link *l, LinkOp op, uint64_t a, uint64_t b) {
    l->region.ask->a = a;
    l->region.ask->b = b;
    return simple(l, op);
}

/* ------------------------------------------------------------------ values */

/* What waits is done first, by itself. */
#define FLUSH                                                  \
    if (lost(l)) return LINK_FATAL;                            \
    if (l->n_waiting) {                                        \
        const uint32_t flushed = simple(l, LINK_SET);          \
        if (flushed > LINK_WARNING) return flushed;            \
    }

/* A record at the end of the request; NULL: it does not fit. */
static char *record(Link *l, uint32_t type, const uint32_t *references, size_t n, uint64_t n_values, size_t bytes) {
    const size_t area = l->region.area, need = sizeof(LinkValues) + ALIGNED(n * 4) + ALIGNED(bytes);
    if (n > area / 4 || bytes > area || need > area - l->waiting) return NULL;
    char *p = l->region.request + l->waiting;
    const LinkValues head = {type, (uint32_t)n, n_values};
    memcpy(p, &head, sizeof head);
    memcpy(p + sizeof head, references, n * 4);
    l->waiting += need;
    return p + sizeof head + ALIGNED(n * 4);
}

static uint32_t too_much(Link *l) {
    l->failed = "(more values than an isolated FMU can be given in one call)";
    l->waiting = 0;
    l->n_waiting = 0;
    return LINK_ERROR;
}

static uint32_t set_values(Link *l, uint32_t type, const char *name, const uint32_t *references, size_t n,
    const void *values, size_t n_values) {
    if (lost(l)) return LINK_FATAL;
    if (l->n_waiting == LINK_PLANNED) { /* that many do not wait */
        const uint32_t status = simple(l, LINK_SET);
        if (status > LINK_WARNING) return status;
    }
    const size_t bytes = n_values * value_size(type);
    char *to = record(l, type, references, n, n_values, bytes);
    if (!to) return too_much(l);
    memcpy(to, values, bytes);
    l->waiting_for[l->n_waiting++] = name;
    l->fresh = false;
    return l->stepping ? LINK_OK : simple(l, LINK_SET);
}

static uint32_t set_strings(Link *l, uint32_t type, const char *name, const uint32_t *references, size_t n,
    const char *const *values, size_t n_values) {
    FLUSH
    size_t bytes = 0;
    for (size_t i = 0; i < n_values; i++) bytes += strlen(values[i]) + 1;
    char *to = record(l, type, references, n, n_values, bytes);
    if (!to) return too_much(l);
    for (size_t i = 0; i < n_values; i++) to = stpcpy(to, values[i]) + 1;
    l->waiting_for[l->n_waiting++] = name;
    return simple(l, LINK_SET);
}

static uint32_t set_binaries(Link *l, const uint32_t *references, size_t n, const size_t *sizes,
    const uint8_t *const *values, size_t n_values) {
    FLUSH
    size_t bytes = n_values * 8;
    for (size_t i = 0; i < n_values; i++) bytes += sizes[i];
    char *to = record(l, LINK_Binary, references, n, n_values, bytes);
    if (!to) return too_much(l);
    char *p = to + n_values * 8;
    for (size_t i = 0; i < n_values; p += sizes[i++]) {
        memcpy(to + i * 8, &(const uint64_t){sizes[i]}, 8);
        if (sizes[i]) memcpy(p, values[i], sizes[i]);
    }
    l->waiting_for[l->n_waiting++] = "fmi3SetBinary";
    return simple(l, LINK_SET);
}

static void learn(Link *l, uint32_t type, const char *name, const uint32_t *references, size_t n, size_t n_values) {
    size_t at = 0;
    if (l->n_plan) {
        const Planned *last = &l->plan[l->n_plan - 1];
        at = last->at + 8 + ALIGNED(last->n_values * value_size(last->type));
    }
    if (l->n_plan == LINK_PLANNED || l->n_plan_references + n > MOST_PLANNED_REFERENCES) return;
    if (n_values > l->region.area / 8 || at + 8 + n_values * 8 > l->region.area) return;
    uint32_t *own = l->references + l->n_plan_references;
    memcpy(own, references, n * 4);
    l->n_plan_references += n;
    l->plan[l->n_plan++] = (Planned){type, (uint32_t)n, 0, n_values, own, at, name};
}

static uint32_t get_values(
    Link *l, uint32_t type, const char *name, const uint32_t *references, size_t n, void *values, size_t n_values) {
    const size_t bytes = n_values * value_size(type);
    if (lost(l)) return LINK_FATAL;
    l->failed = NULL;
    if (l->fresh) {
        for (int i = 0; i < l->n_planned; i++) {
            const Planned *p = &l->plan[i];
            if (p->type != type || p->n_references != n || p->n_values != n_values ||
                memcmp(p->references, references, n * 4))
                continue;
            const char *from = l->region.results + p->at;
            uint32_t status;
            memcpy(&status, from, 4);
            memcpy(values, from + 8, bytes);
            return status;
        }
        if (l->n_plan == l->n_planned)
            learn(l, type, name, references, n, n_values); /* one for each step, so that none is learned twice */
    }
    const bool fresh = l->fresh; /* not if anything waits */
    FLUSH
    if (bytes > l->region.area || !record(l, type, references, n, n_values, 0)) return too_much(l);
    const uint32_t status = transact(l, LINK_GET);
    l->fresh = fresh;
    if (!l->end && status <= LINK_WARNING) memcpy(values, l->region.reply, bytes);
    return status;
}

/* Texts or Binaries, to be read from `l->text`; their bytes in all are `used`. */
static uint32_t fetch_texts(
    Link *l, uint32_t type, const uint32_t *references, size_t n, size_t n_values, size_t *all) {
    FLUSH
    if (!record(l, type, references, n, n_values, 0)) return too_much(l);
    const uint32_t status = transact(l, LINK_GET);
    if (status > LINK_WARNING || l->end) return status;
    const size_t used = l->region.answer->reply_used;
    if (used > l->region.area) return LINK_ERROR;
    if (used > l->text_room) {
        char *text = realloc(l->text, used + 1);
        if (text) l->text = text, l->text_room = used;
        if (!text) return LINK_ERROR;
    }
    memcpy(l->text, l->region.reply, used);
    *all = used;
    return status;
}

static uint32_t get_binaries(
    Link *l, const uint32_t *references, size_t n, size_t *sizes, const uint8_t **values, size_t n_values) {
    size_t used = 0;
    const uint32_t status = fetch_texts(l, LINK_Binary, references, n, n_values, &used);
    if (status > LINK_WARNING || l->end) return status;
    if (n_values > used / 8) return LINK_ERROR;
    const char *p = l->text + n_values * 8;
    for (size_t i = 0, left = used - n_values * 8; i < n_values; i++) {
        uint64_t size;
        memcpy(&size, l->text + i * 8, 8);
        if (size > left) return LINK_ERROR;
        sizes[i] = (size_t)size;
        values[i] = (const uint8_t *)p;
        p += size, left -= (size_t)size;
    }
    return status;
}

static uint32_t get_strings(
    Link *l, uint32_t type, const uint32_t *references, size_t n, const char **values, size_t n_values) {
    size_t used = 0;
    const uint32_t status = fetch_texts(l, type, references, n, n_values, &used);
    if (status > LINK_WARNING || l->end) return status;
    const char *p = l->text;
    for (size_t i = 0, left = used; i < n_values; i++) {
        const size_t length = strnlen(p, left);
        if (length == left) return LINK_ERROR; /* fewer than were asked for */
        values[i] = p;
        p += length + 1, left -= length + 1;
    }
    return status;
}

static uint32_t step(Link *l, double t, double h, bool no_set_prior, bool *flags[3], double *last) {
    Ask *ask = l->region.ask;
    if (lost(l)) return LINK_FATAL;
    if (l->n_planned < l->n_plan) {
        FLUSH
        for (int i = 0; i < l->n_plan; i++)
            if (!record(l, l->plan[i].type, l->plan[i].references, l->plan[i].n_references, l->plan[i].n_values, 0))
                return too_much(l);
        ask->a = (uint64_t)l->n_plan;
        const uint32_t status = simple(l, LINK_PLAN);
        if (status > LINK_WARNING) return status;
        l->n_planned = l->n_plan;
    }
    if (l->update) {
        const IntermediateUpdate *u = l->update;
        const size_t doubles = 2 + 3 * (size_t)u->n;
        char *to = record(l, LINK_Float64, u->references, u->n_references, doubles, doubles * 8);
        if (!to) return too_much(l);
        memcpy(to, u->line, (doubles - u->n) * 8);
    }
    ask->t = t;
    ask->h = h;
    ask->a = no_set_prior;
    ask->b = l->update ? 1 | (uint64_t)l->update->begins << 1 : 0;
    const uint32_t status = simple(l, LINK_STEP);
    l->stepping = true;
    if (l->end) return status;
    if (l->update) {
        const int64_t before = l->update->report.requests;
        memcpy(&l->update->report, l->region.reply, sizeof l->update->report);
        l->update->report.requests += before;
    }
    for (int i = 0; flags && i < 3; i++)
        *flags[i] = ((const unsigned char *)l->region.answer->flags)[i == 0 ? 0 : i + 1] != 0;
    if (last) *last = l->region.answer->last;
    l->fresh = status <= LINK_WARNING;
    return status;
}

/* ------------------------------------------------------------------ what every FMU has */

/* Load the library: 0, and `link_said` those of `functions` (names with blanks between) that it lacks; 1, and
 * `link_said` the loader's words; -1: the worker is lost. */
int link_load(Link *l, const char *library, const char *functions, int version) {
    char *p = l->region.request;
    const size_t first = strlen(library) + 1, second = strlen(functions) + 1;
    if (first + second > l->region.area) return -1;
    memcpy(p, library, first);
    memcpy(p + first, functions, second);
    l->waiting = first + second;
    const uint32_t status = with(l, LINK_LOAD, (uint64_t)version, 0);
    if (l->end) return -1;
    l->region.reply[l->region.area - 1] = 0;
    return status > LINK_WARNING ? 1 : 0;
}

const char *link_said(const Link *l) { return l->region.reply; }

/* Whether there is an instance. `events`: 1 with event mode, 2 it may return early. `required`: value references of the
 * inputs that are set inside its steps. */
bool link_instantiate(Link *l, const char *name, const char *token, const char *resources, bool exchange, int events,
    const uint32_t *required, size_t n_required, LinkLogger log) {
    const char *texts[3] = {name, token, resources};
    l->log = log;
    size_t used = 0;
    for (int i = 0; i < 3; i++) {
        const size_t n = strlen(texts[i]) + 1;
        if (n > l->region.area - used) return false;
        memcpy(l->region.request + used, texts[i], n);
        used += n;
    }
    if (n_required > (l->region.area - used) / 4 - 2) return false;
    l->update = NULL;
    memcpy(l->region.request + ALIGNED(used), required, n_required * 4);
    l->waiting = ALIGNED(used) + n_required * 4;
    return with(l, LINK_INSTANTIATE, exchange, (uint64_t)events | (uint64_t)n_required << 2) <= LINK_WARNING;
}

/* Inputs follow inside the steps of the instance. */
void link_follow(Link *l, void *update) { l->update = update; }

static uint32_t reset(Link *l) {
    l->stepping = false;
    l->n_plan = l->n_planned = 0;
    l->n_plan_references = 0;
    return simple(l, LINK_RESET);
}

static void free_instance(Link *l) { simple(l, LINK_FREE); }

static uint32_t enter(
    Link *l, bool has_tolerance, double tolerance, double start, bool has_stop, double stop, LinkOp op) {
    double given[5] = {has_tolerance, tolerance, start, has_stop, stop};
    memcpy(l->region.request, given, sizeof given);
    l->waiting = sizeof given;
    return simple(l, op);
}

static uint32_t get_state(Link *l, void **state) {
    FLUSH
    const uint32_t status = with(l, LINK_GET_STATE, (uint64_t)(uintptr_t)*state, 0);
    if (status <= LINK_WARNING) *state = (void *)(uintptr_t)l->region.answer->value;
    return status;
}

static uint32_t set_state(Link *l, void *state) {
    FLUSH
    return with(l, LINK_SET_STATE, (uint64_t)(uintptr_t)state, 0);
}

static uint32_t free_state(Link *l, void **state) {
    FLUSH
    const uint32_t status = with(l, LINK_FREE_STATE, (uint64_t)(uintptr_t)*state, 0);
    *state = NULL;
    return status;
}

static uint32_t state_size(Link *l, void *state, size_t *size) {
    FLUSH
    const uint32_t status = with(l, LINK_STATE_SIZE, (uint64_t)(uintptr_t)state, 0);
    *size = l->end ? 0 : (size_t)l->region.answer->value;
    return status;
}

static uint32_t serialize(Link *l, void *state, char *bytes, size_t size) {
    FLUSH
    uint32_t status = with(l, LINK_SERIALIZE, (uint64_t)(uintptr_t)state, size);
    const size_t area = l->region.area;
    for (size_t at = 0; status <= LINK_WARNING && at < size; at += area) {
        const size_t n = size - at < area ? size - at : area;
        status = with(l, LINK_READ_BYTES, at, n);
        if (status <= LINK_WARNING) memcpy(bytes + at, l->region.reply, n);
    }
    return status;
}

static uint32_t deserialize(Link *l, const char *bytes, size_t size, void **state) {
    FLUSH
    const size_t area = l->region.area;
    for (size_t at = 0; at < size; at += area) {
        const size_t n = size - at < area ? size - at : area;
        memcpy(l->region.request, bytes + at, n);
        l->waiting = n;
        const uint32_t status = with(l, LINK_WRITE_BYTES, at, size);
        if (status > LINK_WARNING) return status;
    }
    const uint32_t status = with(l, LINK_DESERIALIZE, 0, size);
    if (status <= LINK_WARNING) *state = (void *)(uintptr_t)l->region.answer->value;
    return status;
}

static uint32_t derivative(Link *l, const uint32_t *of, size_t n_of, const uint32_t *by, size_t n_by,
    const double *seed, size_t n_seed, double *result, size_t n_result) {
    FLUSH
    char *to = record(l, LINK_Float64, by, n_by, n_seed, n_seed * 8);
    if (!to) return too_much(l);
    memcpy(to, seed, n_seed * 8);
    if (n_result > l->region.area / 8 || !record(l, LINK_Float64, of, n_of, n_result, 0)) return too_much(l);
    const uint32_t status = simple(l, LINK_DERIVATIVE);
    if (status <= LINK_WARNING) memcpy(result, l->region.reply, n_result * 8);
    return status;
}

/* A Model Exchange FMU gets its integrator: the bytes of its setup, then value references (integrator.h). */
uint32_t link_integrate(Link *l, const char *setup, size_t size, double t) {
    FLUSH
    if (size > l->region.area) return too_much(l);
    memcpy(l->region.request, setup, size);
    l->waiting = size;
    l->region.ask->t = t;
    return simple(l, LINK_INTEGRATE);
}

/* The integrator's memory from `bytes`, or its memory and report into them. */
uint32_t link_integrator(Link *l, char *bytes, size_t size, bool set) {
    FLUSH
    if (set) memcpy(l->region.request, bytes, size), l->waiting = size;
    const bool fresh = l->fresh;
    const uint32_t status = with(l, LINK_INTEGRATOR, set, 0);
    l->fresh = fresh && !set;
    if (!set && !l->end && status <= LINK_WARNING) memcpy(bytes, l->region.reply, size);
    return status;
}

/* ------------------------------------------------------------------ FMI 2.0 */

/* One value for each reference. */
#define SCALARS(version, Name, Type, ctype)                                                                            \
    uint32_t fmi##version##Set##Name(Link *l, const uint32_t *r, size_t n, const ctype *v) {                           \
        return set_values(l, LINK_##Type, "fmi" #version "Set" #Name, r, n, v, n);                                     \
    }                                                                                                                  \
    uint32_t fmi##version##Get##Name(Link *l, const uint32_t *r, size_t n, ctype *v) {                                 \
        return get_values(l, LINK_##Type, "fmi" #version "Get" #Name, r, n, v, n);                                     \
    }
SCALARS(2, Real, Real, double)
SCALARS(2, Integer, Integer, int)
SCALARS(2, Boolean, Boolean2, int)
uint32_t fmi2SetString(Link *l, const uint32_t *r, size_t n, const char *const *v) {
    return set_strings(l, LINK_String2, "fmi2SetString", r, n, v, n);
}
uint32_t fmi2GetString(Link *l, const uint32_t *r, size_t n, const char **v) {
    return get_strings(l, LINK_String2, r, n, v, n);
}
uint32_t fmi2SetupExperiment(Link *l, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    return enter(l, has_tolerance != 0, tolerance, start, has_stop != 0, stop, LINK_SETUP);
}
uint32_t fmi2EnterInitializationMode(Link *l) { return simple(l, LINK_ENTER); }
uint32_t fmi2DoStep(Link *l, double t, double h, int no_set_prior) {
    return step(l, t, h, no_set_prior != 0, NULL, NULL);
}
uint32_t fmi2GetDirectionalDerivative(
    Link *l, const uint32_t *of, size_t n_of, const uint32_t *by, size_t n_by, const double *seed, double *result) {
    return derivative(l, of, n_of, by, n_by, seed, n_by, result, n_of);
}
uint32_t fmi2GetRealStatus(Link *l, int kind, double *value) {
    FLUSH
    const uint32_t status = with(l, LINK_STATUS, (uint64_t)kind, 0);
    *value = l->region.answer->last;
    return status;
}
uint32_t fmi2GetBooleanStatus(Link *l, int kind, int *value) {
    FLUSH
    const uint32_t status = with(l, LINK_STATUS, (uint64_t)kind, 1);
    *value = l->region.answer->value != 0;
    return status;
}

/* ------------------------------------------------------------------ FMI 3.0 */

#define VALUES3(Name, Type, ctype)                                                                                     \
    uint32_t fmi3Set##Name(Link *l, const uint32_t *r, size_t n, const ctype *v, size_t m) {                           \
        return set_values(l, LINK_##Type, "fmi3Set" #Name, r, n, v, m);                                                \
    }                                                                                                                  \
    uint32_t fmi3Get##Name(Link *l, const uint32_t *r, size_t n, ctype *v, size_t m) {                                 \
        return get_values(l, LINK_##Type, "fmi3Get" #Name, r, n, v, m);                                                \
    }
VALUES3(Float64, Float64, double)
VALUES3(Float32, Float32, float)
VALUES3(Int8, Int8, int8_t)
VALUES3(UInt8, UInt8, uint8_t)
VALUES3(Int16, Int16, int16_t)
VALUES3(UInt16, UInt16, uint16_t)
VALUES3(Int32, Int32, int32_t)
VALUES3(UInt32, UInt32, uint32_t)
VALUES3(Int64, Int64, int64_t)
VALUES3(UInt64, UInt64, uint64_t)
VALUES3(Boolean, Boolean3, bool)
uint32_t fmi3SetString(Link *l, const uint32_t *r, size_t n, const char *const *v, size_t m) {
    return set_strings(l, LINK_String3, "fmi3SetString", r, n, v, m);
}
uint32_t fmi3GetString(Link *l, const uint32_t *r, size_t n, const char **v, size_t m) {
    return get_strings(l, LINK_String3, r, n, v, m);
}
uint32_t fmi3SetBinary(
    Link *l, const uint32_t *r, size_t n, const size_t *sizes, const uint8_t *const *v, size_t m) {
    return set_binaries(l, r, n, sizes, v, m);
}
uint32_t fmi3GetBinary(Link *l, const uint32_t *r, size_t n, size_t *sizes, const uint8_t **v, size_t m) {
    return get_binaries(l, r, n, sizes, v, m);
}
uint32_t fmi3EnterInitializationMode(
    Link *l, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    return enter(l, has_tolerance, tolerance, start, has_stop, stop, LINK_ENTER);
}
uint32_t fmi3DoStep(
    Link *l, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    bool *flags[3] = {event, terminate, early};
    return step(l, t, h, no_set_prior, flags, last);
}
uint32_t fmi3GetDirectionalDerivative(Link *l, const uint32_t *of, size_t n_of, const uint32_t *by, size_t n_by,
    const double *seed, size_t n_seed, double *result, size_t n_result) {
    return derivative(l, of, n_of, by, n_by, seed, n_seed, result, n_result);
}
uint32_t fmi3EnterEventMode(Link *l) { return with(l, LINK_EVENTS, 0, 0); }
uint32_t fmi3EnterStepMode(Link *l) { return with(l, LINK_EVENTS, 1, 0); }
uint32_t fmi3EnterConfigurationMode(Link *l) { return with(l, LINK_EVENTS, 3, 0); }
uint32_t fmi3ExitConfigurationMode(Link *l) { return with(l, LINK_EVENTS, 4, 0); }
uint32_t fmi3UpdateDiscreteStates(
    Link *l, bool *again, bool *terminate, bool *nominals, bool *states, bool *has_next, double *next) {
    bool *flags[5] = {again, terminate, nominals, states, has_next};
    const uint32_t status = with(l, LINK_EVENTS, 2, 0);
    if (l->end) return status;
    for (int i = 0; i < 5; i++) *flags[i] = (l->region.answer->value >> i & 1) != 0;
    *next = l->region.answer->last;
    return status;
}

SCALARS(3, Clock, Clock, bool)

/* One clock at a time, as the master asks for them. What is not asked for is NULL. */
static uint32_t interval(
    Link *l, uint64_t what, const uint32_t *r, size_t n, double *seconds, uint64_t *c, uint64_t *of, int *q) {
    if (n != 1) return LINK_ERROR;
    FLUSH
    LinkInterval x = {0};
    const uint32_t status = with(l, LINK_INTERVAL, what, r[0]);
    if (!l->end) memcpy(&x, l->region.reply, sizeof x);
    if (seconds) *seconds = x.seconds;
    if (c) *c = x.counter, *of = x.resolution;
    if (q) *q = x.qualifier;
    return status;
}
uint32_t fmi3GetIntervalDecimal(Link *l, const uint32_t *r, size_t n, double *v, int *q) {
    return interval(l, 0, r, n, v, NULL, NULL, q);
}
uint32_t fmi3GetIntervalFraction(Link *l, const uint32_t *r, size_t n, uint64_t *c, uint64_t *of, int *q) {
    return interval(l, 1, r, n, NULL, c, of, q);
}
uint32_t fmi3GetShiftDecimal(Link *l, const uint32_t *r, size_t n, double *v) {
    return interval(l, 2, r, n, v, NULL, NULL, NULL);
}
uint32_t fmi3GetShiftFraction(Link *l, const uint32_t *r, size_t n, uint64_t *c, uint64_t *of) {
    return interval(l, 3, r, n, NULL, c, of, NULL);
}

/* ------------------------------------------------------------------ both */

#define BOTH(v, State, De)                                                                               \
    void fmi##v##FreeInstance(Link *l) { free_instance(l); }                                             \
    uint32_t fmi##v##ExitInitializationMode(Link *l) { return simple(l, LINK_EXIT); }                    \
    uint32_t fmi##v##Terminate(Link *l) { return simple(l, LINK_TERMINATE); }                            \
    uint32_t fmi##v##Reset(Link *l) { return reset(l); }                                                 \
    uint32_t fmi##v##GetFMU##State(Link *l, void **s) { return get_state(l, s); }                        \
    uint32_t fmi##v##SetFMU##State(Link *l, void *s) { return set_state(l, s); }                         \
    uint32_t fmi##v##FreeFMU##State(Link *l, void **s) { return free_state(l, s); }                      \
    uint32_t fmi##v##SerializedFMU##State##Size(Link *l, void *s, size_t *n) { return state_size(l, s, n); } \
    uint32_t fmi##v##SerializeFMU##State(Link *l, void *s, char *b, size_t n) { return serialize(l, s, b, n); } \
    uint32_t fmi##v##De##FMU##State(Link *l, const char *b, size_t n, void **s) { return deserialize(l, b, n, s); }
BOTH(2, state, DeSerialize)
BOTH(3, State, Deserialize)
