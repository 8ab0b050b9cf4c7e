/* In how many equal steps of at most `most` a row of length dt is integrated, s; far too many are one, which flies
 * apart and shows. */
#ifndef HDA_PARTS_H
#define HDA_PARTS_H

#include <math.h>

static inline long hda_parts(double dt, double most) {
    const double want = dt / most;
    return want > 1.0 && want < 1e6 ? (long)ceil(want - 1e-9) : 1;
}

#endif
