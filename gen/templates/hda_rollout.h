/* Rollouts. Row k of u is held for dt[k] (s), in steps of at most `most` (s); x gets rows + 1 rows, the first is x0. */
#ifndef HDA_ROLLOUT_H
#define HDA_ROLLOUT_H

#include "hda_limit.h" /* HDA_API */

#ifdef __cplusplus
extern "C" {
#endif

/* Dry friction with the smooth sign. */
HDA_API void hda_rollout(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                         double *x);

/* Dry friction set-valued: a motor at rest stays exactly where it is until the load overcomes it. */
HDA_API void hda_rollout_exact(const double *x0, const double *u, const double *c, const double *dt, long rows,
                               double most, double *x);

/* `count` trajectories, row after row of each, with smooth friction; own: each has its own c, one after the other. */
HDA_API void hda_rollout_batch(const double *x0, const double *u, const double *c, const double *dt, long rows,
                               double most, long count, int own, double *x);

/* Windows of rows edges[2w] up to edges[2w + 1], set-valued: each begins with its own positions and velocities, begun
 * (windows, HDA_MECHANICAL), and with the effects' own states as in memory (windows, HDA_NX - HDA_MECHANICAL), or,
 * where that is NULL, as the window before left them (0 where it ended elsewhere). jump (all rows, HDA_NX; NULL: none)
 * is added to the state in each row. A window stays where it is once a state would be beyond limit (HDA_NX). x gets the
 * state in each row of each window, one after the other. */
HDA_API void hda_rollout_windows(const double *begun, const double *memory, const int *edges, long windows,
                                 const double *u, const double *c, const double *dt, double most, const double *jump,
                                 const double *limit, double *x);

/* `count` lanes, each as hda_rollout_windows with begun, memory, u (`rows` of them), c, jump and x of its own, one lane
 * after the other. In the lanes of vectors, where there are some, a step in which every motor goes on sliding agrees to
 * rounding. */
HDA_API void hda_rollout_windows_batch(const double *begun, const double *memory, const int *edges, long windows,
                                       const double *u, const double *c, const double *dt, long rows, double most,
                                       const double *jump, const double *limit, long count, double *x);

/* What the joints' encoders show, seen (rows, HDA_N), made as old as their readings are (age, HDA_N, s): x (rows,
 * HDA_NX) are the states at `time`, path the number of the path that each row is on; rows further apart than `far` (s)
 * are no neighbours. */
HDA_API void hda_late(const double *x, const double *time, const int *path, long rows, double far, const double *age,
                      double *seen);

/* Trajectories that are advanced at once. */
HDA_API int hda_batch_width(void);

#ifdef __cplusplus
}
#endif

#endif
