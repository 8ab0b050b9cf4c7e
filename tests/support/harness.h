/* What the C harnesses share: a demand that ends the program with its line, a count of allocations, random bits, and floating-point
 * environments that a caller may have. */
#ifndef HARNESS_H
#define HARNESS_H

#include <fenv.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef __SSE2_MATH__
#include <xmmintrin.h>
#endif

static volatile long allocations;
#ifdef __has_feature
#define CLANG_SANITIZES __has_feature(address_sanitizer)
#else
#define CLANG_SANITIZES 0
#endif
#if defined(__SANITIZE_ADDRESS__) || CLANG_SANITIZES /* it has these functions itself */
enum { COUNTED = 0 };
#else
enum { COUNTED = 1 };
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
void *malloc(size_t n) { allocations++; return __libc_malloc(n); }
void *calloc(size_t n, size_t m) { allocations++; return __libc_calloc(n, m); }
void *realloc(void *p, size_t n) { allocations++; return __libc_realloc(p, n); }
#endif

#define DEMAND(condition) \
    do { if (!(condition)) { printf("line %d: %s\n", __LINE__, #condition); exit(1); } } while (0)

static uint64_t seed = 88172645463325252u;

static uint64_t bits(void) {
    seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
    return seed;
}

static double uniform(void) { return (double)(bits() >> 11) / 9007199254740992.0; }

/* Control and status of SSE; rounding and traps as <fenv.h> knows them. */
typedef struct {
    unsigned control;
    int rounding, traps;
} environment;

static environment present_environment(void) {
    environment e = {0, fegetround(), fegetexcept()};
#ifdef __SSE2_MATH__
    e.control = _mm_getcsr();
#endif
    return e;
}

/* One that a caller may have: any rounding, any traps, on x86 also flags that stand and subnormal numbers flushed. Until leave_environment()
 * the caller may compute nothing itself. */
static environment enter_any_environment(void) {
    static const int roundings[] = {FE_TONEAREST, FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    fesetround(roundings[bits() % 4]);
    if (bits() % 4) feenableexcept(FE_ALL_EXCEPT);
#ifdef __SSE2_MATH__
    if (bits() % 2) _mm_setcsr((unsigned)(bits() % 65536));
#endif
    return present_environment();
}

/* Demands that it is the one that was entered, and goes back to the default. */
static void leave_environment(environment entered) {
    const environment found = present_environment();
    fesetenv(FE_DFL_ENV);
    DEMAND(found.control == entered.control && found.rounding == entered.rounding && found.traps == entered.traps);
}

#endif
