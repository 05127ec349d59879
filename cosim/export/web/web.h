/* What a web page calls: models behind handles, with the functions of FMI 3.0 as the page needs them. */
#ifndef WEB_H
#define WEB_H

#include <stdint.h>

#include "component.h"

/* What an instance can be made of: the system, and those of its components that the page asks by themselves. */
typedef struct {
    const Functions3 *functions;
    const char *token;
} WebModel;

extern const WebModel web_models[];
extern const uint32_t web_n_models;

#endif
