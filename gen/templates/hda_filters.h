/* A bank of extended Kalman filters that estimates the arm's state at a row from the rows up to it, and nothing later.
 */
#ifndef HDA_FILTERS_H
#define HDA_FILTERS_H

#include "hda_sizes.h"

enum {
    HDA_FILTERS = 10,                                /* of a bank, side by side */
    HDA_FLEXIBLE = HDA_MECHANICAL / 2 - HDA_N,       /* drives that are */
    HDA_EXTRA_LEAST = HDA_N + HDA_FLEXIBLE,          /* torques at motors and flexible links */
    HDA_EXTRA_MOST = HDA_EXTRA_LEAST + HDA_FLEXIBLE, /* and errors of joint encoders */
    HDA_CHANNELS_MOST = 4 * HDA_N,                   /* positions and velocities of motors and joints */
    HDA_BANK_REAL = 3 + HDA_NX + HDA_MECHANICAL + 3 * HDA_N
};

/* What the filters are told. Legend: M channels, E extra torques and errors, D = MECHANICAL + E. */
typedef struct {
    int channels, extra;
    /* of each channel, among motor positions, motor velocities, joint positions, joint velocities */
    const int *shows;
    const int *flexible;  /* joints whose drives are, from 0 */
    const double *read;   /* M × D, what a channel reads by state and extra */
    const double *spread; /* FILTERS × E, standard deviation of the extra */
    /* s over which the extra comes and goes; share of the rows in which none is judged; longest step, s */
    const double *memory;
    const double *limit;         /* NX, beyond which a state is lost */
    const double *vague;         /* MECHANICAL, beyond which its standard deviation is */
    const double *free;          /* N, speed from which dry friction has no slope */
    const double *ratio, *twist; /* N each, of the gears; the torsion beyond which a law is not linearised */
} hda_bank;

/* The state (NX) at row `last`, from `first` on: begun with x (FILTERS × NX), extra (FILTERS × E) and covariance
 * (FILTERS × D × D), driven by u (rows × NU), each held from its time to the next, corrected by what is measured (rows
 * × M) with a variance (M). NaN where no filter stayed within the limits. */
void hda_filter(const hda_bank *bank, const double *x, const double *extra, const double *covariance, long first,
                long last, const double *u, const double *time, const double *c, const double *measured,
                const double *variance, double *found);

#endif
