/* Riccati's recursion over the horizon, sizes fixed, columns as vectors.
 *
 * Legend: value of node k + 1: 1/2 x'P x + x'S p + 1/2 p'Z p + e'x + o'p, p the torque before (T_k itself); Q.. blocks
 * of node k; M = Quu - D. Only T - p couples p to its node, so p costs n columns and no rows: Qup = -D. Z = D Quu^-1 M
 * rather than D - D Quu^-1 D, which cancels where a rate stands at its bound. Source: Rao, Wright, Rawlings, J. Optim.
 * Theory Appl. 99 (1998) 723. */
#include "hda_mpc_riccati.h"

#include <string.h>

enum {
    NX = HDA_MPC_NX,
    NU = HDA_N,
    N = HDA_MPC_N,
    SIMPLES = HDA_MPC_SIMPLES,
    NG = HDA_MPC_NG,
    HARD = HDA_MPC_HARD,
    ROWS = HDA_MPC_ROWS
};

typedef double V __attribute__((vector_size(8 * HDA_MPC_NX_WIDE)));
typedef double U __attribute__((vector_size(8 * HDA_MPC_N_WIDE)));

static const int simple[] = HDA_MPC_SIMPLE;
static const V none = {0};
static const U nothing = {0};

static inline void load_column(const double *from, hda_mpc_column *to) {
    V made = {0};
    memcpy(&made, from, NX * sizeof *from);
    *to = made;
}

static inline void load_short_column(const double *from, hda_mpc_short *to) {
    U made = {0};
    memcpy(&made, from, NU * sizeof *from);
    *to = made;
}

/* sum of a column's entries: halves are added, so that it takes as many steps as the width has bits. */
static inline double sum_entries(const V *a) {
    double part[HDA_MPC_NX_WIDE];
    memcpy(part, a, sizeof part);
    for (int half = HDA_MPC_NX_WIDE / 2; half > 0; half /= 2)
        for (int i = 0; i < half; i++) part[i] += part[i + half];
    return part[0];
}

/* sum over l of M_l x_l: a matrix by its columns; two sums, so that neither waits long. */
static inline void multiply_column(const hda_mpc_column *M, const double *x, hda_mpc_column *out) {
    V even = M[0] * x[0], odd = none;
    for (int l = 1; l < NX; l += 2) odd += M[l] * x[l];
    for (int l = 2; l < NX; l += 2) even += M[l] * x[l];
    *out = even + odd;
}

static inline void multiply_short_column(const hda_mpc_short *M, const double *x, hda_mpc_short *out) {
    U even = M[0] * x[0], odd = nothing;
    for (int l = 1; l < NX; l += 2) odd += M[l] * x[l];
    for (int l = 2; l < NX; l += 2) even += M[l] * x[l];
    *out = even + odd;
}

void hda_mpc_arrange_factors(const hda_mpc_qp *qp, hda_mpc_factors *f) {
    for (int k = 0; k < N; k++) {
        hda_mpc_node *d = &f->node[k];
        double row[HDA_MPC_NX_WIDE] = {0}, across[NU];
        const double *A = qp->A + k * NX * NX, *B = qp->B + k * NX * NU;
        for (int j = 0; j < NX; j++) {
            load_column(A + j * NX, &d->A[j]);
            for (int i = 0; i < NX; i++) row[i] = A[i * NX + j];
            load_column(row, &d->turned[j]);
            for (int i = 0; i < NU; i++) across[i] = B[i * NX + j];
            load_short_column(across, &d->across[j]);
        }
        for (int j = 0; j < NU; j++) load_column(B + j * NX, &d->B[j]);
        for (int g = 0; g < NG; g++) load_column(qp->G + (k * NG + g) * NX, &d->G[g]);
        load_column(qp->b + k * NX, &d->b);
    }
}

/* P += H + the weighted rows of the state. */
static inline void add_weights(const hda_mpc_qp *qp, const hda_mpc_node *d, int k, const double *weight, V *P) {
    for (int j = 0; j < NX; j++) {
        V H;
        load_column(qp->H + (k * NX + j) * NX, &H);
        P[j] += H;
    }
    for (int i = 0; i < SIMPLES; i++) P[simple[i]][simple[i]] += weight[HARD + i];
    for (int g = 0; g < NG; g++) {
        const double w = weight[HARD + SIMPLES + g];
        if (w == 0.0) continue;
        const V row = w * d->G[g];
        for (int j = 0; j < NX; j++) P[j] += row * d->G[g][j];
    }
}

