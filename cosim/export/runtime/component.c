/* Calls into the components of a system: see component.h. */
#include "component.h"
#include "environment.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ------------------------------------------------------------------ messages */

static void message2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
    fmi2String format, ...) {
    const Component *m = environment;
    char text[1024];
    (void)name;
    (void)category;
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format ? format : "", arguments);
    va_end(arguments);
    m->log(m->context, (int)status, text);
}

static void message3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
    const Component *m = environment;
    (void)category;
    m->log(m->context, (int)status, message ? message : "");
}

/* ------------------------------------------------------------------ life */

void component_watch(Component *m) { m->environment = m->library ? environment_bits() : 0; }

void component_changed(Component *m, uint32_t bits) {
    static const char *const names[] = {"the rounding mode", "the treatment of subnormal numbers", "the traps"};
    for (int i = 0; i < 3; i++) {
        if (!(bits & ~m->changed & 1u << i)) continue;
        char text[128];
        (void)snprintf(text, sizeof text,
            "it changes %s of floating-point arithmetic; that is restored after each call", names[i]);
        m->say(m, fmi3Warning, "", text);
    }
    m->changed |= bits;
}

static uint32_t seen(Component *m, uint32_t status) {
    if (m->library) component_changed(m, environment_restore(m->environment));
    if (status == fmi3Fatal) m->dead = true; /* as fmi2Fatal */
    return status;
}

#define SEEN(expression) (component_watch(m), seen(m, (uint32_t)(expression)))
#define CALL(two, three) SEEN(m->version == 2 ? m->f2->two : m->f3->three)

bool component_instantiate(Component *m, const char *name, const char *token, const char *resources) {
    const bool integrated = m->exchange != NULL; /* or with events */
    m->say = message3;
    if (m->version == 2) {
        char uri[4096];
        (void)snprintf(uri, sizeof uri, "file://%s%s", *resources == '/' ? "" : "/", resources);
        m->callbacks = (fmi2CallbackFunctions){message2, calloc, free, NULL, m};
        m->instance = m->f2->Instantiate(
            name, integrated ? fmi2ModelExchange : fmi2CoSimulation, token, uri, &m->callbacks, fmi2False, fmi2False);
    } else if (!integrated) {
        m->instance = m->f3->InstantiateCoSimulation(
            name, token, resources, false, false, false, false, REQUIRED(m), m, message3, m->update);
    }
    const bool made = integrated ? m->exchange->make(m, name, token, resources) : m->instance != NULL;
    (void)seen(m, fmi3OK); /* since it was loaded */
    return made;
}

void component_free(Component *m) {
    component_watch(m);
    if (m->instance && !m->dead) {
        if (m->version == 2) m->f2->FreeInstance(m->instance);
        else m->f3->FreeInstance(m->instance);
    }
    m->instance = NULL;
    free(m->integrator);
    free(m->updates);
    m->integrator = m->updates = NULL;
    if (m->library && !m->dead) m->close(m->library);
    (void)seen(m, fmi3OK);
    m->library = NULL;
}

uint32_t component_enter(Component *m, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    m->begin = start;
    if (m->version == 3)
        return SEEN(m->f3->EnterInitializationMode(m->instance, has_tolerance, tolerance, start, has_stop, stop));
    const uint32_t status =
        SEEN(m->f2->SetupExperiment(m->instance, has_tolerance, tolerance, start, has_stop, stop));
    return status > fmi2Warning ? status : SEEN(m->f2->EnterInitializationMode(m->instance));
}

uint32_t component_exit(Component *m) {
    const uint32_t left = m->exchange && m->exchange->leave ? SEEN(m->exchange->leave(m)) : (uint32_t)fmi3OK;
    if (left > fmi3Warning) return left;
    return CALL(ExitInitializationMode(m->instance), ExitInitializationMode(m->instance));
}
uint32_t component_begin(Component *m) { return m->exchange ? SEEN(m->exchange->begin(m)) : (uint32_t)fmi3OK; }
uint32_t component_reset(Component *m) {
    if (m->exchange && m->exchange->bind) m->exchange->bind(m, false);
    if (m->exchange && m->exchange->values) memset(m->memory[1].at, 0, m->memory[1].n); /* no input waits */
    return CALL(Reset(m->instance), Reset(m->instance));
}
uint32_t component_terminate(Component *m) { return CALL(Terminate(m->instance), Terminate(m->instance)); }

/* State of an FMU, and behind it the memory of what steps it. */
typedef struct {
    void *state;
    unsigned char memory[];
} Saved;

static size_t n_memory(const Component *m) { return m->memory[0].n + m->memory[1].n; }

static void move_memory(const Component *m, unsigned char *bytes, bool save) {
    for (int i = 0; i < 2; bytes += m->memory[i++].n) {
        if (!m->memory[i].n) continue;
        if (save) memcpy(bytes, m->memory[i].at, m->memory[i].n);
        else memcpy(m->memory[i].at, bytes, m->memory[i].n);
    }
}

