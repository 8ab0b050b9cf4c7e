/* The floating-point environment in which the guard and the controllers compute: to nearest, no trap, no flush to zero.
 * A function that a control loop calls holds it and gives the caller its own back, flags included, so that it neither
 * raises nor obeys anything of the caller's:
 *
 *     const hda_float caller = hda_float_hold();
 *     status = computed apart(...);
 *     hda_float_restore(&caller);
 *
 * HDA_APART marks what computes between the two: a compiler may move arithmetic of the same function to before the one
 * or after the other. Where there is no <fenv.h> (freestanding, and not x86-64), or HDA_FLOAT_AS_IT_IS is defined,
 * nothing is held: the caller sees to that environment. */
#ifndef HDA_FLOAT_H
#define HDA_FLOAT_H

#ifdef __GNUC__
#define HDA_APART __attribute__((noinline))
#else
#define HDA_APART
#endif

#if defined(HDA_FLOAT_AS_IT_IS) || (!defined(__x86_64__) && !__STDC_HOSTED__)
#define HDA_FLOAT_BY_NOTHING
#elif !defined(__x86_64__)
/* <fenv.h> takes some hundred cycles on x86, and there is nothing else to know of 64 bits of it */
#define HDA_FLOAT_BY_FENV
#include <fenv.h>
#endif

#if defined(__SSE2_MATH__) && !defined(HDA_FLOAT_BY_NOTHING)
#define HDA_FLOAT_BY_SSE
#include <xmmintrin.h>
#endif

typedef struct {
#ifdef HDA_FLOAT_BY_FENV
    fenv_t environment;
#endif
    unsigned control;
    int known;
} hda_float;

static inline hda_float hda_float_hold(void) {
    hda_float caller;
    caller.control = 0;
    caller.known = 0;
#ifdef HDA_FLOAT_BY_SSE
    caller.control = _mm_getcsr();
#endif
#ifdef HDA_FLOAT_BY_FENV
    caller.known = fegetenv(&caller.environment) == 0 && fesetenv(FE_DFL_ENV) == 0;
#endif
#ifdef HDA_FLOAT_BY_SSE
    _mm_setcsr(0x1f80u); /* to nearest, all exceptions masked, none raised, neither FTZ nor DAZ */
#endif
    return caller;
}

static inline void hda_float_restore(const hda_float *caller) {
#ifdef HDA_FLOAT_BY_FENV
    if (caller->known) fesetenv(&caller->environment);
#endif
#ifdef HDA_FLOAT_BY_SSE
    _mm_setcsr(caller->control);
#endif
    (void)caller;
}

#endif
