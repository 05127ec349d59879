/* What Python calls of the engine: a shared library of its own. */
#include "engine.h"
#include "table.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT int cosim_engine_run(Engine *e, int64_t end) { return engine_run(e, end); }
EXPORT size_t cosim_engine_size(void) { return sizeof(Engine) + sizeof(EngineComponent) + sizeof(Table); }
EXPORT uint32_t cosim_table_step(void *table, double t, double h, int no_set_prior) {
    return table_step(table, t, h, no_set_prior);
}
