/* The stage before the mechanics: from commands, each held over its row, to the currents that act (torques where the
 * input is torque). Delay, limits and lag are exact in discrete time; where a row of the command arrives in the middle
 * of another, its mean over that row counts, so that what moves is continuous in the parameters. Without delay and lag
 * nothing is changed by rounding. */
#ifndef HDA_INPUT_H
#define HDA_INPUT_H

#include "hda_limit.h" /* HDA_API */
#include "hda_sizes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Rows that are remembered; a delay that reaches farther back finds the oldest of them. */
#define HDA_INPUT_ROWS 512

typedef struct {
    double current[HDA_INPUT_ROWS][HDA_N]; /* what was let through */
    double length[HDA_INPUT_ROWS];         /* s, of each row */
    double acting[HDA_N];                  /* at the last instant */
    long newest, count;
} hda_input_state;

/* Begins as if `before` had been commanded for ever. */
HDA_API void hda_input_reset(hda_input_state *state, const double *before, const double *c);

/* One row: `command` is held for h s. `mean` gets the mean over the row of what acts, `at_end` what acts at its end,
 * which is what a sensor reads at the next row. */
HDA_API void hda_input_step(hda_input_state *state, const double *command, const double *c, double h, double *mean,
                            double *at_end);

#ifdef __cplusplus
}
#endif

#endif
