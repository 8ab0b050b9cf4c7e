/* A bank of extended Kalman filters: hdagen/prediction/kalman_filter.py says what they are, and after whom.
 *
 * All filters share the model's slopes, which are taken where the likeliest of them is, so that one filter's entry of a
 * covariance stands beside the others': the innermost loops run over filters. Of filters that are told the same only
 * the first one runs; the places behind those that run stay empty.
 */
#include "hda_filters.h"

#include <math.h>
#include <string.h>

#include "hda_model.h"
#include "hda_parts.h"
#include "hda_sliding.h"

enum {
    D_MOST = HDA_MECHANICAL + HDA_EXTRA_MOST,
    JOINT = HDA_POSITION, /* of x: positions of the joints, velocities of all, those of the joints */
    RATE = HDA_MECHANICAL / 2 + HDA_POSITION
};

#define EACH(l) for (int l = 0; l < HDA_FILTERS; l++)

typedef double lanes[HDA_FILTERS];

typedef struct {
    int count, which[HDA_FILTERS]; /* filters that run, and their places in the bank; an empty place is as the first */
    double x[HDA_FILTERS][HDA_NX];
    lanes extra[HDA_EXTRA_MOST], P[D_MOST][D_MOST];
    double slopes[HDA_MECHANICAL][D_MOST]; /* of x after a row by x and extra before; the extra fades, each by itself */
    lanes told, score;
    int lost[HDA_FILTERS];
} filters;

static int find_likeliest(const double *of) {
    int best = 0;
    EACH(l) if (of[l] > of[best]) best = l;
    return best;
}

/* to = a b of the rates' slopes: a by state alone, b by state and extra. */
static void multiply_slopes(double (*a)[D_MOST], double (*b)[D_MOST], int D, double (*to)[D_MOST]) {
    for (int i = 0; i < HDA_MECHANICAL; i++) {
        for (int j = 0; j < D; j++) {
            double sum = 0.0;
            for (int k = 0; k < HDA_MECHANICAL; k++) sum += a[i][k] * b[k][j];
            to[i][j] = sum;
        }
    }
}

/* The slopes of `steps` steps of h from x, each to the order of Runge and Kutta's. */
static void linearise_steps(const hda_bank *bank, const double *x, const double *u, const double *c, double h,
                            long steps, double (*slopes)[D_MOST]) {
    static const int slide[HDA_N] = HDA_SLIDE;
    const int D = HDA_MECHANICAL + bank->extra;
    double at[HDA_NX], by_x[HDA_NX * HDA_NX], by_u[HDA_NX * HDA_NU], by_p[HDA_NX * HDA_NP];
    double rate[HDA_MECHANICAL][D_MOST] = {{0.0}}, one[HDA_MECHANICAL][D_MOST], next[HDA_MECHANICAL][D_MOST];
    memcpy(at, x, sizeof at);
    for (int j = 0; j < HDA_N; j++) {
        if (fabs(at[slide[j]]) < bank->free[j]) at[slide[j]] = copysign(bank->free[j], at[slide[j]]);
    }
    for (int k = 0; k < HDA_FLEXIBLE; k++) { /* beyond full torque the law is stiffer than the step may bear */
        const int j = bank->flexible[k];
        const double torsion = at[k] / bank->ratio[j] - at[JOINT + j], most = bank->twist[j];
        at[JOINT + j] += torsion - fmin(fmax(torsion, -most), most);
    }
    hda_rhs_jacobian(at, u, c, by_x, by_u, by_p);
    for (int i = 0; i < HDA_MECHANICAL; i++) {
        for (int j = 0; j < HDA_MECHANICAL; j++) rate[i][j] = h * by_x[j * HDA_NX + i];
        for (int j = 0; j < HDA_N; j++) rate[i][HDA_MECHANICAL + j] = h * by_u[j * HDA_NX + i];
    }
    for (int k = 0; k < HDA_FLEXIBLE; k++) rate[RATE + bank->flexible[k]][HDA_MECHANICAL + HDA_N + k] = h;
    memcpy(one, rate, sizeof one);
    for (int order = 4; order > 1; order--) { /* rate (1 + rate / 2 (1 + rate / 3 (1 + rate / 4))) */
        multiply_slopes(rate, one, D, next);
        for (int i = 0; i < HDA_MECHANICAL; i++) {
            for (int j = 0; j < D; j++) one[i][j] = rate[i][j] + next[i][j] / order;
        }
    }
    for (int i = 0; i < HDA_MECHANICAL; i++) one[i][i] += 1.0;
    memcpy(slopes, one, sizeof one);
    for (long k = 1; k < steps; k++) {
        multiply_slopes(one, slopes, D, next);
        for (int i = 0; i < HDA_MECHANICAL; i++) {
            for (int j = HDA_MECHANICAL; j < D; j++) next[i][j] += one[i][j];
        }
        memcpy(slopes, next, sizeof next);
    }
}