/* inverse of Q (NU x NU), by L D L'; 0, or -1 where a pivot is not positive. */
static inline int invert_inputs(U *Q, hda_mpc_short *inverse) {
    double pivot[NU], share[NU], most = 0.0;
    for (int i = 0; i < NU; i++) most = Q[i][i] > most ? Q[i][i] : most;
    for (int j = 0; j < NU; j++) {
        pivot[j] = Q[j][j];
        for (int m = 0; m < j; m++) pivot[j] -= Q[m][j] * Q[m][j] * pivot[m];
        if (!(pivot[j] > 1e-14 * most) || !(pivot[j] < 1e200)) return -1;
        share[j] = 1.0 / pivot[j];
        for (int i = j + 1; i < NU; i++) {
            double value = Q[j][i];
            for (int m = 0; m < j; m++) value -= Q[m][i] * Q[m][j] * pivot[m];
            Q[j][i] = value * share[j];
        }
    }
    for (int c = 0; c < NU; c++) {
        double y[NU];
        U column = nothing;
        for (int i = 0; i < NU; i++) {
            y[i] = i == c ? 1.0 : 0.0;
            for (int m = 0; m < i; m++) y[i] -= Q[m][i] * y[m];
        }
        for (int i = NU - 1; i >= 0; i--) {
            y[i] *= share[i];
            for (int m = i + 1; m < NU; m++) y[i] -= Q[i][m] * y[m];
            column[i] = y[i];
        }
        inverse[c] = column;
    }
    return 0;
}

/* What node k + 1 is worth. */
typedef struct worth {
    V P[NX], S[NU];
    U Z[NU];
} worth;

static inline void make_symmetric(V *P) {
    for (int j = 0; j < NX; j++)
        for (int i = 0; i < j; i++) P[j][i] = P[i][j] = 0.5 * (P[j][i] + P[i][j]);
}

/* One node backwards. */
static inline int step_backwards(const hda_mpc_qp *qp, int k, const double *weight, hda_mpc_node *d, worth *w) {
    V PA[NX], PB[NU], reach[NU], next[NX];
    U M[NU], Q[NU], Z[NU];
    add_weights(qp, d, k, weight, w->P);
    for (int j = 0; j < NX; j++) multiply_column(w->P, (const double *)&d->A[j], &PA[j]);
    for (int j = 0; j < NU; j++) multiply_column(w->P, (const double *)&d->B[j], &PB[j]);
    multiply_column(w->P, (const double *)&d->b, &d->moved);
    d->pulled = nothing;
    for (int j = 0; j < NU; j++) {
        const V product = w->S[j] * d->b, both = PB[j] + w->S[j];
        U side;
        d->pulled[j] = sum_entries(&product);
        multiply_short_column(d->across, (const double *)&both, &M[j]); /* B'(P B + S) */
        multiply_short_column(d->across, (const double *)&w->S[j], &side);
        Z[j] = side; /* B'S, by columns */
        reach[j] = both;
    }
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NU; i++) M[j][i] += Z[i][j] + w->Z[j][i];
    for (int j = 0; j < NU; j++) {
        V at;
        multiply_column(d->turned, (const double *)&reach[j], &at); /* Qux' = A'(P B + S) */
        reach[j] = at;
        d->step[j] = qp->D[k * NU + j] + weight[NU + j];
        M[j][j] += qp->R[k * NU + j] + weight[j];
        Q[j] = M[j];
        Q[j][j] += d->step[j];
    }
    if (invert_inputs(Q, d->inverse)) return -1;
    for (int j = 0; j < NU; j++) {
        V sum = reach[0] * d->inverse[j][0];
        for (int m = 1; m < NU; m++) sum += reach[m] * d->inverse[j][m];
        d->gain[j] = sum;
        d->kept[j] = d->inverse[j] * d->step[j];
        for (int i = 0; i < NX; i++) d->feed[i][j] = sum[i];
        w->S[j] = sum * d->step[j];
    }
    for (int j = 0; j < NX; j++) {
        multiply_column(d->turned, (const double *)&PA[j], &next[j]);
        for (int m = 0; m < NU; m++) next[j] -= d->gain[m] * reach[m][j];
    }
    memcpy(w->P, next, sizeof next);
    if (k % 4 == 0) make_symmetric(w->P);
    for (int j = 0; j < NU; j++) {
        U sum = d->inverse[0] * M[j][0];
        for (int m = 1; m < NU; m++) sum += d->inverse[m] * M[j][m];
        Z[j] = sum * d->step;
    }
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NU; i++) w->Z[j][i] = 0.5 * (Z[j][i] + Z[i][j]);
    return 0;
}

