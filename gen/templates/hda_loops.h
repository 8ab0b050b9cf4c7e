/* Closed loops in lanes: controller, sensors and arm of hda_loops_width() trajectories at once, tick by tick.
 *
 *     hda_loops_begin(&loops, law, x0, gains, settings, c);          // gains: hda_loops_width() rows
 *     every tick: hda_loops_tick(&loops, reference, push, felt, noise, c, known, tip, sent);
 *
 * Dry friction has the smooth sign; torques are limited in size and rate as the guard limits them, and a torque that is
 * not finite stays what it was. Faults are not looked for: a trajectory that leaves all bounds becomes NaN and stays
 * so. */
#ifndef HDA_LOOPS_H
#define HDA_LOOPS_H

#include "hda_control.h"

#define HDA_LOOPS_WIDEST 8
#define HDA_LOOPS_LATE 16 /* ticks from a sample to its use, at most */

/* period, steps in a period, delay (ticks); resolution of motor and joint encoders, torque limit, torque rate, torque a
 * unit of input, of each joint */
#define HDA_LOOPS_SETTINGS (3 + 5 * HDA_N)

/* Numbers of each lane side by side. */
typedef struct {
    double x[HDA_NX][HDA_LOOPS_WIDEST];
    double state[HDA_MEMORY_MOST][HDA_LOOPS_WIDEST];
    double gains[HDA_GAINS_MOST][HDA_LOOPS_WIDEST];
    double prepared[512][HDA_LOOPS_WIDEST];
    double sent[HDA_N][HDA_LOOPS_WIDEST];
    double seen[HDA_LOOPS_LATE + 1][2 * HDA_N][HDA_LOOPS_WIDEST]; /* of the last ticks, in turn */
    double felt[HDA_LOOPS_LATE + 1][HDA_WRENCH];
    double settings[HDA_LOOPS_SETTINGS];
    hda_input_state input[HDA_LOOPS_WIDEST];
    long ticks;
    int32_t law;
} hda_loops;

#ifdef __cplusplus
extern "C" {
#endif

/* Trajectories that are advanced at once. */
HDA_API int hda_loops_width(void);

/* Begins at rest: x0 (HDA_NX) for all, gains (width, HDA_GAINS_MOST). 0, or -1 where law, delay or steps are out of
 * range. */
HDA_API int hda_loops_begin(hda_loops *loops, int law, const double *x0, const double *gains, const double *settings,
                            const double *c);

/* One tick: `push` (HDA_WRENCH) acts on the tip, `felt` is what its sensor says of it, `noise` (2 HDA_N) is added to
 * what the encoders of motors and joints see before they count; c of the arm, `known` that of the controller's model.
 * Writes the tip at the tick's instant (width, HDA_TIP) and the torques sent (width, HDA_N). */
HDA_API void hda_loops_tick(hda_loops *loops, const double *reference, const double *push, const double *felt,
                            const double *noise, const double *c, const double *known, double *tip, double *sent);

#ifdef __cplusplus
}
#endif

#endif