/* P becomes F P F' + Q, F having the slopes above and `fade` on its diagonal below. */
static void spread_covariance(filters *f, const hda_bank *bank, double fade) {
    const int m = HDA_MECHANICAL, D = m + bank->extra;
    lanes moved[HDA_MECHANICAL][D_MOST];
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < D; j++) {
            lanes sum = {0.0};
            for (int k = 0; k < D; k++) {
                const double slope = f->slopes[i][k];
                EACH(l) sum[l] += slope * f->P[k][j][l];
            }
            EACH(l) moved[i][j][l] = sum[l];
        }
    }
    for (int i = 0; i < m; i++) {
        for (int j = 0; j <= i; j++) {
            lanes sum = {0.0};
            for (int k = 0; k < D; k++) {
                const double slope = f->slopes[j][k];
                EACH(l) sum[l] += slope * moved[i][k][l];
            }
            EACH(l) f->P[i][j][l] = f->P[j][i][l] = sum[l];
        }
        for (int j = m; j < D; j++) EACH(l) f->P[i][j][l] = f->P[j][i][l] = fade * moved[i][j][l];
    }
    for (int i = m; i < D; i++) {
        for (int j = m; j < D; j++) EACH(l) f->P[i][j][l] *= fade * fade;
        EACH(l) {
            const double size = bank->spread[f->which[l] * bank->extra + i - m];
            f->P[i][i][l] += size * size * (1.0 - fade * fade);
        }
    }
}

/* All filters over a row of dt. */
static void advance_filters(filters *f, const hda_bank *bank, const double *u, const double *c, double dt) {
    const long steps = hda_parts(dt, bank->memory[2]);
    const double h = dt / (double)steps, fade = exp(-dt / bank->memory[0]);
    double held[HDA_FILTERS][HDA_NU];
    linearise_steps(bank, f->x[find_likeliest(f->told)], u, c, h, steps, f->slopes);
    EACH(l) {
        memcpy(held[l], u, sizeof held[l]);
        for (int j = 0; j < HDA_N; j++) held[l][j] += f->extra[j][l];
    }
    hda_step_side_by_side(f->x, (const double (*)[HDA_NU])held, c, h, steps, f->count);
    EACH(l) {
        for (int k = 0; k < HDA_FLEXIBLE; k++) {
            const double push = f->extra[HDA_N + k][l] * dt;
            f->x[l][RATE + bank->flexible[k]] += push;
            f->x[l][JOINT + bank->flexible[k]] += 0.5 * push * dt;
        }
    }
    for (int k = 0; k < bank->extra; k++) EACH(l) f->extra[k][l] *= fade;
    spread_covariance(f, bank, fade);
}