int hda_mpc_factor(const hda_mpc_qp *qp, const double *weight, hda_mpc_factors *f) {
    worth w;
    memset(&w, 0, sizeof w);
    for (int k = N - 1; k >= 0; k--)
        if (step_backwards(qp, k, weight + k * ROWS, &f->node[k], &w)) return -1;
    return 0;
}

/* The slope of the cost by the state of node k + 1. */
static inline void slope_of_cost(const hda_mpc_qp *qp, const hda_mpc_node *d, int k, const double *slope, V *e) {
    V h;
    load_column(qp->h + k * NX, &h);
    h += *e;
    for (int g = 0; g < NG; g++) h += d->G[g] * slope[HARD + SIMPLES + g];
    for (int i = 0; i < SIMPLES; i++) h[simple[i]] += slope[HARD + i];
    *e = h;
}

/* Values of all rows of a node. */
static inline void row_values(const hda_mpc_node *d, const U *T, const U *before, const V *x, double *row) {
    const U change = *T - *before;
    memcpy(row, T, NU * sizeof *row);
    memcpy(row + NU, &change, NU * sizeof *row);
    for (int i = 0; i < SIMPLES; i++) row[HARD + i] = (*x)[simple[i]];
    for (int g = 0; g < NG; g++) {
        const V product = d->G[g] * *x;
        row[HARD + SIMPLES + g] = sum_entries(&product);
    }
}

void hda_mpc_solve(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *slope, double *T, double *x,
                   double *rows) {
    U idle[N], o = nothing, before = nothing;
    V e = none, now;
    for (int k = N - 1; k >= 0; k--) { /* idle = Quu^-1 qu */
        const hda_mpc_node *d = &f->node[k];
        const double *lean = slope + k * ROWS;
        U q, r, change, own, turn;
        slope_of_cost(qp, d, k, lean, &e);
        e += d->moved;
        load_short_column(qp->r + k * NU, &r);
        load_short_column(qp->d + k * NU, &change);
        load_short_column(lean, &own);
        load_short_column(lean + NU, &turn);
        change += turn;
        multiply_short_column(d->across, (const double *)&e, &q);
        q += (r + own) + change + (d->pulled + o);
        V next;
        multiply_column(d->turned, (const double *)&e, &next);
        U sum = d->inverse[0] * q[0];
        for (int j = 1; j < NU; j++) sum += d->inverse[j] * q[j];
        for (int j = 0; j < NU; j++) next -= d->gain[j] * q[j];
        idle[k] = sum;
        e = next;
        o = d->step * sum - change;
    }
    load_column(qp->first, &now);
    for (int k = 0; k < N; k++) {
        const hda_mpc_node *d = &f->node[k];
        U own = idle[k], fed;
        V next;
        multiply_short_column(d->feed, (const double *)&now, &fed);
        for (int j = 0; j < NU; j++) own -= d->kept[j] * before[j];
        own = -(own + fed);
        multiply_column(d->A, (const double *)&now, &next);
        next += d->b;
        for (int j = 0; j < NU; j++) next += d->B[j] * own[j];
        row_values(d, &own, &before, &next, rows + k * ROWS);
        memcpy(T + k * NU, &own, NU * sizeof *T);
        memcpy(x + k * NX, &next, NX * sizeof *x);
        now = next;
        before = own;
    }
}

void hda_mpc_roll_out(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *held, double *x, double *rows) {
    V now;
    U T, before = nothing;
    load_column(qp->first, &now);
    load_short_column(held, &T);
    for (int k = 0; k < N; k++) {
        const hda_mpc_node *d = &f->node[k];
        V next;
        multiply_column(d->A, (const double *)&now, &next);
        next += d->b;
        for (int j = 0; j < NU; j++) next += d->B[j] * T[j];
        row_values(d, &T, &before, &next, rows + k * ROWS);
        memcpy(x + k * NX, &next, NX * sizeof *x);
        now = next;
        before = T;
    }
}
