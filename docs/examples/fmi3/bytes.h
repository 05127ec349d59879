/* A Binary of the examples. */
#ifndef BYTES_H
#define BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    size_t size;
    uint8_t data[2048];
} Bytes;

#endif
