/* The active set: rows at a bound enter by an augmented Lagrangian, so that a set may be degenerate, and rows beyond a soft bound by their
 * penalty. The set is corrected by the signs and sizes of multipliers until it stands (a semi-smooth Newton method).
 *
 * Legend: y multiplier, positive where high holds. A soft row at its bound has y up to `linear`; beyond it y = linear + square * violation.
 * Sources: Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2002) 865; Ito, Kunisch, Lagrange Multiplier Approach (2008), for the penalty. */
#include "hda_mpc_solver.h"

#include <string.h>

enum { N = HDA_MPC_N, ROWS = HDA_MPC_ROWS, ALL = N * ROWS };

#define STIFF 1e6   /* weight of a row at its bound */
#define FEASIBLE 1e-10
#define SLIGHT 1e-9 /* of values and multipliers that decide on the set */

static inline double larger(double a, double b) { return a > b ? a : b; }

static inline double size(double a) { return a < 0.0 ? -a : a; }

static int finite(const double *a, int count, double most) {
    int good = 1;
    for (int i = 0; i < count; i++) good &= a[i] <= most && a[i] >= -most;
    return good;
}

static int not_negative(const double *a, int count) {
    int good = 1;
    for (int i = 0; i < count; i++) good &= a[i] >= 0.0;
    return good;
}

int hda_mpc_legal(const hda_mpc_qp *qp) {
    const double *all = (const double *)qp;
    const int begun = (int)(qp->low - all);
    int good = finite(all, begun, HDA_MPC_LARGEST) && finite(qp->linear, ALL, 1e100) && finite(qp->square, ALL, HDA_MPC_LARGEST);
    good = good && not_negative(qp->linear, ALL) && not_negative(qp->square, ALL);
    good = good && not_negative(qp->R, N * HDA_N) && not_negative(qp->D, N * HDA_N);
    for (int e = 0; e < ALL; e++) good &= qp->low[e] <= qp->high[e] && qp->low[e] < HDA_MPC_FREE && qp->high[e] > -HDA_MPC_FREE;
    for (int k = 0; k < N; k++)
        for (int i = 0; i < HDA_MPC_HARD; i++) good &= qp->linear[k * ROWS + i] >= HDA_MPC_FREE;
    return good;
}

/* The set from the multipliers of an earlier or a rough solution. */
static void guess(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
            const double y = w->y[e], most = qp->linear[e];
            const double share = size(y);
            int code = share > 1e-7 ? (share > most + SLIGHT * (1.0 + most) ? 2 : 1) : 0;
            if (code && (y > 0.0 ? qp->high[e] >= HDA_MPC_FREE : qp->low[e] <= -HDA_MPC_FREE)) code = 0;
            w->set[e] = y < 0.0 ? -code : code;
            if (!code) w->y[e] = 0.0;
        }
}

static void weights(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
            const int code = w->set[e];
            w->weight[e] = code == 0 ? 0.0 : code == 1 || code == -1 ? STIFF : qp->square[e];
        }
}

static void slopes(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
            const int code = w->set[e];
            const double bound = code > 0 ? qp->high[e] : qp->low[e];
            double s = 0.0;
            if (code == 1 || code == -1) s = w->y[e] - STIFF * bound;
            else if (code) s = (code > 0 ? qp->linear[e] : -qp->linear[e]) - qp->square[e] * bound;
            w->slope[e] = s;
        }
}

/* Multipliers after a solution; the largest distance of a row in the set from its bound. */
static double multiply(const hda_mpc_qp *qp, hda_mpc_work *w) {
    double gap = 0.0;
    for (int e = 0; e < ALL; e++) {
            const int code = w->set[e];
            if (!code) continue;
            const double over = w->rows[e] - (code > 0 ? qp->high[e] : qp->low[e]);
            if (code == 1 || code == -1) {
                w->y[e] += STIFF * over;
                gap = larger(gap, size(over));
            } else {
                w->y[e] = (code > 0 ? qp->linear[e] : -qp->linear[e]) + qp->square[e] * over;
            }
        }
    return gap;
}

/* The set after a solution; how many rows changed. */
static int correct(const hda_mpc_qp *qp, hda_mpc_work *w) {
    int changes = 0;
    for (int e = 0; e < ALL; e++) {
            const int code = w->set[e], side = code < 0 ? -1 : 1;
            const double r = w->rows[e], y = w->y[e] * side;
            const double most = qp->linear[e];
            int next = code;
            if (code == 0) {
                if (r > qp->high[e] + SLIGHT) next = 1;
                else if (r < qp->low[e] - SLIGHT) next = -1;
            } else if (code == side) {
                if (y < -SLIGHT) next = 0;
                else if (y > most * (1.0 + SLIGHT) + SLIGHT) next = 2 * side;
            } else if (side * (r - (side > 0 ? qp->high[e] : qp->low[e])) < -SLIGHT) {
                next = side;
            }
            if (next == code) continue;
            changes++;
            w->set[e] = next;
            if (next == 0) w->y[e] = 0.0;
            else if (next != 2 * side) w->y[e] = code ? side * most : 0.0;
        }
    return changes;
}

