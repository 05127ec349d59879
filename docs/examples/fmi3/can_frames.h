/* Operations of FMI-LS-BUS for CAN, as far as the examples need them. All numbers are little-endian.
 *
 *     operation            code  bytes behind code and length (4 bytes each; the length is that of the whole operation)
 *     Transmit             0x10  identifier (4), extended (1), remote (1), number of data bytes (2), data
 *     Confirm              0x20  identifier (4)
 */
#ifndef CAN_FRAMES_H
#define CAN_FRAMES_H

#include "bytes.h"

#include <string.h>

enum { TRANSMIT = 0x10, CONFIRM = 0x20, HEADER = 8, TRANSMIT_SIZE = 16, CONFIRM_SIZE = 12 };

typedef struct {
    uint32_t id;
    bool extended;
    uint16_t n;
    uint8_t data[8];
} Frame;

static uint32_t number(const uint8_t *p, int n) {
    uint32_t x = 0;
    for (int i = 0; i < n; i++) x |= (uint32_t)p[i] << 8 * i;
    return x;
}

static void put(Bytes *b, uint32_t x, int n) {
    for (int i = 0; i < n; i++) b->data[b->size++] = (uint8_t)(x >> 8 * i);
}

static void write_transmit(Bytes *b, const Frame *f) {
    if (b->size + TRANSMIT_SIZE + f->n > sizeof b->data) return;
    put(b, TRANSMIT, 4), put(b, TRANSMIT_SIZE + f->n, 4), put(b, f->id, 4);
    put(b, f->extended, 1), put(b, 0, 1), put(b, f->n, 2);
    memcpy(b->data + b->size, f->data, f->n);
    b->size += f->n;
}

static void write_confirm(Bytes *b, uint32_t id) {
    if (b->size + CONFIRM_SIZE > sizeof b->data) return;
    put(b, CONFIRM, 4), put(b, CONFIRM_SIZE, 4), put(b, id, 4);
}

/* The operation at `*at`, which moves on; its code, or 0 at the end or where the bytes are no operation. */
static uint32_t read_operation(const Bytes *b, size_t *at, Frame *f) {
    const uint8_t *p = b->data + *at;
    if (b->size < *at + HEADER) return 0;
    const uint32_t code = number(p, 4), length = number(p + 4, 4);
    if (length < HEADER || length > b->size - *at) return 0;
    *at += length;
    if (length >= CONFIRM_SIZE) f->id = number(p + 8, 4);
    if (code != TRANSMIT) return code;
    f->n = length < TRANSMIT_SIZE ? 9 : (uint16_t)number(p + 14, 2);
    if (f->n > 8 || length < (uint32_t)TRANSMIT_SIZE + f->n) return 0;
    f->extended = p[12];
    memcpy(f->data, p + TRANSMIT_SIZE, f->n);
    return code;
}

#endif
