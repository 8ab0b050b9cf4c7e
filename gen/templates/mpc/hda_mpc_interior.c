/* The interior point: Mehrotra's predictor and corrector on all rows, soft ones with their slack eliminated.
 *
 * Legend, for one side of a row with value r (low: all signs turned): r - slack s + t = bound, t with multiplier l, s with multiplier
 * v = linear + square s - l; every one positive. W = 1/(t/l + D), D = s/(v + square s) (0 where hard), is what the row weighs in Riccati's
 * recursion. over, open: residuals of the row and of v; give: W/l; product: l t less its target.
 * Sources: Mehrotra, SIAM J. Optim. 2 (1992) 575; Rao, Wright, Rawlings (1998). */
#include "hda_mpc_solver.h"

#include <string.h>

enum { N = HDA_MPC_N, ALL = HDA_MPC_ALL };

#define SMALL_GAP 1e-11
#define CLOSE 1e-9
#define START 1.0    /* the least distance from a bound to begin with */
#define BOUNDARY 0.995

static inline double larger(double a, double b) { return a > b ? a : b; }

/* Where the iterations begin: the rows' values are in w->rows. */
static void begin(const hda_mpc_qp *qp, hda_mpc_work *w, double gap) {
    for (int e = 0; e < ALL; e++) {
            const int soft = qp->linear[e] < HDA_MPC_FREE;
            w->soft[e] = soft;
            w->linear[e] = soft ? qp->linear[e] : 0.0;
            w->square[e] = soft ? qp->square[e] : 0.0;
            if (soft && w->linear[e] + w->square[e] == 0.0) w->linear[e] = 1e-12; /* costs nothing: it has room for its multiplier */
            for (int low = 0; low < 2; low++) {
                hda_mpc_side *z = &w->side[low];
                const double bound = low ? -qp->low[e] : qp->high[e], r = low ? -w->rows[e] : w->rows[e];
                const int there = bound < HDA_MPC_FREE;
                z->there[e] = there;
                z->bound[e] = there ? bound : 0.0;
                z->t[e] = z->v[e] = 1.0;
                z->l[e] = z->s[e] = 0.0;
                z->dt[e] = z->dl[e] = z->ds[e] = z->dv[e] = 0.0;
                if (!there) continue;
                z->t[e] = larger(bound - r, START);
                z->l[e] = gap / z->t[e];
                if (!soft) continue;
                z->s[e] = larger(r - bound, START);
                z->t[e] = larger(bound - r + z->s[e], START);
                z->v[e] = w->linear[e] + w->square[e] * z->s[e];
                if (z->l[e] > 0.5 * z->v[e]) z->l[e] = 0.5 * z->v[e];
                z->v[e] -= z->l[e];
            }
        }
}

/* Residuals and weights; returns the largest residual. */
static double measure(hda_mpc_work *w) {
    double worst = 0.0, *restrict weight = w->weight;
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *restrict z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        for (int e = 0; e < ALL; e++) {
            const double softness = z->v[e] + w->square[e] * z->s[e];
            const double D = w->soft[e] * z->s[e] / softness;
            z->over[e] = z->there[e] * (z->t[e] - z->bound[e] + side * w->rows[e] - z->s[e]);
            z->open[e] = z->there[e] * w->soft[e] * (z->v[e] - w->linear[e] - w->square[e] * z->s[e] + z->l[e]);
            z->give[e] = 1.0 / (z->t[e] + z->l[e] * D);
            weight[e] = (low ? weight[e] : 0.0) + z->l[e] * z->give[e];
        }
        for (int e = 0; e < ALL; e++) {
            const double a = z->over[e] < 0.0 ? -z->over[e] : z->over[e], b = z->open[e] < 0.0 ? -z->open[e] : z->open[e];
            worst = larger(worst, larger(a, b));
        }
    }
    return worst;
}

/* Slopes of the rows for the products' residuals. */
static void lean(hda_mpc_work *w) {
    double *restrict slope = w->slope;
    for (int low = 0; low < 2; low++) {
        const hda_mpc_side *restrict z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        for (int e = 0; e < ALL; e++) {
            const double softness = 1.0 / (z->v[e] + w->square[e] * z->s[e]);
            const double shift = w->soft[e] * softness * (z->s[e] * z->open[e] - z->soft_product[e]);
            const double push = z->l[e] + z->give[e] * (z->l[e] * (z->over[e] - shift - side * w->rows[e]) - z->product[e]);
            slope[e] = (low ? slope[e] : 0.0) + side * push;
        }
    }
}

