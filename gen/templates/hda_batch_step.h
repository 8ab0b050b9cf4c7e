/* A step of RK4 over HDA_BATCH_WIDTH trajectories, one in each lane of a vector. */
#include "hda_batch_rhs.h"

#include <stddef.h>

/* s: directions of sliding (HDA_N), each motor sliding so from beginning to end; NULL: friction with the smooth sign.
 */
static inline __attribute__((always_inline)) void batch_step(hda_batch *x, const hda_batch *u, const hda_batch *s,
                                                             const hda_batch *c, const hda_batch *time) {
    hda_batch k[HDA_NX], y[HDA_NX], from[HDA_NX];
    const hda_batch h = *time, reach[4] = {0.5 * h, 0.5 * h, h, {0}}, weight[4] = {h / 6.0, h / 3.0, h / 3.0, h / 6.0};
    for (int i = 0; i < HDA_NX; i++) from[i] = x[i];
    for (int stage = 0; stage < 4; stage++) { /* slopes stay in registers: each is used up before the next */
        if (s) {
            batch_rhs_exact(stage ? y : from, u, s, c, k);
        } else {
            batch_rhs(stage ? y : from, u, c, k);
        }
        for (int i = 0; i < HDA_NX; i++) {
            y[i] = from[i] + reach[stage] * k[i];
            x[i] += weight[stage] * k[i];
        }
    }
}
