/* The step between two changes of direction, which `hda_step.c` and the lanes of `hda_native.c` share. */
#ifndef HDA_SLIDING_H
#define HDA_SLIDING_H

/* RK4 with set-valued friction, each motor sliding in the given direction or stuck (0) from beginning to end. */
void hda_step_sliding(const double *x, const double *u, const double *sliding, const double *c, double h, double *next);

#endif