uint32_t component_save(Component *m, void **state) {
    if (!n_memory(m)) return CALL(GetFMUstate(m->instance, state), GetFMUState(m->instance, state));
    Saved *const s = *state ? *state : calloc(1, sizeof *s + n_memory(m));
    if (!s) return fmi3Error;
    const uint32_t status = CALL(GetFMUstate(m->instance, &s->state), GetFMUState(m->instance, &s->state));
    move_memory(m, s->memory, true);
    if (status > fmi3Warning && !*state) free(s);
    else *state = s;
    return status;
}

uint32_t component_restore(Component *m, void *state) {
    Saved *const s = state;
    if (n_memory(m)) move_memory(m, s->memory, false), state = s->state;
    return CALL(SetFMUstate(m->instance, state), SetFMUState(m->instance, state));
}

uint32_t component_forget(Component *m, void **state) {
    Saved *const s = *state;
    if (!n_memory(m)) return CALL(FreeFMUstate(m->instance, state), FreeFMUState(m->instance, state));
    const uint32_t status = CALL(FreeFMUstate(m->instance, &s->state), FreeFMUState(m->instance, &s->state));
    free(s);
    *state = NULL;
    return status;
}

uint32_t component_size(Component *m, void *state, size_t *size) {
    if (n_memory(m)) state = ((Saved *)state)->state;
    const uint32_t status =
        CALL(SerializedFMUstateSize(m->instance, state, size), SerializedFMUStateSize(m->instance, state, size));
    *size += n_memory(m);
    return status;
}

uint32_t component_serialize(Component *m, void *state, void *bytes, size_t size) {
    if (n_memory(m)) {
        const Saved *const s = state;
        size -= n_memory(m);
        memcpy((char *)bytes + size, s->memory, n_memory(m));
        state = s->state;
    }
    return CALL(SerializeFMUstate(m->instance, state, bytes, size), SerializeFMUState(m->instance, state, bytes, size));
}

uint32_t component_deserialize(Component *m, const void *bytes, size_t size, void **state) {
    if (!n_memory(m))
        return CALL(
            DeSerializeFMUstate(m->instance, bytes, size, state), DeserializeFMUState(m->instance, bytes, size, state));
    Saved *const s = size < n_memory(m) ? NULL : calloc(1, sizeof *s + n_memory(m));
    if (!s) return fmi3Error;
    size -= n_memory(m);
    memcpy(s->memory, (const char *)bytes + size, n_memory(m));
    const uint32_t status = CALL(DeSerializeFMUstate(m->instance, bytes, size, &s->state),
        DeserializeFMUState(m->instance, bytes, size, &s->state));
    if (status > fmi3Warning) free(s);
    else *state = s;
    return status;
}

/* ------------------------------------------------------------------ values */

static EngineType type_of(int version, Kind kind) {
    static const EngineType types[] = {ENGINE_DOUBLE, ENGINE_FLOAT, ENGINE_INT8, ENGINE_UINT8, ENGINE_INT16,
        ENGINE_UINT16, ENGINE_INT32, ENGINE_UINT32, ENGINE_INT64, ENGINE_UINT64, ENGINE_BOOL, ENGINE_DOUBLE,
        ENGINE_DOUBLE}; /* texts and bytes: their slots */
    return version == 2 && kind == KIND_BOOLEAN ? ENGINE_INT32 : types[kind];
}

/* In place of functions that the library of an FMU does not have. */
static uint32_t lacking2(void *instance, const uint32_t *references, size_t n, void *values) {
    return (void)instance, (void)references, (void)n, (void)values, (uint32_t)fmi2Error;
}
static uint32_t lacking3(void *instance, const uint32_t *references, size_t n, void *values, size_t n_values) {
    return (void)instance, (void)references, (void)n, (void)values, (void)n_values, (uint32_t)fmi3Error;
}

#define CASE2(KIND, NAME)                                                                                              \
    case KIND_##KIND:                                                                                                  \
        t->call2 = set ? (EngineValues2)m->f2->Set##NAME : (EngineValues2)m->f2->Get##NAME;                            \
        if (!t->call2) t->call2 = lacking2;                                                                            \
        break
#define CASE3(KIND, NAME)                                                                                              \
    case KIND_##KIND:                                                                                                  \
        t->call3 = set ? (EngineValues3)m->f3->Set##NAME : (EngineValues3)m->f3->Get##NAME;                            \
        if (!t->call3) t->call3 = lacking3;                                                                            \
        break

void component_values(const Component *m, Kind kind, bool set, EngineTransfer *t) {
    t->type = type_of(m->version, kind);
    if (m->version == 2) switch (kind) {
        CASE2(FLOAT64, Real);
        CASE2(INT32, Integer);
        CASE2(BOOLEAN, Boolean);
        default: break;
    }
    else switch (kind) {
        CASE3(FLOAT64, Float64);
        CASE3(FLOAT32, Float32);
        CASE3(INT8, Int8);
        CASE3(UINT8, UInt8);
        CASE3(INT16, Int16);
        CASE3(UINT16, UInt16);
        CASE3(INT32, Int32);
        CASE3(UINT32, UInt32);
        CASE3(INT64, Int64);
        CASE3(UINT64, UInt64);
        CASE3(BOOLEAN, Boolean);
        default: break;
    }
}

