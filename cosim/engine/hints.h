/* Hints to compilers about code that hardly ever runs. */
#ifndef HINTS_H
#define HINTS_H

#if defined(__GNUC__)
#define RARELY(condition) __builtin_expect(condition, 0)
#define COLD static __attribute__((noinline, cold, unused))
#else
#define RARELY(condition) (condition)
#define COLD static
#endif

#endif
