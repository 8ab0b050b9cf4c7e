/* The torque limiter: finite first, then the size, then the rate. In another order NaN becomes full torque. */
#include "hda_limit.h"

#include <stdint.h>
#include <string.h>

int hda_finite(double x) {
    const uint64_t exponent = UINT64_C(0x7ff0000000000000);
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits & exponent) != exponent;
}

double hda_limit(double wanted, double last, double limit, double rate_step) {
    const double low = last - rate_step, high = last + rate_step;
    double out = hda_finite(wanted) ? wanted : 0.0;
    if (out > limit) out = limit;
    if (out < -limit) out = -limit;
    if (out > high) out = high;
    if (out < low) out = low;
    return out;
}

double hda_magnitude(double x) {
    return x < 0.0 ? -x : x;
}

int hda_not_finite(const double *x, int count) {
    for (int i = 0; i < count; i++)
        if (!hda_finite(x[i])) return i + 1;
    return 0;
}

/* Four Newton steps from above give the square root of 1 to 2 to the last bit. */
double hda_length(double x, double y) {
    const double a = hda_magnitude(x), b = hda_magnitude(y);
    const double large = a > b ? a : b, small = a > b ? b : a;
    if (!(large > 0.0)) return a + b;
    const double square = 1.0 + (small / large) * (small / large);
    double root = 0.5 * (1.0 + square);
    for (int i = 0; i < 4; i++) root = 0.5 * (root + square / root);
    return large * root;
}