/* Filters that have left their limits begin anew where they began, and are not taken any more. */
static void restart_lost(filters *f, const hda_bank *bank, const double *begun) {
    const int D = HDA_MECHANICAL + bank->extra;
    for (int l = 0; l < f->count; l++) {
        int within = 1;
        for (int i = 0; i < HDA_NX; i++) within &= fabs(f->x[l][i]) <= bank->limit[i];
        for (int i = 0; i < HDA_MECHANICAL; i++) within &= fabs(f->P[i][i][l]) < bank->vague[i] * bank->vague[i];
        f->lost[l] = !within;
        if (within) continue;
        memcpy(f->x[l], begun + f->which[l] * HDA_NX, sizeof f->x[l]);
        for (int k = 0; k < bank->extra; k++) f->extra[k][l] = 0.0;
        for (int i = 0; i < D; i++) {
            for (int j = 0; j < D; j++) f->P[i][j][l] = 0.0;
        }
    }
}

/* What the channels show beside what is expected of each filter. */
static void compare_channels(const filters *f, const hda_bank *bank, const double *u, const double *c,
                             const double *measured, lanes *error) {
    for (int i = 0; i < bank->channels; i++) EACH(l) error[i][l] = 0.0;
    for (int l = 0; l < f->count; l++) {
        double shown[HDA_CHANNELS_MOST], law[HDA_N], beyond[HDA_N], torque[HDA_N], angle[HDA_N], tip[HDA_TIP],
            rate[HDA_WRENCH];
        hda_outputs(f->x[l], u, c, shown, shown + HDA_N, law, beyond, torque, shown + 2 * HDA_N, shown + 3 * HDA_N,
                    angle, tip, rate);
        for (int i = 0; i < bank->channels; i++) error[i][l] = measured[i] - shown[bank->shows[i]];
    }
    for (int i = 0; i < bank->channels; i++) {
        const double *by_extra = bank->read + i * (HDA_MECHANICAL + bank->extra) + HDA_MECHANICAL;
        for (int k = 0; k < bank->extra; k++) EACH(l) error[i][l] -= by_extra[k] * f->extra[k][l];
    }
}

/* All filters by what a row shows; the log-likelihood of having seen it is added to `told`, and where it is to be
 * judged to `score`. With S = L L' the covariance of what is shown, V = L⁻¹ H P: P loses V'V. */
static void correct_filters(filters *f, const hda_bank *bank, const double *u, const double *c, const double *measured,
                            const double *variance, int judged) {
    const int M = bank->channels, D = HDA_MECHANICAL + bank->extra;
    lanes error[HDA_CHANNELS_MOST], V[HDA_CHANNELS_MOST][D_MOST], L[HDA_CHANNELS_MOST][HDA_CHANNELS_MOST], inverse,
        likely = {0.0};
    compare_channels(f, bank, u, c, measured, error);
    memset(V, 0, sizeof V);
    for (int i = 0; i < M; i++) {
        for (int k = 0; k < D; k++) {
            const double by = bank->read[i * D + k];
            if (by == 0.0) continue;
            for (int j = 0; j < D; j++) EACH(l) V[i][j][l] += by * f->P[k][j][l];
        }
    }
    for (int i = 0; i < M; i++) { /* S, below and on its diagonal */
        for (int j = 0; j <= i; j++) {
            EACH(l) L[i][j][l] = i == j ? variance[i] : 0.0;
            for (int k = 0; k < D; k++) {
                const double by = bank->read[j * D + k];
                if (by == 0.0) continue;
                EACH(l) L[i][j][l] += by * V[i][k][l];
            }
        }
    }
    /* Cholesky's L, and what it makes of V and the error, row by row; of L's diagonal the inverse */
    for (int i = 0; i < M; i++) {
        for (int j = 0; j <= i; j++) {
            for (int k = 0; k < j; k++) EACH(l) L[i][j][l] -= L[i][k][l] * L[j][k][l];
            if (j < i) EACH(l) L[i][j][l] *= L[j][j][l];
        }
        EACH(l) inverse[l] = 1.0 / sqrt(L[i][i][l]);
        for (int k = 0; k < i; k++) {
            EACH(l) error[i][l] -= L[i][k][l] * error[k][l];
            for (int j = 0; j < D; j++) EACH(l) V[i][j][l] -= L[i][k][l] * V[k][j][l];
        }
        EACH(l) L[i][i][l] = inverse[l];
        EACH(l) error[i][l] *= inverse[l];
        for (int j = 0; j < D; j++) EACH(l) V[i][j][l] *= inverse[l];
        EACH(l) likely[l] -= 0.5 * error[i][l] * error[i][l] - log(inverse[l]);
    }
    for (int k = 0; k < M; k++) {
        for (int i = 0; i < HDA_MECHANICAL; i++) EACH(l) f->x[l][i] += V[k][i][l] * error[k][l];
        for (int i = 0; i < bank->extra; i++) EACH(l) f->extra[i][l] += V[k][HDA_MECHANICAL + i][l] * error[k][l];
    }
    for (int i = 0; i < D; i++) {
        for (int j = 0; j <= i; j++) {
            lanes sum;
            EACH(l) sum[l] = f->P[i][j][l];
            for (int k = 0; k < M; k++) EACH(l) sum[l] -= V[k][i][l] * V[k][j][l];
            EACH(l) f->P[i][j][l] = f->P[j][i][l] = sum[l];
        }
    }
    EACH(l) {
        if (f->lost[l] || !isfinite(likely[l])) likely[l] = -INFINITY;
        f->told[l] += likely[l];
        if (f->lost[l]) f->score[l] = -INFINITY;
        if (judged) f->score[l] += likely[l];
    }
}

