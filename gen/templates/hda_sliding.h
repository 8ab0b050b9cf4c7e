/* The step between two changes of direction, and the step with such changes, which `hda_step.c` and the lanes of
 * `hda_native.c` and `hda_windows.c` share. */
#ifndef HDA_SLIDING_H
#define HDA_SLIDING_H

#include "hda_sizes.h"

/* RK4 with set-valued friction, each motor sliding in the given direction or stuck (0) from beginning to end. */
void hda_step_sliding(const double *x, const double *u, const double *sliding, const double *c, double h, double *next);

/* A step with set-valued friction on its way. It wants to know where hda_step_sliding leads from state `at`, with
 * directions `s`, in time `span`; whoever asks hda_follow_passage with the answer can answer for many of them at once.
 */
typedef struct {
    double at[HDA_NX], s[HDA_N], span;
    double left;                           /* time until the end of the step */
    double before[HDA_N];                  /* what each joint has left at `at` */
    double begin, end, first, last, share; /* shares of `left` about the first change, what is left there, the trial */
    int decided[HDA_N], which, event, trial, side;
    enum { HDA_WHOLE, HDA_LOCATING, HDA_LAST } phase;
} hda_passage;

void hda_begin_passage(const double *x, const double *u, const double *c, double h, hda_passage *way);

/* 1 where the step ends; `at` is then its result. */
int hda_follow_passage(const double *next, const double *u, const double *c, hda_passage *way);

/* The rest of the step alone. */
void hda_end_passage(const double *u, const double *c, hda_passage *way);

/* `steps` set-valued steps of h from each of `count` states, in place, each with its own input. In the lanes of
 * vectors, where there are some, a step in which every motor goes on sliding agrees to rounding with hda_step_exact. */
void hda_step_side_by_side(double (*x)[HDA_NX], const double (*u)[HDA_NU], const double *c, double h, long steps,
                           int count);

#endif