/* One variable through a buffer of its own; the engine's conversions are those of the connections. */
static uint32_t move_values(Component *m, Kind kind, uint32_t reference, double *values, size_t n, bool set) {
    double buffer[COMPONENT_LARGEST];
    uint32_t numbers[COMPONENT_LARGEST];
    if (n > COMPONENT_LARGEST) return fmi3Error;
    for (size_t i = 0; i < n; i++) numbers[i] = (uint32_t)i;
    EngineTransfer t = {.references = &reference, .n_references = 1, .data = buffer, .n_data = n, .n = n,
                        .element = numbers, .place = numbers};
    component_values(m, kind, set, &t);
    Engine none = {0};
    const EngineComponent e = {.fmi = m->version,
        .instance = m->instance,
        .u = values,
        .y = values,
        .sets = &t,
        .gets = &t,
        .n_sets = 1,
        .n_gets = 1};
    component_watch(m);
    const int failed = set ? engine_set(&none, &e) : engine_get(&none, &e);
    return seen(m, failed ? none.status : fmi3OK);
}

uint32_t component_set(Component *m, Kind kind, uint32_t reference, const double *values, size_t n) {
    double *const from = (double *)(uintptr_t)values;
    if (n == 1 && component_later(m, reference, from, true)) return fmi3OK;
    if (!m->exchange || !m->exchange->change) return move_values(m, kind, reference, from, n, true);
    uint32_t status = SEEN(m->exchange->change(m, true, false));
    if (status > fmi3Warning) return status;
    status = move_values(m, kind, reference, from, n, true);
    const uint32_t left = m->dead ? status : SEEN(m->exchange->change(m, false, status <= fmi3Warning));
    return status > fmi3Warning ? status : left;
}

uint32_t component_get(Component *m, Kind kind, uint32_t reference, double *values, size_t n) {
    return move_values(m, kind, reference, values, n, false);
}

bool component_later(Component *m, uint32_t reference, double *value, bool set) {
    return m->exchange && m->exchange->later && m->exchange->later(m, reference, value, set);
}

uint32_t component_set_text(Component *m, uint32_t reference, const char *text) {
    if (m->version == 2 ? !m->f2->SetString : !m->f3->SetString) return fmi2Error;
    return CALL(SetString(m->instance, &reference, 1, &text), SetString(m->instance, &reference, 1, &text, 1));
}

uint32_t component_get_text(Component *m, uint32_t reference, const char **text) {
    if (m->version == 2 ? !m->f2->GetString : !m->f3->GetString) return fmi2Error;
    *text = NULL;
    const uint32_t status =
        CALL(GetString(m->instance, &reference, 1, text), GetString(m->instance, &reference, 1, text, 1));
    if (!*text) *text = "";
    return status;
}

/* A function of an FMU of others that is not in the tables; `call` is a pointer to it, or becomes NULL. */
static void find(const Component *m, const char *name, void *call) {
    const ExchangeCall found = m->find ? m->find(m->library, m->version, name) : NULL;
    memcpy(call, &found, sizeof found);
}

uint32_t component_set_bytes(Component *m, uint32_t reference, const unsigned char *bytes, size_t n) {
    fmi3SetBinaryTYPE *call;
    find(m, "SetBinary", &call);
    return call ? SEEN(call(m->instance, &reference, 1, &n, &bytes, 1)) : (uint32_t)fmi3Error;
}

uint32_t component_get_bytes(Component *m, uint32_t reference, const unsigned char **bytes, size_t *n) {
    fmi3GetBinaryTYPE *call;
    find(m, "GetBinary", &call);
    return call ? SEEN(call(m->instance, &reference, 1, n, bytes, 1)) : (uint32_t)fmi3Error;
}

uint32_t component_move_wide(Component *m, Kind kind, uint32_t reference, uint64_t *values, size_t n, bool set) {
    EngineTransfer t;
    component_values(m, kind, set, &t);
    return SEEN(t.call3(m->instance, &reference, 1, values, n));
}

bool component_asked_to_end(Component *m, double *reached) {
    char text[1];
    if (m->exchange) return !m->exchange->why(m, reached, text, sizeof text);
    fmi2Boolean ended = fmi2False;
    double told = 0.0;
    if (m->version == 2 && m->f2->GetRealStatus &&
        m->f2->GetRealStatus(m->instance, fmi2LastSuccessfulTime, &told) <= fmi2Warning)
        *reached = told;
    return m->version == 2 && m->f2->GetBooleanStatus &&
           m->f2->GetBooleanStatus(m->instance, fmi2Terminated, &ended) <= fmi2Warning && ended;
}
