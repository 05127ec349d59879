/* Vector instructions that processor and operating system have, by the processor's own instructions: not every
 * compiler's library has what __builtin_cpu_supports needs. Bit 0: AVX2 and FMA; bit 1: AVX-512 F, DQ, VL as well. */
#if defined(__x86_64__)
#include <cpuid.h>
#endif

#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
unsigned cosim_processor(void) {
    unsigned found = 0;
#if defined(__x86_64__)
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1u) || !(c >> 28 & 1u)) return 0; /* OSXSAVE, AVX */
    const unsigned fma = c >> 12 & 1u;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 0;
    if ((low & 0x6u) == 0x6u && fma & b >> 5) found |= 1u;
    if (found && (low & 0xe6u) == 0xe6u && b >> 16 & b >> 17 & b >> 31 & 1u) found |= 2u;
#endif
    return found;
}
