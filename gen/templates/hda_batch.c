/* Rollouts of many trajectories at once, HDA_BATCH_WIDTH of them in the lanes of a vector. */
#include "hda_model.h"
#include "hda_parts.h"

#if HDA_LANES && !HDA_STIFF

#include "hda_batch_step.h"

/* One row of all lanes: load the inputs, step, store. */
static void advance_row(const double *const *u, const hda_batch *c, double h, long steps, hda_batch *x,
                        double *const *out) {
    hda_batch in[HDA_NU];
#define INPUT(lane) u[lane][i]
    for (int i = 0; i < HDA_NU; i++) in[i] = (hda_batch)HDA_BATCH_OF(INPUT);
#undef INPUT
    const hda_batch time = (hda_batch){0} + h;
    for (long step = 0; step < steps; step++) batch_step(x, in, NULL, c, &time);
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        for (int i = 0; i < HDA_NX; i++) out[lane][i] = x[i][lane];
    }
}

static void roll_group(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                       long first, long count, int own, double *out) {
    hda_batch x[HDA_NX], constants[HDA_NC];
    const double *in[HDA_BATCH_WIDTH];
    double *to[HDA_BATCH_WIDTH];
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        /* lanes without work repeat the last trajectory */
        const long which = first + lane < count ? first + lane : count - 1;
        in[lane] = u + which * rows * HDA_NU;
        to[lane] = out + which * (rows + 1) * HDA_NX;
        for (int i = 0; i < HDA_NX; i++) x[i][lane] = x0[which * HDA_NX + i];
        for (int i = 0; i < HDA_NC; i++) constants[i][lane] = c[(own ? which * HDA_NC : 0) + i];
    }
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        for (int i = 0; i < HDA_NX; i++) to[lane][i] = x[i][lane];
    }
    for (long k = 0; k < rows; k++) {
        const long steps = hda_parts(dt[k], most);
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) to[lane] += HDA_NX;
        advance_row(in, constants, dt[k] / (double)steps, steps, x, to);
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) in[lane] += HDA_NU;
    }
}

int hda_batch_width(void) {
    return HDA_BATCH_WIDTH;
}

void hda_rollout_batch(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                       long count, int own, double *x) {
    for (long first = 0; first < count; first += HDA_BATCH_WIDTH)
        roll_group(x0, u, c, dt, rows, most, first, count, own, x);
}

#else

int hda_batch_width(void) {
    return 1;
}

void hda_rollout_batch(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                       long count, int own, double *x) {
    for (long k = 0; k < count; k++) {
        hda_rollout(x0 + k * HDA_NX, u + k * rows * HDA_NU, c + (own ? k * HDA_NC : 0), dt, rows, most,
                    x + k * (rows + 1) * HDA_NX);
    }
}

#endif
