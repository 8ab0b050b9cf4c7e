/* The active set: rows at a bound enter by an augmented Lagrangian, so that a set may be degenerate, and rows beyond a
 * soft bound by their penalty. The set is corrected by the signs and sizes of multipliers until it stands (a
 * semi-smooth Newton method).
 *
 * Legend: y multiplier, positive where high holds. A soft row at its bound has y up to `linear`; beyond it y = linear +
 * square * violation. Sources: Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2002) 865; Ito, Kunisch, Lagrange
 * Multiplier Approach (2008), for the penalty. */
#include "hda_mpc_solver.h"

#include <math.h>
#include <string.h>

enum { N = HDA_MPC_N, ROWS = HDA_MPC_ROWS, ALL = N * ROWS };

#define STIFF 1e5      /* weight of a row of length 1 at its bound */
#define STIFFER 100.0  /* factor on it where the multipliers come slowly */
#define FEASIBLE 1e-11 /* of a row of length 1 */
#define NEAR 1e-8      /* gap of the interior point at which the active set takes over */
#define NEARER 1e-10   /* the same once more, where the set did not stand */
#define NEAREST 1e-13  /* and for the last time */
#define RESTLESS 15   /* rows that came or went in the last solution: with more, its set is no guess for the next one */
#define SLIGHT 1e-9   /* of multipliers, and of values of a row of length 1, that decide on the set */
#define NOTHING 1e-12 /* of a multiplier: less says nothing of the set */

static inline double larger(double a, double b) {
    return a > b ? a : b;
}

static inline double size(double a) {
    return a < 0.0 ? -a : a;
}

typedef double wide __attribute__((vector_size(64), aligned(8), may_alias));
typedef long long bits __attribute__((vector_size(64)));

/* Whether all entries lie from least to most; NaN does not. */
static int lies_within(const double *a, int count, double least, double most) {
    const int whole = count / 8 * 8;
    bits wrong = {0};
    int bad = 0;
    for (int i = 0; i < whole; i += 8) {
        const wide v = *(const wide *)(a + i);
        wrong |= ~((v >= least) & (v <= most));
    }
    for (int i = whole; i < count; i++) bad |= !(a[i] >= least && a[i] <= most);
    for (int lane = 0; lane < 8; lane++) bad |= wrong[lane] != 0;
    return !bad;
}

int hda_mpc_is_valid(const hda_mpc_qp *qp) {
    const int matrices = (int)(qp->low - qp->first);
    bits crossed = {0};
    int bad = !lies_within(qp->first, matrices, -HDA_MPC_LARGEST, HDA_MPC_LARGEST) ||
              !lies_within(qp->low, ALL, -1e100, HDA_MPC_FREE) || !lies_within(qp->high, ALL, -HDA_MPC_FREE, 1e100);
    bad = bad || !lies_within(qp->linear, ALL, 0.0, 1e100) || !lies_within(qp->square, ALL, 0.0, HDA_MPC_LARGEST);
    bad = bad || !lies_within(qp->R, N * HDA_N, 0.0, HDA_MPC_LARGEST) ||
          !lies_within(qp->D, N * HDA_N, 0.0, HDA_MPC_LARGEST);
    for (int k = 0; k < N; k++)
        for (int i = 0; i < HDA_MPC_HARD; i++) bad |= qp->linear[k * ROWS + i] < HDA_MPC_FREE;
    for (int e = 0; e + 8 <= ALL; e += 8) crossed |= *(const wide *)(qp->low + e) > *(const wide *)(qp->high + e);
    for (int e = ALL / 8 * 8; e < ALL; e++) bad |= qp->low[e] > qp->high[e];
    for (int lane = 0; lane < 8; lane++) bad |= crossed[lane] != 0;
    return !bad;
}

/* Lengths of the rows, by which their values are rounded and judged, and their weights at their bound. */
static void set_row_sizes(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
        w->length[e] = 1.0;
        w->stiff[e] = STIFF;
    }
    for (int k = 0; k < N; k++)
        for (int g = 0; g < HDA_MPC_NG; g++) {
            const double *row = qp->G + (k * HDA_MPC_NG + g) * HDA_MPC_NX;
            const int e = k * ROWS + HDA_MPC_HARD + HDA_MPC_SIMPLES + g;
            double square = 1e-6;
            for (int i = 0; i < HDA_MPC_NX; i++) square += row[i] * row[i];
            w->length[e] = sqrt(square);
            w->stiff[e] = STIFF / square;
        }
}

/* The set from the multipliers of an earlier or a rough solution. */
static void guess_set(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
        const double y = w->now.y[e], most = qp->linear[e];
        const double share = size(y);
        int code = share > NOTHING ? (share > most + SLIGHT * (1.0 + most) ? 2 : 1) : 0;
        if (code && (y > 0.0 ? qp->high[e] >= HDA_MPC_FREE : qp->low[e] <= -HDA_MPC_FREE)) code = 0;
        w->set[e] = y < 0.0 ? -code : code;
        if (!code) w->now.y[e] = 0.0;
    }
}