/* The Newton step that belongs to the new values of the rows; the longest share of it that keeps everything positive. */
static double stride(hda_mpc_work *w, const double *restrict fresh) {
    double share = 1.0;
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *restrict z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        double most = 1e-300; /* of -change / value */
        for (int e = 0; e < ALL; e++) {
            const double softness = 1.0 / (z->v[e] + w->square[e] * z->s[e]), D = w->soft[e] * z->s[e] * softness;
            const double shift = w->soft[e] * softness * (z->s[e] * z->open[e] - z->soft_product[e]);
            const double dr = side * (fresh[e] - w->rows[e]);
            const double dl = z->give[e] * (z->l[e] * (dr - shift + z->over[e]) - z->product[e]);
            const double ds = z->there[e] * (D * dl + shift);
            z->dl[e] = dl;
            z->ds[e] = ds;
            z->dt[e] = z->there[e] * (ds - dr - z->over[e]);
            z->dv[e] = z->there[e] * w->soft[e] * (w->square[e] * ds - dl - z->open[e]);
        }
        for (int e = 0; e < ALL; e++) {
            const double a = -z->dt[e] / z->t[e], c = -z->dv[e] / z->v[e];
            const double b = z->l[e] > 0.0 ? -z->dl[e] / z->l[e] : 0.0, d = z->s[e] > 0.0 ? -z->ds[e] / z->s[e] : 0.0;
            most = larger(most, larger(larger(a, b), larger(c, d)));
        }
        if (share * most > 1.0) share = 1.0 / most;
    }
    return share;
}

/* Mean of the products after a share of the step. */
static double mean(const hda_mpc_work *w, double share, double pairs) {
    double sum = 0.0;
    for (int low = 0; low < 2; low++) {
        const hda_mpc_side *restrict z = &w->side[low];
        for (int e = 0; e < ALL; e++)
            sum += z->there[e] * ((z->t[e] + share * z->dt[e]) * (z->l[e] + share * z->dl[e]) + w->soft[e] * (z->s[e] + share * z->ds[e]) * (z->v[e] + share * z->dv[e]));
    }
    return sum / pairs;
}

/* Residuals of the products: towards `target`, with the second order of the last step where `second` is 1. */
static void aim(hda_mpc_work *w, double target, double second) {
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *restrict z = &w->side[low];
        for (int e = 0; e < ALL; e++) {
            z->product[e] = z->there[e] * (z->l[e] * z->t[e] + second * z->dl[e] * z->dt[e] - target);
            z->soft_product[e] = z->there[e] * w->soft[e] * (z->s[e] * z->v[e] + second * z->ds[e] * z->dv[e] - target);
        }
    }
}

static void advance(hda_mpc_work *w, double share) {
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *restrict z = &w->side[low];
        for (int e = 0; e < ALL; e++) {
            z->t[e] += share * z->dt[e];
            z->l[e] += share * z->dl[e];
            z->s[e] += share * z->ds[e];
            z->v[e] += share * z->dv[e];
        }
    }
    for (int e = 0; e < ALL; e++) w->rows[e] += share * (w->kept_rows[e] - w->rows[e]);
    for (int e = 0; e < N * HDA_N; e++) w->T[e] += share * (w->kept_T[e] - w->T[e]);
    for (int e = 0; e < N * HDA_MPC_NX; e++) w->x[e] += share * (w->kept_x[e] - w->x[e]);
}

int hda_mpc_inside(const hda_mpc_qp *qp, hda_mpc_work *w, int *converged) {
    double pairs = 0.0, unmet = 1.0; /* share of the first residual of stationarity that is left */
    int rounds = 0;
    *converged = 0;
    memset(w->weight, 0, sizeof w->weight);
    memset(w->slope, 0, sizeof w->slope);
    if (hda_mpc_factor(qp, w->weight, &w->f)) {
        for (int e = 0; e < ALL; e++) w->weight[e] = 1.0;
        if (hda_mpc_factor(qp, w->weight, &w->f)) return -1;
    }
    hda_mpc_solve(qp, &w->f, w->slope, w->T, w->x, w->rows);
    begin(qp, w, 1.0);
    for (int low = 0; low < 2; low++)
        for (int e = 0; e < ALL; e++) pairs += w->side[low].there[e] * (1.0 + w->soft[e]);
    if (pairs == 0.0) pairs = 1.0;
    for (; rounds < HDA_MPC_INTERIOR; rounds++) {
        const double worst = measure(w);
        const double gap = mean(w, 0.0, pairs);
        if (worst < CLOSE && gap < SMALL_GAP && unmet < CLOSE) {
            *converged = 1;
            break;
        }
        if (!(worst < 1e100) || !(gap < 1e100) || hda_mpc_factor(qp, w->weight, &w->f)) break;
        aim(w, 0.0, 0.0);
        lean(w);
        hda_mpc_solve(qp, &w->f, w->slope, w->kept_T, w->kept_x, w->kept_rows);
        const double first = stride(w, w->kept_rows), left = mean(w, first, pairs) / larger(gap, 1e-300);
        aim(w, left * left * left * gap, 1.0);
        lean(w);
        hda_mpc_solve(qp, &w->f, w->slope, w->kept_T, w->kept_x, w->kept_rows);
        double share = stride(w, w->kept_rows);
        share = share < 1.0 ? BOUNDARY * share : 1.0;
        advance(w, share);
        unmet *= 1.0 - share;
    }
    for (int e = 0; e < ALL; e++) w->y[e] = w->side[0].l[e] - w->side[1].l[e];
    return rounds + 1;
}
