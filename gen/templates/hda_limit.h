/* The torque limiter, and the finite test it rests on. Pure functions, no libm; proved in
 * tests/firmware/test_guard_proof.py. */
#ifndef HDA_LIMIT_H
#define HDA_LIMIT_H

#ifdef __FAST_MATH__
#error "the limiter compares with NaN and infinities in mind: compile without -ffast-math and -Ofast"
#endif

#include <float.h>

#if FLT_EVAL_METHOD < 0 || FLT_EVAL_METHOD == 2
#error "the limits hold for doubles, not for what x87 makes of them: compile with -msse2 -mfpmath=sse"
#endif

#ifndef HDA_API
#ifdef __GNUC__
#define HDA_API __attribute__((visibility("default")))
#else
#define HDA_API
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The torque nearest to wanted that is within limit and within rate_step of last; aims at 0 where wanted is not finite.
 * Needs finite |last| <= limit, rate_step >= 0. The step may exceed rate_step by the rounding of last +- rate_step. */
HDA_API double hda_limit(double wanted, double last, double limit, double rate_step);

/* 1 where x is neither NaN nor infinite, by its bits: no compiler flag changes the answer. */
HDA_API int hda_finite(double x);

/* The number, from 1, of the first of count values that is not finite; 0 where all are. */
HDA_API int hda_not_finite(const double *x, int count);

/* |x|, and the length of (x, y) within 2 units in the last place, without overflow on the way. */
HDA_API double hda_magnitude(double x);
HDA_API double hda_length(double x, double y);

#ifdef __cplusplus
}
#endif

#endif