static void set_weights(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
        const int code = w->set[e];
        w->weight[e] = code == 0 ? 0.0 : code == 1 || code == -1 ? w->stiff[e] : qp->square[e];
    }
}

static void set_slopes(const hda_mpc_qp *qp, hda_mpc_work *w) {
    for (int e = 0; e < ALL; e++) {
        const int code = w->set[e];
        const double bound = code > 0 ? qp->high[e] : qp->low[e];
        double s = 0.0;
        if (code == 1 || code == -1)
            s = w->now.y[e] - w->stiff[e] * bound;
        else if (code)
            s = (code > 0 ? qp->linear[e] : -qp->linear[e]) - qp->square[e] * bound;
        w->slope[e] = s;
    }
}

/* Multipliers after a solution; the largest distance of a row in the set from its bound, over its length. */
static double find_multipliers(const hda_mpc_qp *qp, hda_mpc_work *w) {
    double gap = 0.0;
    for (int e = 0; e < ALL; e++) {
        const int code = w->set[e];
        if (!code) continue;
        const double over = w->now.rows[e] - (code > 0 ? qp->high[e] : qp->low[e]);
        if (code == 1 || code == -1) {
            w->now.y[e] += w->stiff[e] * over;
            gap = larger(gap, size(over) / w->length[e]);
        } else {
            w->now.y[e] = (code > 0 ? qp->linear[e] : -qp->linear[e]) + qp->square[e] * over;
        }
    }
    return gap;
}

/* The set after a solution; how many rows changed. */
static int correct_set(const hda_mpc_qp *qp, hda_mpc_work *w) {
    int changes = 0;
    for (int e = 0; e < ALL; e++) {
        const int code = w->set[e], side = code < 0 ? -1 : 1;
        const double r = w->now.rows[e], y = w->now.y[e] * side;
        const double most = qp->linear[e], slight = SLIGHT * w->length[e];
        int next = code;
        if (code == 0) {
            if (r > qp->high[e] + slight)
                next = 1;
            else if (r < qp->low[e] - slight)
                next = -1;
        } else if (code == side) {
            if (y < -SLIGHT)
                next = 0;
            else if (y > most * (1.0 + SLIGHT) + SLIGHT)
                next = 2 * side;
        } else if (side * (r - (side > 0 ? qp->high[e] : qp->low[e])) < -slight) {
            next = side;
        }
        if (next == code) continue;
        changes++;
        w->set[e] = next;
        if (next == 0)
            w->now.y[e] = 0.0;
        else if (next != 2 * side)
            w->now.y[e] = code ? side * most : 0.0;
    }
    return changes;
}

/* 1: the set stands and its solution is exact; 0: it does not come to rest; -1: a factorisation failed. ready: the
 * first one is done. */
static int settle_set(const hda_mpc_qp *qp, hda_mpc_work *w, int rounds, int ready, int *factored) {
    int before = ALL;
    for (int round = 0; round < rounds; round++) {
        int changes = 0;
        ++*factored;
        if (!(ready && round == 0)) {
            set_weights(qp, w);
            if (hda_mpc_factor(qp, w->weight, &w->f)) return -1;
        }
        for (int refine = 0; refine < HDA_MPC_REFINES && !changes; refine++) {
            set_slopes(qp, w);
            hda_mpc_solve(qp, &w->f, w->slope, w->now.T, w->now.x, w->now.rows);
            const double gap = find_multipliers(qp, w);
            if (!(gap < 1e100)) return -1;
            changes = correct_set(qp, w);
            if (!changes && gap < FEASIBLE) return 1;
        }
        if (changes > before) return 0; /* it swings */
        if (changes)
            before = changes;
        else
            for (int e = 0; e < ALL; e++) w->stiff[e] *= STIFFER; /* the set stands, but its multipliers come slowly */
    }
    return 0;
}

/* Rows that stand elsewhere by one solution than by another; none where the first knows nothing. */
static int count_differences(const double *before, const double *now) {
    int count = 0, known = 0;
    for (int e = 0; e < ALL; e++) {
        count += (before[e] > 0.0) != (now[e] > 0.0) || (before[e] < 0.0) != (now[e] < 0.0);
        known |= before[e] != 0.0;
    }
    return known ? count : 0;
}

