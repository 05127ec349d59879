/* Saved states of a system: see container.h. */
#include <stdlib.h>
#include <string.h>

#include "container.h"
#include "fmu_math.h"

#define STATE_MAGIC 0x53594d55u /* 'UMYS'; also tells a foreign byte order */
#define STATE_VERSION 2u

typedef struct {
    uint32_t magic, version;
    uint64_t model, length, components; /* of the system, the state block and all components' states, in bytes */
    uint64_t checksum; /* once serialized; until then the address of this header, so that no bytes pass for a state */
} Header;

/* A saved state: header, state block, the components' states. */
typedef struct {
    Header header;
    void *components[];
} Saved;

static State *state_in(const void *saved) {
    return (State *)((char *)(uintptr_t)saved + sizeof(Saved) + (size_t)P->n_components * sizeof(void *));
}
static size_t saved_size(void) { return sizeof(Saved) + (size_t)P->n_components * sizeof(void *) + state_size(); }
static uint64_t identity(void) { return fmu_hash(fmu_model.token, strlen(fmu_model.token)); }

static FmuStatus check_can_save(FmuInstance *self, const char *function) {
    return P->can_save
               ? FMU_OK
               : fmu_fail(
                     self, FMU_ERROR, "%s: not all components of %s can save their state", function, fmu_model.name);
}

/* Of a state in memory or, when `bytes`, of a serialized one. */
static FmuStatus check_header_of(FmuInstance *self, const char *function, const void *saved, int bytes) {
    Header h;
    FmuStatus status = check_can_save(self, function);
    if (status != FMU_OK) return status;
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: the FMU state is NULL", function);
    memcpy(&h, saved, sizeof h);
    if (h.magic != STATE_MAGIC || (!bytes && h.checksum != (uint64_t)(uintptr_t)saved))
        return fmu_fail(self, FMU_ERROR, "%s: this is not a state of this FMU", function);
    if (h.version != STATE_VERSION)
        return fmu_fail(self, FMU_ERROR, "%s: state format %u, this FMU reads %u", function, h.version, STATE_VERSION);
    if (h.model != identity() || h.length != state_size())
        return fmu_fail(
            self, FMU_ERROR, "%s: the state belongs to another system or build than %s", function, fmu_model.name);
    return FMU_OK;
}

static FmuStatus check_header(FmuInstance *self, const char *function, const void *saved) {
    return check_header_of(self, function, saved, 0);
}

/* What of a state block cannot be of this system; NULL when there is nothing. */
static const char *wrong_in(const State *s) {
    const unsigned mode = (unsigned)s->mode,
                   modes = MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_STEP | MODE_TERMINATED | MODE_ERROR;
    if (!mode || mode & (mode - 1u) || mode & ~modes) return "its mode";
    if ((s->settled | s->ended) & ~1) return "its flags";
    if (s->tick < 0 || s->tick >= EXACT || s->stop_tick < 0 || s->tick > s->stop_tick) return "its time";
    if (s->ending < s->tick || s->ends_by < 0 || s->ends_by >= P->n_components) return "its end";
    if (!isfinite(s->start) || s->d < 0 || s->d >= EXACT || s->a < 0 || s->a >= EXACT || s->b <= -EXACT ||
        s->b >= EXACT)
        return "its start time";
    if ((mode == MODE_STEP || mode == MODE_TERMINATED) &&
        (!s->d || !s->a || !((double)s->tick * (double)s->a + fabs((double)s->b) < (double)EXACT)))
        return "its start time";
    if (s->d && (s->d % P->d || s->a != P->a * (s->d / P->d) || (double)s->b / (double)s->d != s->start))
        return "its start time";
    if (mode == MODE_STEP)
        for (uint32_t k = 0; k < P->n_values + P->n_u; k++)
            if (!isfinite(s->v[k])) return k < P->n_values ? P->owners[k] : "an input of a component";
    return NULL;
}

static void forget_components(FmuInstance *self, Saved *saved) {
    for (int32_t i = 0; i < P->n_components; i++)
        if (saved->components[i] && !self->components[i].dead)
            (void)component_forget(&self->components[i], &saved->components[i]);
}

static FmuStatus check_alive(FmuInstance *self, const char *function) {
    for (int32_t i = 0; i < P->n_components; i++)
        if (self->components[i].dead)
            return fmu_fail(
                self, FMU_ERROR, "%s: component '%s' has failed permanently", function, P->components[i].name);
    return FMU_OK;
}

FmuStatus fmu_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    FmuStatus status = check_can_save(self, function);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status == FMU_OK && !snapshot) status = fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (status == FMU_OK && *snapshot) status = check_header(self, function, *snapshot);
    if (status != FMU_OK) return status;
    Saved *saved = *snapshot ? *snapshot : calloc(1, saved_size());
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    for (int32_t i = 0; i < P->n_components; i++) {
        const uint32_t said = component_save(&self->components[i], &saved->components[i]);
        if (said <= fmi3Warning) continue;
        if (!*snapshot) {
            forget_components(self, saved);
            free(saved);
        }
        return container_refused(self, i, "GetFMUState", said);
    }
    saved->header = (Header){.magic = STATE_MAGIC,
        .version = STATE_VERSION,
        .model = identity(),
        .length = state_size(),
        .checksum = (uint64_t)(uintptr_t)saved};
    memcpy(state_in(saved), self->state, state_size());
    *snapshot = saved;
    return FMU_OK;
}

