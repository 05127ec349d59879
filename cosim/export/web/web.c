/* The functions that a page calls. Numbers cross the border as doubles, whatever their type; memory is the page's, from
 * web_memory.
 *
 * A status is that of FMI: 0 OK, 1 warning, otherwise web_message says what was wrong. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "web.h"

#define EXPORT(name) __attribute__((export_name(#name))) name
#define MOST 4096u /* variables that are read or written by one call, elements of arrays counted */

typedef struct {
    const Functions3 *f;
    void *instance;
    double start, step;   /* time = start + n * step */
    int64_t n;
    uint32_t ended;       /* the system has asked for it */
    uint32_t n_watched[3]; /* by type, in the order below */
    uint32_t watched[];    /* value references */
} Web;

enum { FLOAT64, INT32, BOOLEAN }; /* types, as the page counts them */

static char message[1024];

static void say(void *environment, fmi3Status status, fmi3String category, fmi3String text) {
    (void)environment;
    (void)category;
    if (status != fmi3OK && !message[0])
        (void)snprintf(message, sizeof message, "%s", text); /* the first says why, others that */
}

const char *EXPORT(web_message)(void) { return message; }

void *EXPORT(web_memory)(uint32_t bytes) { return malloc(bytes); }

/* A new instance of a model which shows `n_real` + `n_integer` + `n_boolean` variables; NULL where that fails. */
void *EXPORT(web_open)(
    uint32_t model, const uint32_t *references, uint32_t n_real, uint32_t n_integer, uint32_t n_boolean) {
    message[0] = 0;
    if (model >= web_n_models) return NULL;
    const uint32_t n = n_real + n_integer + n_boolean;
    Web *web = calloc(1, sizeof(Web) + n * sizeof(uint32_t));
    if (!web) return NULL;
    web->f = web_models[model].functions;
    web->n_watched[FLOAT64] = n_real;
    web->n_watched[INT32] = n_integer;
    web->n_watched[BOOLEAN] = n_boolean;
    memcpy(web->watched, references, n * sizeof(uint32_t));
    web->instance = web->f->InstantiateCoSimulation(
        "web", web_models[model].token, "", fmi3False, fmi3False, fmi3False, fmi3False, NULL, 0, NULL, say, NULL);
    if (web->instance) return web;
    free(web);
    return NULL;
}

void EXPORT(web_close)(Web *web) {
    web->f->FreeInstance(web->instance);
    free(web);
}

/* Variables of one type; `n` values, more than references where these are arrays. */
uint32_t EXPORT(web_set)(
    Web *web, uint32_t type, const uint32_t *references, uint32_t n_references, const double *values, uint32_t n) {
    static int32_t integers[MOST];
    static fmi3Boolean booleans[MOST];
    message[0] = 0;
    if (n > MOST) return fmi3Error;
    switch (type) {
    case FLOAT64: return (uint32_t)web->f->SetFloat64(web->instance, references, n_references, values, n);
    case INT32:
        for (uint32_t i = 0; i < n; i++) integers[i] = (int32_t)values[i];
        return (uint32_t)web->f->SetInt32(web->instance, references, n_references, integers, n);
    default:
        for (uint32_t i = 0; i < n; i++) booleans[i] = values[i] != 0;
        return (uint32_t)web->f->SetBoolean(web->instance, references, n_references, booleans, n);
    }
}

/* All that is shown, in the order of web_open. */
static uint32_t look(Web *web, double *row) {
    static int32_t integers[MOST];
    static fmi3Boolean booleans[MOST];
    const uint32_t r = web->n_watched[FLOAT64], i = web->n_watched[INT32], b = web->n_watched[BOOLEAN];
    if (i > MOST || b > MOST) return fmi3Error;
    fmi3Status status = r ? web->f->GetFloat64(web->instance, web->watched, r, row, r) : fmi3OK;
    if (status <= fmi3Warning && i) status = web->f->GetInt32(web->instance, web->watched + r, i, integers, i);
    if (status <= fmi3Warning && b) status = web->f->GetBoolean(web->instance, web->watched + r + i, b, booleans, b);
    for (uint32_t k = 0; k < i; k++) row[r + k] = integers[k];
    for (uint32_t k = 0; k < b; k++) row[r + i + k] = booleans[k] ? 1.0 : 0.0;
    return (uint32_t)status;
}

uint32_t EXPORT(web_look)(Web *web, double *row) { return look(web, row); }

/* From instantiated, or reset, to where steps begin; each will be `step` long. */
uint32_t EXPORT(web_start)(Web *web, double start, double step) {
    message[0] = 0;
    web->start = start;
    web->step = step;
    web->n = 0;
    web->ended = 0;
    const fmi3Status status = web->f->EnterInitializationMode(web->instance, fmi3False, 0, start, fmi3False, 0);
    return (uint32_t)(status > fmi3Warning ? status : web->f->ExitInitializationMode(web->instance));
}

uint32_t EXPORT(web_reset)(Web *web) {
    message[0] = 0;
    return (uint32_t)web->f->Reset(web->instance);
}

/* Up to `n` steps, a row of what is shown after each; returns how many were done. Fewer than asked: one has failed,
 * unless web_ended says that the system has asked for its end. */
uint32_t EXPORT(web_run)(Web *web, uint32_t n, uint32_t width, double *rows) {
    message[0] = 0;
    for (uint32_t k = 0; k < n; k++) {
        fmi3Boolean event = fmi3False, ended = fmi3False, early = fmi3False;
        fmi3Float64 last = 0;
        const double time = web->start + (double)web->n * web->step;
        if (web->f->DoStep(web->instance, time, web->step, fmi3True, &event, &ended, &early, &last) > fmi3Warning)
            return k;
        web->n++;
        if (look(web, rows + (size_t)k * width) > fmi3Warning) return k;
        if (ended) {
            web->ended = 1;
            return k + 1;
        }
    }
    return n;
}

uint32_t EXPORT(web_ended)(const Web *web) { return web->ended; }