/* Hands a solution out if every number of it is one; the torques are cut to what is legal. */
static int hand_out(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w, int factored, int inside, int exact) {
    double worst = 0.0, active = 0.0;
    if (!lies_within(w->now.T, N * HDA_N, -1e100, 1e100) || !lies_within(w->now.x, N * HDA_MPC_NX, -1e100, 1e100) ||
        !lies_within(w->now.y, N * ROWS, -1e100, 1e100))
        return HDA_MPC_BROKEN;
    for (int e = 0; e < ALL; e++) {
        const double r = w->now.rows[e];
        if (qp->linear[e] >= HDA_MPC_FREE) worst = larger(worst, larger(r - qp->high[e], qp->low[e] - r));
        active += w->now.y[e] != 0.0;
    }
    for (int k = 0; k < N; k++)
        for (int j = 0; j < HDA_N; j++) {
            const double before = k ? s->T[(k - 1) * HDA_N + j] : 0.0;
            double high = qp->high[k * ROWS + j], low = qp->low[k * ROWS + j], T = w->now.T[k * HDA_N + j];
            if (before + qp->high[k * ROWS + HDA_N + j] < high) high = before + qp->high[k * ROWS + HDA_N + j];
            if (before + qp->low[k * ROWS + HDA_N + j] > low) low = before + qp->low[k * ROWS + HDA_N + j];
            if (T > high) T = high;
            if (T < low) T = low;
            /* where both cannot hold, the torque's own bound does */
            if (T > qp->high[k * ROWS + j]) T = qp->high[k * ROWS + j];
            if (T < qp->low[k * ROWS + j]) T = qp->low[k * ROWS + j];
            s->T[k * HDA_N + j] = T;
        }
    w->changed = count_differences(s->dual, w->now.y);
    memcpy(s->x, w->now.x, sizeof s->x);
    memcpy(s->dual, w->now.y, sizeof s->dual);
    s->residual = worst;
    s->factored = factored;
    s->interior = inside;
    s->active = active;
    return exact ? HDA_MPC_SOLVED : HDA_MPC_CAPPED;
}

/* The interior point comes near; then the active set takes over, exact where its set stands; where it does not, from
 * nearer still. */
static int solve_from_interior(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w, int factored) {
    static const double gaps[] = {NEAR, NEARER, NEAREST};
    int near = 1;
    for (int again = 0; again < 3 && near; again++) {
        near = hda_mpc_iterate_interior(qp, w, gaps[again]);
        w->kept = w->now;
        guess_set(qp, w);
        if (settle_set(qp, w, HDA_MPC_POLISHES, 0, &factored) == 1)
            return hand_out(qp, s, w, factored + w->rounds, w->rounds, 1);
        w->now = w->kept;
        set_row_sizes(qp, w);
    }
    return hand_out(qp, s, w, factored + w->rounds, w->rounds, near);
}

int hda_mpc_interior(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w) {
    if (!hda_mpc_is_valid(qp)) return HDA_MPC_REFUSED;
    hda_mpc_arrange_factors(qp, &w->f);
    set_row_sizes(qp, w);
    if (hda_mpc_start_interior(qp, w, 0)) return HDA_MPC_BROKEN;
    const int status = solve_from_interior(qp, s, w, 0);
    return status == HDA_MPC_SOLVED || hda_mpc_start_interior(qp, w, 1)
               ? status
               : solve_from_interior(qp, s, w, HDA_MPC_INTERIOR);
}

/* What does not depend on the measurement: 1 where the set from the solution's multipliers is ready with its factors, 2
 * where the set changes too fast for that, 0 where it failed. */
static int prepare_set(const hda_mpc_qp *qp, const hda_mpc_solution *s, hda_mpc_work *w) {
    hda_mpc_arrange_factors(qp, &w->f);
    set_row_sizes(qp, w);
    if (w->changed > RESTLESS) return 2;
    memcpy(w->now.y, s->dual, sizeof w->now.y);
    if (!lies_within(w->now.y, ALL, -HDA_MPC_LARGEST, HDA_MPC_LARGEST)) return 0;
    guess_set(qp, w);
    set_weights(qp, w);
    return !hda_mpc_factor(qp, w->weight, &w->f);
}

void hda_mpc_prepare_riccati(const hda_mpc_qp *qp, const hda_mpc_solution *s, hda_mpc_work *w) {
    w->ready = hda_mpc_is_valid(qp) ? prepare_set(qp, s, w) : 0;
}

int hda_mpc_riccati(const hda_mpc_qp *qp, hda_mpc_solution *s, hda_mpc_work *w) {
    int factored = 0, ready = w->ready;
    w->ready = 0;
    if (!hda_mpc_is_valid(qp)) return HDA_MPC_REFUSED;
    if (!ready) ready = prepare_set(qp, s, w);
    if (ready == 1 && settle_set(qp, w, HDA_MPC_ROUNDS, 1, &factored) == 1) return hand_out(qp, s, w, factored, 0, 1);
    set_row_sizes(qp, w);
    if (!hda_mpc_restart_interior(qp, w, s->dual)) {
        const int status = solve_from_interior(qp, s, w, factored);
        if (status == HDA_MPC_SOLVED) return status;
    }
    return hda_mpc_start_interior(qp, w, 1) ? HDA_MPC_BROKEN
                                            : solve_from_interior(qp, s, w, factored + HDA_MPC_INTERIOR);
}