/* Whether filters a and b are told the same. */
static int are_alike(const hda_bank *bank, const double *x, const double *extra, const double *covariance, int a,
                     int b) {
    const int E = bank->extra, D = HDA_MECHANICAL + E;
    const size_t size = sizeof(double);
    return !memcmp(bank->spread + a * E, bank->spread + b * E, (size_t)E * size) &&
           !memcmp(x + a * HDA_NX, x + b * HDA_NX, HDA_NX * size) &&
           !memcmp(extra + a * E, extra + b * E, (size_t)E * size) &&
           !memcmp(covariance + a * D * D, covariance + b * D * D, (size_t)(D * D) * size);
}

static void begin_filters(filters *f, const hda_bank *bank, const double *x, const double *extra,
                          const double *covariance) {
    const int D = HDA_MECHANICAL + bank->extra;
    memset(f, 0, sizeof *f);
    EACH(l) {
        int is_new = 1;
        for (int k = 0; k < f->count; k++) is_new &= !are_alike(bank, x, extra, covariance, f->which[k], l);
        if (is_new) f->which[f->count++] = l;
    }
    EACH(l) {
        const int of = f->which[l];
        memcpy(f->x[l], x + of * HDA_NX, sizeof f->x[l]);
        for (int k = 0; k < bank->extra; k++) f->extra[k][l] = extra[of * bank->extra + k];
        for (int i = 0; i < D; i++) {
            for (int j = 0; j < D; j++) f->P[i][j][l] = covariance[(of * D + i) * D + j];
        }
        f->lost[l] = l >= f->count;
    }
}

void hda_filter(const hda_bank *bank, const double *x, const double *extra, const double *covariance, long first,
                long last, const double *u, const double *time, const double *c, const double *measured,
                const double *variance, double *found) {
    filters f;
    begin_filters(&f, bank, x, extra, covariance);
    for (long row = first; row < last; row++) {
        const int judged = (double)(row + 1 - first) > bank->memory[1] * (double)(last - first);
        advance_filters(&f, bank, u + row * HDA_NU, c, time[row + 1] - time[row]);
        restart_lost(&f, bank, x);
        correct_filters(&f, bank, u + (row + 1) * HDA_NU, c, measured + (row + 1) * bank->channels, variance, judged);
    }
    const int best = find_likeliest(f.score);
    int sound = isfinite(f.score[best]);
    for (int i = 0; i < HDA_NX; i++) sound &= isfinite(f.x[best][i]);
    for (int i = 0; i < HDA_NX; i++) found[i] = sound ? f.x[best][i] : NAN;
}
