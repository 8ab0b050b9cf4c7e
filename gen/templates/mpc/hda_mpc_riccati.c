/* Riccati's recursion over the horizon, sizes fixed, inner loops along columns so that they become vectors.
 *
 * Legend: value of node k + 1: 1/2 x'P x + x'S p + 1/2 p'Z p + e'x + o'p, p the torque before (T_k itself); Q.. blocks of node k;
 * M = Quu - D. Only T - p couples p to its node, so p costs n columns and no rows: Qup = -D.
 * Z = D Quu^-1 M rather than D - D Quu^-1 D, which cancels where a rate stands at its bound.
 * Source: Rao, Wright, Rawlings, J. Optim. Theory Appl. 99 (1998) 723. */
#include "hda_mpc_riccati.h"

#include <string.h>

enum { NX = HDA_MPC_NX, NU = HDA_N, N = HDA_MPC_N, SIMPLES = HDA_MPC_SIMPLES, NG = HDA_MPC_NG, HARD = HDA_MPC_HARD, ROWS = HDA_MPC_ROWS, XX = NX * NX, XU = NX * NU };

static const int simple[] = HDA_MPC_SIMPLE;

void hda_mpc_turn(const hda_mpc_qp *qp, hda_mpc_factors *f) {
    for (int k = 0; k < N; k++)
        for (int j = 0; j < NX; j++)
            for (int i = 0; i < NX; i++) f->turned[k * XX + i * NX + j] = qp->A[k * XX + j * NX + i];
}

/* C (NX x columns) = A (NX x NX) X. */
static inline void times(const double *restrict A, const double *restrict X, int columns, double *restrict C) {
    for (int j = 0; j < columns; j++) {
        double sum[NX] = {0};
        for (int l = 0; l < NX; l++)
            for (int i = 0; i < NX; i++) sum[i] += A[l * NX + i] * X[j * NX + l];
        for (int i = 0; i < NX; i++) C[j * NX + i] = sum[i];
    }
}

static inline double dot(const double *restrict a, const double *restrict b) {
    double sum = 0.0;
    for (int i = 0; i < NX; i++) sum += a[i] * b[i];
    return sum;
}

/* P += H + the weighted rows of the state. */
static inline void weigh(const hda_mpc_qp *qp, int k, const double *weight, double *restrict P) {
    for (int i = 0; i < NX * NX; i++) P[i] += qp->H[k * XX + i];
    for (int i = 0; i < SIMPLES; i++) P[simple[i] * (NX + 1)] += weight[HARD + i];
    for (int g = 0; g < NG; g++) {
        const double w = weight[HARD + SIMPLES + g];
        const double *restrict row = qp->G + (k * NG + g) * NX;
        if (w == 0.0) continue;
        for (int j = 0; j < NX; j++)
            for (int i = 0; i < NX; i++) P[j * NX + i] += w * row[j] * row[i];
    }
}

/* inverse of Q (NU x NU), by L D L'; 0, or -1 where a pivot is not positive. */
static inline int invert(double *restrict Q, double *restrict inverse) {
    double pivot[NU], most = 0.0;
    for (int i = 0; i < NU; i++) most = Q[i * NU + i] > most ? Q[i * NU + i] : most;
    for (int j = 0; j < NU; j++) {
        pivot[j] = Q[j * NU + j];
        for (int m = 0; m < j; m++) pivot[j] -= Q[m * NU + j] * Q[m * NU + j] * pivot[m];
        if (!(pivot[j] > 1e-14 * most) || !(pivot[j] < 1e200)) return -1;
        for (int i = j + 1; i < NU; i++) {
            double value = Q[j * NU + i];
            for (int m = 0; m < j; m++) value -= Q[m * NU + i] * Q[m * NU + j] * pivot[m];
            Q[j * NU + i] = value / pivot[j];
        }
    }
    for (int c = 0; c < NU; c++) {
        double y[NU];
        for (int i = 0; i < NU; i++) {
            y[i] = i == c ? 1.0 : 0.0;
            for (int m = 0; m < i; m++) y[i] -= Q[m * NU + i] * y[m];
        }
        for (int i = NU - 1; i >= 0; i--) {
            y[i] /= pivot[i];
            for (int m = i + 1; m < NU; m++) y[i] -= Q[i * NU + m] * inverse[c * NU + m];
            inverse[c * NU + i] = y[i];
        }
    }
    return 0;
}