/* 1: the set stands and its solution is exact; 0: the rounds ran out; -1: a factorisation failed. ready: the first one is done. */
static int settle(const hda_mpc_qp *qp, hda_mpc_work *w, int rounds, int ready, int *factored) {
    for (int round = 0; round < rounds; round++) {
        ++*factored;
        if (!(ready && round == 0)) {
            weights(qp, w);
            if (hda_mpc_factor(qp, w->weight, &w->f)) return -1;
        }
        for (int refine = 0; refine < HDA_MPC_REFINES; refine++) {
            slopes(qp, w);
            hda_mpc_solve(qp, &w->f, w->slope, w->T, w->x, w->rows);
            const double gap = multiply(qp, w);
            if (!(gap < 1e100)) return -1;
            if (correct(qp, w)) break;
            if (gap < FEASIBLE) return 1;
        }
    }
    return 0;
}

/* Hands a solution out if every number of it is one; the torques are cut to what is legal. */
static int hand(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w, int factored, int inside, int exact) {
    double worst = 0.0, active = 0.0;
    if (!finite(w->T, N * HDA_N, 1e100) || !finite(w->x, N * HDA_MPC_NX, 1e100) || !finite(w->y, N * ROWS, 1e100)) return HDA_MPC_BROKEN;
    for (int e = 0; e < ALL; e++) {
            const double r = w->rows[e];
            if (qp->linear[e] >= HDA_MPC_FREE) worst = larger(worst, larger(r - qp->high[e], qp->low[e] - r));
            active += w->y[e] != 0.0;
        }
    for (int k = 0; k < N; k++)
        for (int j = 0; j < HDA_N; j++) {
            const double before = k ? s->T[(k - 1) * HDA_N + j] : 0.0;
            double high = qp->high[k * ROWS + j], low = qp->low[k * ROWS + j], T = w->T[k * HDA_N + j];
            if (before + qp->high[k * ROWS + HDA_N + j] < high) high = before + qp->high[k * ROWS + HDA_N + j];
            if (before + qp->low[k * ROWS + HDA_N + j] > low) low = before + qp->low[k * ROWS + HDA_N + j];
            if (T > high) T = high;
            if (T < low) T = low;
            s->T[k * HDA_N + j] = T;
        }
    memcpy(s->x, w->x, sizeof s->x);
    memcpy(s->dual, w->y, sizeof s->dual);
    s->residual = worst;
    s->factored = factored;
    s->interior = inside;
    s->active = active;
    return exact ? HDA_MPC_SOLVED : HDA_MPC_CAPPED;
}

int hda_mpc_interior(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w) {
    int factored = 0, converged = 0;
    if (!hda_mpc_legal(qp)) return HDA_MPC_REFUSED;
    hda_mpc_turn(qp, &w->f);
    const int inside = hda_mpc_inside(qp, w, &converged);
    if (inside < 0) return HDA_MPC_BROKEN;
    memcpy(w->kept_T, w->T, sizeof w->T);
    memcpy(w->kept_x, w->x, sizeof w->x);
    memcpy(w->kept_y, w->y, sizeof w->y);
    memcpy(w->kept_rows, w->rows, sizeof w->rows);
    guess(qp, w);
    if (settle(qp, w, HDA_MPC_POLISHES, 0, &factored) == 1) return hand(qp, s, w, factored + inside, inside, 1);
    memcpy(w->T, w->kept_T, sizeof w->T);
    memcpy(w->x, w->kept_x, sizeof w->x);
    memcpy(w->y, w->kept_y, sizeof w->y);
    memcpy(w->rows, w->kept_rows, sizeof w->rows);
    return hand(qp, s, w, factored + inside, inside, converged);
}

/* The set from the solution's multipliers, and the factors that belong to it. */
static int expect(const hda_mpc_qp *qp, const hda_mpc_solution *s, hda_mpc_work *w) {
    hda_mpc_turn(qp, &w->f);
    memcpy(w->y, s->dual, sizeof w->y);
    if (!finite(w->y, ALL, HDA_MPC_LARGEST)) return 0;
    guess(qp, w);
    weights(qp, w);
    return !hda_mpc_factor(qp, w->weight, &w->f);
}

void hda_mpc_anticipate(const hda_mpc_qp *qp, const hda_mpc_solution *s, hda_mpc_work *w) {
    w->ready = hda_mpc_legal(qp) && expect(qp, s, w);
}

int hda_mpc_riccati(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w) {
    int factored = 0, ready = w->ready;
    w->ready = 0;
    if (!hda_mpc_legal(qp)) return HDA_MPC_REFUSED;
    if (!ready) ready = expect(qp, s, w);
    if (ready && settle(qp, w, HDA_MPC_ROUNDS, 1, &factored) == 1) return hand(qp, s, w, factored, 0, 1);
    const int status = hda_mpc_interior(qp, s, w);
    if (status >= 0) s->factored += factored;
    return status;
}
