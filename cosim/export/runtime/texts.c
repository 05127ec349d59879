/* Connections of texts, bytes and 64-bit integers in a system: see system.h; only systems with such have this. */
#include <string.h>

#include "exact_values.h"
#include "system.h"

static size_t aligned(size_t n) { return (n + 15u) & ~(size_t)15u; }

static size_t room(const PlanTransfer *p) {
    const PlanExact *const x = p->exact;
    return aligned(sizeof(ExactValues)) + aligned(x->n_values * sizeof(uint64_t))
           + aligned(x->n_values * sizeof(size_t)) + aligned(x->n_texts);
}

static void bind(const Component *m, const PlanTransfer *p, bool set, void *memory, EngineTransfer *t) {
    const PlanExact *const plan = p->exact;
    ExactValues *const x = memory;
    char *const at = (char *)memory + aligned(sizeof *x);
    *x = (ExactValues){.kind = plan->kind,
        .version = (uint32_t)m->version,
        .references = p->references,
        .n_references = p->n_references,
        .n_values = plan->n_values,
        .values = at,
        .sizes = (size_t *)(void *)(at + aligned(plan->n_values * sizeof(uint64_t))),
        .items = plan->items,
        .n_items = plan->n_items,
        .too_long = -1};
    x->texts = (unsigned char *)x->sizes + aligned(plan->n_values * sizeof(size_t));
    if (x->kind == EXACT_STRING || x->kind == EXACT_BINARY) {
        static const char *const names[] = {"GetString", "SetString", "GetBinary", "SetBinary"};
        const ExchangeCall call = m->find(m->library, m->version, names[2 * (x->kind == EXACT_BINARY) + set]);
        memcpy(&x->call, &call, sizeof call);
        for (size_t i = 0; set && i < x->n_items; i++)
            ((unsigned char **)x->values)[x->items[i].element] = x->texts + x->items[i].text;
    } else memcpy(&x->call, &t->call3, sizeof x->call);
    t->type = ENGINE_DOUBLE;
    t->references = (const uint32_t *)(const void *)x;
    t->n_references = 0; /* it knows its variables */
    if (m->version == 2) t->call2 = set ? exact_set2 : exact_get2;
    else t->call3 = set ? exact_set3 : exact_get3;
}

static uint64_t too_long(const void *memory, uint32_t *most) {
    const ExactValues *const x = memory;
    if (x->too_long < 0) return 0;
    *most = x->items[x->too_long].size;
    return x->length;
}

const Texts texts = {room, bind, too_long};