/* One node backwards: P, S, Z of node k + 1 become those of node k. */
static inline int back(const hda_mpc_qp *qp, int k, const double *weight, hda_mpc_factors *f, double *restrict P, double *restrict S, double *restrict Z) {
    double PA[NX * NX], PBS[NX * NU], M[NU * NU], Q[NU * NU], SD[NX * NU], next[NX * NX];
    const double *A = qp->A + k * XX, *B = qp->B + k * XU, *b = qp->b + k * NX, *turned = f->turned + k * XX;
    double *restrict reach = f->reach + k * XU, *restrict gain = f->gain + k * XU, *restrict inverse = f->inverse + k * NU * NU, *restrict step = f->step + k * NU;
    weigh(qp, k, weight, P);
    times(P, A, NX, PA);
    times(P, B, NU, PBS);
    times(P, b, 1, f->moved + k * NX);
    for (int j = 0; j < NU; j++) {
        f->pulled[k * NU + j] = dot(S + j * NX, b);
        for (int i = 0; i < NU; i++) M[j * NU + i] = dot(B + i * NX, PBS + j * NX) + dot(B + i * NX, S + j * NX) + dot(S + i * NX, B + j * NX) + Z[j * NU + i];
    }
    for (int i = 0; i < NX * NU; i++) PBS[i] += S[i];
    times(turned, PBS, NU, reach);
    for (int j = 0; j < NU; j++) {
        step[j] = qp->D[k * NU + j] + weight[NU + j];
        M[j * NU + j] += qp->R[k * NU + j] + weight[j];
    }
    for (int i = 0; i < NU * NU; i++) Q[i] = M[i];
    for (int j = 0; j < NU; j++) Q[j * NU + j] += step[j];
    if (invert(Q, inverse)) return -1;
    memset(gain, 0, XU * sizeof *gain);
    for (int j = 0; j < NU; j++)
        for (int m = 0; m < NU; m++)
            for (int i = 0; i < NX; i++) gain[j * NX + i] += inverse[j * NU + m] * reach[m * NX + i];
    times(turned, PA, NX, next);
    for (int m = 0; m < NU; m++)
        for (int j = 0; j < NX; j++)
            for (int i = 0; i < NX; i++) next[j * NX + i] -= gain[m * NX + i] * reach[m * NX + j];
    for (int j = 0; j < NX; j++)
        for (int i = 0; i < NX; i++) P[j * NX + i] = 0.5 * (next[j * NX + i] + next[i * NX + j]);
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NX; i++) SD[j * NX + i] = gain[j * NX + i] * step[j];
    memcpy(S, SD, sizeof SD);
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NU; i++) {
            double sum = 0.0;
            for (int m = 0; m < NU; m++) sum += inverse[m * NU + i] * M[j * NU + m];
            Q[j * NU + i] = step[i] * sum;
        }
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NU; i++) Z[j * NU + i] = 0.5 * (Q[j * NU + i] + Q[i * NU + j]);
    return 0;
}

int hda_mpc_factor(const hda_mpc_qp *qp, const double *weight, hda_mpc_factors *f) {
    double P[NX * NX] = {0}, S[NX * NU] = {0}, Z[NU * NU] = {0};
    for (int k = N - 1; k >= 0; k--)
        if (back(qp, k, weight + k * ROWS, f, P, S, Z)) return -1;
    return 0;
}

/* The slope of the cost by the state of node k + 1. */
static inline void tilt(const hda_mpc_qp *qp, int k, const double *slope, double *restrict e) {
    for (int i = 0; i < NX; i++) e[i] += qp->h[k * NX + i];
    for (int i = 0; i < SIMPLES; i++) e[simple[i]] += slope[HARD + i];
    for (int g = 0; g < NG; g++) {
        const double s = slope[HARD + SIMPLES + g];
        for (int i = 0; i < NX; i++) e[i] += s * qp->G[(k * NG + g) * NX + i];
    }
}

static inline void values(const hda_mpc_qp *qp, int k, const double *T, const double *before, const double *x, double *row) {
    for (int j = 0; j < NU; j++) {
        row[j] = T[j];
        row[NU + j] = T[j] - before[j];
    }
    for (int i = 0; i < SIMPLES; i++) row[HARD + i] = x[simple[i]];
    for (int g = 0; g < NG; g++) row[HARD + SIMPLES + g] = dot(qp->G + (k * NG + g) * NX, x);
}

void hda_mpc_solve(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *slope, double *T, double *x, double *rows) {
    static const double still[NU];
    double e[NX] = {0}, o[NU] = {0}, idle[N * NU];
    for (int k = N - 1; k >= 0; k--) { /* idle = Quu^-1 qu */
        const double *lean = slope + k * ROWS;
        double q[NU], next[NX];
        tilt(qp, k, slope + k * ROWS, e);
        for (int i = 0; i < NX; i++) e[i] += f->moved[k * NX + i];
        for (int j = 0; j < NU; j++)
            q[j] = qp->r[k * NU + j] + lean[j] + qp->d[k * NU + j] + lean[NU + j] + dot(qp->B + k * XU + j * NX, e) + f->pulled[k * NU + j] + o[j];
        for (int i = 0; i < NU; i++) {
            idle[k * NU + i] = 0.0;
            for (int j = 0; j < NU; j++) idle[k * NU + i] += f->inverse[(k * NU + j) * NU + i] * q[j];
        }
        times(f->turned + k * XX, e, 1, next);
        for (int j = 0; j < NU; j++)
            for (int i = 0; i < NX; i++) next[i] -= f->gain[k * XU + j * NX + i] * q[j];
        memcpy(e, next, sizeof e);
        for (int j = 0; j < NU; j++) o[j] = f->step[k * NU + j] * idle[k * NU + j] - qp->d[k * NU + j] - lean[NU + j];
    }
    for (int k = 0; k < N; k++) {
        const double *now = k ? x + (k - 1) * NX : qp->first, *before = k ? T + (k - 1) * NU : still;
        for (int i = 0; i < NU; i++) {
            double sum = idle[k * NU + i] + dot(f->gain + k * XU + i * NX, now);
            for (int j = 0; j < NU; j++) sum -= f->inverse[(k * NU + j) * NU + i] * f->step[k * NU + j] * before[j];
            T[k * NU + i] = -sum;
        }
        double next[NX];
        times(qp->A + k * XX, now, 1, next);
        for (int j = 0; j < NU; j++)
            for (int i = 0; i < NX; i++) next[i] += qp->B[k * XU + j * NX + i] * T[k * NU + j];
        for (int i = 0; i < NX; i++) x[k * NX + i] = next[i] + qp->b[k * NX + i];
        values(qp, k, T + k * NU, before, x + k * NX, rows + k * ROWS);
    }
}
