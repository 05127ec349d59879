/* The floating-point environment that an FMU shares with whoever calls it: rounding, flushing of subnormal numbers,
 * traps. By the processor's own instructions: <fenv.h> knows nothing of flushing, and is in a library that FMUs do not
 * link. On other processors than these nothing is seen and nothing restored. */
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H

#include <stdint.h>

/* What was changed. */
enum { ENVIRONMENT_ROUNDING = 1, ENVIRONMENT_FLUSHING = 2, ENVIRONMENT_TRAPS = 4 };

/* Its bits that change results. */
static inline uint32_t environment_bits(void) {
#if defined(__x86_64__) && defined(__GNUC__)
    uint16_t x87;
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    return (__builtin_ia32_stmxcsr() & 0xffc0u) << 16 | (x87 & 0x0f3fu);
#elif defined(__aarch64__) && defined(__GNUC__)
    uint64_t fpcr;
    __asm__ volatile("mrs %0, fpcr" : "=r"(fpcr));
    return (uint32_t)fpcr;
#else
    return 0;
#endif
}

/* Whether they differ from earlier ones, after each call of an FMU. Of x86-64 this is the register of SSE alone, which
 * the functions of <fenv.h> change together with the other one: to read both would cost more. */
static inline int environment_differs(uint32_t before) {
#if defined(__x86_64__) && defined(__GNUC__)
    return (__builtin_ia32_stmxcsr() & 0xffc0u) != before >> 16;
#else
    return environment_bits() != before;
#endif
}

/* Restores the earlier flags where they differ; returns the changed ones. */
static inline uint32_t environment_restore(uint32_t before) {
    const uint32_t changed = environment_bits() ^ before;
    if (!changed) return 0;
#if defined(__x86_64__) && defined(__GNUC__)
    const uint16_t x87 = (uint16_t)((before & 0x0f3fu) | 0x0040u);
    const uint32_t sse = changed >> 16;
    __builtin_ia32_ldmxcsr(before >> 16);
    __asm__ volatile("fnclex\n\tfldcw %0" : : "m"(x87)); /* without the traps of what was pending */
    return ((sse & 0x6000u) || (changed & 0x0f00u) ? ENVIRONMENT_ROUNDING : 0u) |
           (sse & 0x8040u ? ENVIRONMENT_FLUSHING : 0u) |
           ((sse & 0x1f80u) || (changed & 0x3fu) ? ENVIRONMENT_TRAPS : 0u);
#elif defined(__aarch64__) && defined(__GNUC__)
    const uint64_t fpcr = before;
    __asm__ volatile("msr fpcr, %0" : : "r"(fpcr));
    return (changed & 0x00c00000u ? ENVIRONMENT_ROUNDING : 0u) | (changed & 0x01080000u ? ENVIRONMENT_FLUSHING : 0u) |
           (changed & 0x9f00u ? ENVIRONMENT_TRAPS : 0u);
#else
    return 0;
#endif
}

/* Around a step that consists of many calls: arithmetic between them is in the environment of the caller, to whom is
 * left what the FMU left behind, so that the caller puts it back and says so. `kept`: both. */
static inline void environment_begin(uint32_t kept[2]) { kept[0] = kept[1] = environment_bits(); }
static inline void environment_after_call(uint32_t kept[2]) {
    if (!environment_differs(kept[0])) return;
    kept[1] = environment_bits();
    (void)environment_restore(kept[0]);
}
static inline void environment_end(const uint32_t kept[2]) {
    if (kept[1] != kept[0]) (void)environment_restore(kept[1]);
}

#endif
