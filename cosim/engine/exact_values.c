/* Values that a double does not hold: see exact_values.h. */
#include "exact_values.h"

#include <string.h>

enum { WARNING = 1, ERROR = 3 }; /* statuses of FMI */

/* Four bytes of a slot; 0 for what a slot never holds, but a saved state of somebody else may. */
static uint32_t word(double slot) { return slot >= 0.0 && slot < 4294967296.0 ? (uint32_t)slot : 0; }

static double packed(const unsigned char *bytes, size_t n) {
    uint32_t word = 0;
    for (size_t i = 0; i < n; i++) word |= (uint32_t)bytes[i] << (8 * i);
    return word;
}

/* Bytes to slots; those behind them are zero. */
static void to_slots(double *slots, const unsigned char *bytes, size_t n, size_t size) {
    double *const words = slots + 1;
    for (size_t i = 0; i < (size + 3) / 4; i++)
        words[i] = 4 * i < n ? packed(bytes + 4 * i, n - 4 * i < 4 ? n - 4 * i : 4) : 0.0;
}

static void from_slots(unsigned char *bytes, const double *slots, size_t n) {
    for (size_t i = 0; i < n; i++) bytes[i] = (unsigned char)(word(slots[1 + i / 4]) >> (8 * (i % 4)));
}

static uint32_t refuse(ExactValues *e, const ExactItem *item, uint64_t length) {
    e->too_long = item - e->items;
    e->length = length;
    return ERROR;
}

static uint32_t move(ExactValues *e, void *instance) {
    typedef uint32_t (*Sized)(void *, const uint32_t *, size_t, size_t *, void *, size_t);
    if (e->kind == EXACT_BINARY)
        return ((Sized)e->call)(instance, e->references, e->n_references, e->sizes, e->values, e->n_values);
    return e->version == 2
               ? ((EngineValues2)e->call)(instance, e->references, e->n_references, e->values)
               : ((EngineValues3)e->call)(instance, e->references, e->n_references, e->values, e->n_values);
}

static uint32_t set(ExactValues *e, void *instance, const double *slots) {
    for (const ExactItem *item = e->items; item < e->items + e->n_items; item++) {
        const double *from = slots + item->at;
        if (e->kind == EXACT_INT64 || e->kind == EXACT_UINT64) {
            ((uint64_t *)e->values)[item->element] = word(from[1]) | (uint64_t)word(from[2]) << 32;
            continue;
        }
        const size_t n = word(from[0]);
        if (n > item->size) return refuse(e, item, n);
        unsigned char *text = e->texts + item->text;
        from_slots(text, from, n);
        text[n] = 0;
        if (e->kind == EXACT_BINARY) e->sizes[item->element] = n;
    }
    return move(e, instance);
}

static uint32_t get(ExactValues *e, void *instance, double *slots) {
    const uint32_t status = move(e, instance);
    if (status > WARNING) return status;
    for (const ExactItem *item = e->items; item < e->items + e->n_items; item++) {
        double *to = slots + item->at;
        if (e->kind == EXACT_INT64 || e->kind == EXACT_UINT64) {
            const uint64_t whole = ((const uint64_t *)e->values)[item->element];
            to[0] = e->kind == EXACT_INT64 ? (double)(int64_t)whole : (double)whole;
            to[1] = (double)(whole & 0xffffffff);
            to[2] = (double)(whole >> 32);
            continue;
        }
        const unsigned char *text = ((const unsigned char *const *)e->values)[item->element];
        size_t n = 0;
        if (e->kind == EXACT_BINARY) n = e->sizes[item->element];
        else while (text && n <= item->size && text[n]) n++;
        if (n > item->size) return refuse(e, item, n);
        if (!text && n) return ERROR;
        to[0] = (double)n;
        to_slots(to, text, n, item->size);
    }
    return status;
}

#define EXACT ((ExactValues *)(void *)(uintptr_t)exact)
uint32_t exact_set2(void *instance, const uint32_t *exact, size_t n, void *slots) {
    (void)n;
    return set(EXACT, instance, slots);
}
uint32_t exact_set3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots) {
    (void)n_slots;
    return exact_set2(instance, exact, n, slots);
}
uint32_t exact_get2(void *instance, const uint32_t *exact, size_t n, void *slots) {
    (void)n;
    return get(EXACT, instance, slots);
}
uint32_t exact_get3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots) {
    (void)n_slots;
    return exact_get2(instance, exact, n, slots);
}
