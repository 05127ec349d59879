/* One step of a component with its derivatives, from a saved state of the FMU: see step_derivatives.h. */
#ifdef TANGENTS
#include "saved_state.h"
#include "step_derivatives.h"

enum { N_KNOWNS = N_PARAMETERS + N_INPUTS + N_STATES };

EXPORT void step_derivatives_sizes(StepSizes *sizes) {
    const size_t memory = cosim_lanes_rows() * sizeof(lanes) + 64;
    *sizes = (StepSizes){N_PARAMETERS, N_INPUTS, N_STATES, N_OUTPUTS, memory};
}

/* Whether there is a step of this length from this time on. */
static int is_step(const State *head, const double *knowns, double h) {
    if (!(head->time - head->time == 0.0 && h > 0.0 && h <= DBL_MAX)) return 0;
    for (size_t i = 0; i < N_KNOWNS; i++)
        if (!(knowns[i] - knowns[i] == 0.0)) return 0;
#if IS_CONTINUOUS
    return h <= MAX_STEPS_PER_CALL * knowns[0]; /* its solver step */
#else
    if (head->sample < 0 || (double)head->sample >= 9007199254740992.0) return 0;
    const double next = head->start_time + (double)head->sample * SAMPLE_TIME;
    return head->time - next < SAMPLE_TIME && head->time + h - next <= MAX_STEPS_PER_CALL * SAMPLE_TIME;
#endif
}

EXPORT StepStatus step_derivatives(void *memory, const unsigned char *state, size_t size, double h, size_t n,
    const double *seeds, double *after, double *derivatives, uint64_t *its_sides) {
    struct FmuSnapshot snapshot;
    State head;
    const unsigned char *const values = state + sizeof snapshot + offsetof(State, v);
    double knowns[N_KNOWNS + 1];
    Component *const m = (Component *)(void *)(((uintptr_t)memory + 63) / 64 * 64);
    if (size != sizeof snapshot + offsetof(State, v) + (N_VALUES + N_QP_MEMORY) * sizeof(double)) return STEP_NO_STATE;
    memcpy(&snapshot, state, sizeof snapshot);
    memcpy(&head, state + sizeof snapshot, offsetof(State, v));
    if (snapshot.magic != SNAPSHOT_MAGIC || snapshot.version != SNAPSHOT_VERSION || snapshot.model != MODEL)
        return STEP_NO_STATE;
    memcpy(knowns, values, N_KNOWNS * sizeof(double));
    if (!is_step(&head, knowns, h)) return STEP_NO_STATE;
    *its_sides = 0;
    for (size_t first = 0; first == 0 || first < n; first += TANGENTS) {
        const size_t here = n - first < TANGENTS ? n - first : TANGENTS;
        memset((void *)m, 0, cosim_lanes_rows() * sizeof(lanes));
        m->time.v = head.time;
        m->start_time.v = head.start_time;
        m->sample.v = (double)head.sample;
        m->started.v = head.started;
        for (size_t i = 0; i < N_VALUES; i++) {
            memcpy(&m->v[i].v, values + i * sizeof(double), sizeof(double));
            for (size_t k = 0; k < here && i < N_KNOWNS; k++)
                ((double *)m->v[i].d)[k] = seeds[(first + k) * N_KNOWNS + i];
        }
        cosim_lanes_prepare(m);
        memcpy(m->memory, values + N_VALUES * sizeof(double), N_QP_MEMORY * sizeof(double));
        if (cosim_lanes_step(m, head.time, h, 1)) return STEP_FAILED;
        for (size_t i = 0; i < N_STATES + N_OUTPUTS; i++) {
            const lanes *const at = i < N_STATES ? X + i : Y + (i - N_STATES);
            after[i] = at->v;
            for (size_t k = 0; k < here; k++)
                derivatives[(first + k) * (N_STATES + N_OUTPUTS) + i] = slope_of(*at, (int)k);
        }
        *its_sides = (*its_sides ^ taken.sides) * 0x9e3779b97f4a7c15u + 1;
    }
    return STEP_FINE;
}
#endif