FmuStatus fmu_restore(FmuInstance *self, const char *function, const void *snapshot) {
    FmuStatus status = check_header(self, function, snapshot);
    if (status == FMU_OK) status = check_alive(self, function);
    const char *wrong = status == FMU_OK ? wrong_in(state_in(snapshot)) : NULL;
    if (wrong)
        status = fmu_fail(self, FMU_ERROR, "%s: this cannot be a state of %s: %s", function, fmu_model.name, wrong);
    const Saved *saved = snapshot;
    for (int32_t i = 0; i < P->n_components && status == FMU_OK; i++) {
        const uint32_t said = component_restore(&self->components[i], saved->components[i]);
        if (said > fmi3Warning)
            status = container_failed(self, i, "SetFMUState", said); /* components before it have been restored */
    }
    if (status != FMU_OK) return status;
    memcpy(self->state, state_in(snapshot), state_size());
    status = container_bind(self);
    container_repeat_steps(self);
    return status;
}

FmuStatus fmu_free_snapshot(FmuInstance *self, const char *function, void **snapshot) {
    if (!snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (!*snapshot) return FMU_OK;
    const FmuStatus status = check_header(self, function, *snapshot);
    if (status != FMU_OK) return status;
    forget_components(self, *snapshot);
    free(*snapshot);
    *snapshot = NULL;
    return FMU_OK;
}

/* Bytes: header, state block, and for each component the number of its bytes and these. */
FmuStatus fmu_serialized_size(FmuInstance *self, const char *function, const void *snapshot, size_t *size) {
    FmuStatus status = check_header(self, function, snapshot);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status == FMU_OK && !size) status = fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (status != FMU_OK) return status;
    const Saved *saved = snapshot;
    size_t total = sizeof(Header) + state_size();
    for (int32_t i = 0; i < P->n_components; i++) {
        size_t own = 0;
        const uint32_t said = component_size(&self->components[i], saved->components[i], &own);
        if (said > fmi3Warning) return container_refused(self, i, "SerializedFMUStateSize", said);
        total += sizeof(uint64_t) + own;
    }
    *size = total;
    return FMU_OK;
}

FmuStatus fmu_serialize(
    FmuInstance *self, const char *function, const void *snapshot, unsigned char *bytes, size_t size) {
    size_t need = 0;
    FmuStatus status = fmu_serialized_size(self, function, snapshot, &need);
    if (status != FMU_OK) return status;
    if (!bytes || size < need)
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are too few, need %zu", function, bytes ? size : 0, need);
    const Saved *saved = snapshot;
    unsigned char *to = bytes + sizeof(Header);
    memcpy(to, state_in(snapshot), state_size());
    to += state_size();
    for (int32_t i = 0; i < P->n_components; i++) {
        size_t own = 0;
        uint32_t said = component_size(&self->components[i], saved->components[i], &own);
        const uint64_t length = own;
        memcpy(to, &length, sizeof length);
        to += sizeof length;
        if (said <= fmi3Warning) said = component_serialize(&self->components[i], saved->components[i], to, own);
        if (said > fmi3Warning) return container_refused(self, i, "SerializeFMUState", said);
        to += own;
    }
    Header h = saved->header;
    h.components = need - sizeof(Header) - state_size();
    h.checksum = fmu_hash(bytes + sizeof(Header), need - sizeof(Header));
    memcpy(bytes, &h, sizeof h);
    return FMU_OK;
}

FmuStatus fmu_deserialize(
    FmuInstance *self, const char *function, const unsigned char *bytes, size_t size, void **snapshot) {
    if (!bytes || !snapshot) return fmu_fail(self, FMU_ERROR, "%s: NULL argument", function);
    if (size < sizeof(Header))
        return fmu_fail(self, FMU_ERROR, "%s: %zu bytes are not a serialized state", function, size);
    FmuStatus status = check_header_of(self, function, bytes, 1);
    if (status == FMU_OK) status = check_alive(self, function);
    if (status != FMU_OK) return status;
    Header h;
    memcpy(&h, bytes, sizeof h);
    if (size - sizeof h < state_size() || h.components != size - sizeof h - state_size() ||
        h.checksum != fmu_hash(bytes + sizeof h, size - sizeof h))
        return fmu_fail(self, FMU_ERROR, "%s: the serialized state of %s is damaged", function, fmu_model.name);
    Saved *saved = calloc(1, saved_size());
    if (!saved) return fmu_fail(self, FMU_ERROR, "%s: out of memory", function);
    saved->header = (Header){.magic = h.magic, .version = h.version, .model = h.model, .length = h.length,
                             .checksum = (uint64_t)(uintptr_t)saved};
    memcpy(state_in(saved), bytes + sizeof h, state_size());
    const unsigned char *from = bytes + sizeof h + state_size(), *end = bytes + size;
    const char *wrong = wrong_in(state_in(saved));
    if (wrong)
        status = fmu_fail(self, FMU_ERROR, "%s: this cannot be a state of %s: %s", function, fmu_model.name, wrong);
    for (int32_t i = 0; i < P->n_components && status == FMU_OK; i++) {
        uint64_t own = 0;
        if ((size_t)(end - from) >= sizeof own) memcpy(&own, from, sizeof own);
        if ((size_t)(end - from) < sizeof own || own > (uint64_t)(end - from) - sizeof own) {
            status = fmu_fail(self, FMU_ERROR, "%s: the serialized state of %s is damaged", function, fmu_model.name);
            break;
        }
        const uint32_t said =
            component_deserialize(&self->components[i], from + sizeof own, (size_t)own, &saved->components[i]);
        if (said > fmi3Warning) status = container_refused(self, i, "DeserializeFMUState", said);
        from += sizeof own + own;
    }
    if (status == FMU_OK) {
        *snapshot = saved;
        return FMU_OK;
    }
    forget_components(self, saved);
    free(saved);
    return status;
}
