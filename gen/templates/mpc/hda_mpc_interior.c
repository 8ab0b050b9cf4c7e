/* The interior point: Mehrotra's predictor and corrector on all rows, soft ones with their slack eliminated.
 *
 * Legend, for one side of a row with value r (low: all signs turned): r - slack s + t = bound, t with multiplier l, s
 * with multiplier v = linear + square s - l; every one positive. W = 1/(t/l + D), D = s/(v + square s) (0 where hard),
 * is what the row weighs in Riccati's recursion. over, open: residuals of the row and of v; give: W/l; product: l t
 * less its target. Sources: Mehrotra, SIAM J. Optim. 2 (1992) 575; Rao, Wright, Rawlings (1998). */
#include "hda_mpc_solver.h"

#include <math.h>
#include <string.h>

enum { N = HDA_MPC_N, ALL = HDA_MPC_ALL, BLOCKS = HDA_MPC_BLOCKS };

#define CLOSE 1e-9
#define GAP 0.3 /* product of every pair to begin with */
/* Residual beyond which the products begin as large as it: smaller ones would let no step do anything about it. */
#define ASTRAY 10.0
#define WIDE 1e3     /* the largest of them, and where such a start failed: far from every bound */
#define TELLING 0.5  /* a step longer than this tells which rows stand at their bound */
#define JAMMED 0.1   /* a step shorter than this goes nowhere */
#define JAMS 3       /* of them in a row are the end, where another start is left */
#define STALLED 1e-9 /* gap below which no progress is an end */
#define BOUNDARY 0.995
#define TINY 1e-36 /* of a product: its reciprocal is a float */

typedef double W __attribute__((vector_size(64)));
typedef long long B __attribute__((vector_size(64)));
typedef float F __attribute__((vector_size(32)));

#define PICK(mask, a, b) ((W)(((mask) & (B)(a)) | (~(mask) & (B)(b))))
#define LARGER(a, b) PICK((a) > (b), a, b)
/* the reciprocal of a product to single precision, which is enough for how long a step may be */
#define ROUGH(product) __builtin_convertvector(1.0f / __builtin_convertvector((product) + TINY, F), W)

static const W zero = {0};

static inline double larger(double a, double b) {
    return a > b ? a : b;
}

static inline double most_of(const W *a) {
    double most = (*a)[0];
    for (int lane = 1; lane < 8; lane++) most = larger(most, (*a)[lane]);
    return most;
}

/* One side of one row, in the middle: both of its products are `gap`, its distance and its multiplier near what the
 * rows and an earlier solution say. */
static void start_side(const hda_mpc_qp *qp, hda_mpc_work *w, int e, int low, double gap) {
    hda_mpc_side *z = &w->side[low];
    const int b = e / 8, i = e % 8;
    const double bound = low ? -qp->low[e] : qp->high[e], r = low ? -w->now.rows[e] : w->now.rows[e],
                 y = low ? -w->now.y[e] : w->now.y[e];
    if (!(bound < HDA_MPC_FREE)) return;
    z->there[b][i] = 1.0;
    z->bound[b][i] = bound;
    const double far = bound - r - larger(y, 0.0), most = w->linear[b][i], square = w->square[b][i];
    const double root = sqrt(far * far + 4.0 * gap);
    double l = far > 0.0 ? 2.0 * gap / (far + root) : 0.5 * (root - far); /* l t = gap, t - l = far */
    if (w->soft[b][i] > 0.0) {
        if (l > most - gap) l = larger(most - gap, 0.5 * most);
        const double left = most - l;
        z->s[b][i] = 2.0 * gap / (left + sqrt(left * left + 4.0 * square * gap));
        z->v[b][i] = left + square * z->s[b][i];
    }
    z->t[b][i] = gap / l;
    z->l[b][i] = l;
}

/* Where the iterations begin: the rows' values are in w->now. */
static void start_iterations(const hda_mpc_qp *qp, hda_mpc_work *w, double gap) {
    memset(w->linear, 0, sizeof w->linear);
    memset(w->square, 0, sizeof w->square);
    memset(w->soft, 0, sizeof w->soft);
    memset(w->side, 0, sizeof w->side);
    for (int low = 0; low < 2; low++)
        for (int b = 0; b < BLOCKS; b++) w->side[low].t[b] = w->side[low].v[b] = 1.0 - zero;
    for (int e = 0; e < ALL; e++) {
        if (!(qp->linear[e] < HDA_MPC_FREE)) continue;
        w->soft[e / 8][e % 8] = 1.0;
        /* costs nothing: room for its multiplier */
        w->linear[e / 8][e % 8] = qp->linear[e] + qp->square[e] > 0.0 ? qp->linear[e] : 1e-12;
        w->square[e / 8][e % 8] = qp->square[e];
    }
    w->pairs = 0.0;
    for (int e = 0; e < ALL; e++)
        for (int low = 0; low < 2; low++) {
            start_side(qp, w, e, low, gap);
            w->pairs += w->side[low].there[e / 8][e % 8] * (1.0 + w->soft[e / 8][e % 8]);
        }
    if (w->pairs == 0.0) w->pairs = 1.0;
}

/* Residuals, weights, and reciprocals of the products; the largest residual, and the mean of the products in gap. */
static double measure_residuals(hda_mpc_work *w, double *gap) {
    W worst = zero, sum = zero;
    double all = 0.0;
    hda_mpc_wide *weight = (hda_mpc_wide *)w->weight;
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        for (int b = 0; b < BLOCKS; b++) {
            const W stiff = z->v[b] + w->square[b] * z->s[b], both = z->t[b] * stiff + z->l[b] * z->s[b] * w->soft[b];
            const W inverse = 1.0 / (stiff * both); /* one division for ease, soft / stiff, and give, stiff / both */
            const W ease = w->soft[b] * both * inverse;
            const W over =
                z->there[b] * (z->t[b] - z->bound[b] + side * *(hda_mpc_wide *)(w->now.rows + 8 * b) - z->s[b]);
            const W open = z->there[b] * w->soft[b] * (z->v[b] - w->linear[b] - w->square[b] * z->s[b] + z->l[b]);
            const W give = stiff * stiff * inverse;
            const W a = LARGER(over, -over), c = LARGER(open, -open), d = LARGER(a, c);
            z->over[b] = over;
            z->open[b] = open;
            z->give[b] = give;
            z->ease[b] = ease;
            const W pair = z->t[b] * z->l[b], soft_pair = z->s[b] * z->v[b], soft = w->soft[b] * z->there[b];
            z->pair[b] = ROUGH(pair + (1.0 - z->there[b]));
            z->soft_pair[b] = ROUGH(soft_pair + (1.0 - soft));
            sum += z->there[b] * pair + soft * soft_pair;
            if (low)
                weight[b] += z->l[b] * give;
            else
                weight[b] = z->l[b] * give;
            worst = LARGER(worst, d);
        }
    }
    for (int lane = 0; lane < 8; lane++) all += sum[lane];
    *gap = all / w->pairs;
    return most_of(&worst);
}

/* Slopes of the rows for the products' residuals: towards `target`, with the second order of the last step where
 * `second` is 1. */
static void set_slopes(hda_mpc_work *w, double target, double second) {
    hda_mpc_wide *slope = (hda_mpc_wide *)w->slope;
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        for (int b = 0; b < BLOCKS; b++) {
            const W product = z->there[b] * (z->l[b] * z->t[b] + second * z->dl[b] * z->dt[b] - target);
            const W soft_product =
                z->there[b] * w->soft[b] * (z->s[b] * z->v[b] + second * z->ds[b] * z->dv[b] - target);
            const W shift = z->ease[b] * (z->s[b] * z->open[b] - soft_product);
            const W push =
                z->l[b] +
                z->give[b] * (z->l[b] * (z->over[b] - shift - side * *(hda_mpc_wide *)(w->now.rows + 8 * b)) - product);
            z->product[b] = product;
            z->soft_product[b] = soft_product;
            if (low)
                slope[b] -= push;
            else
                slope[b] = push;
        }
    }
}

/* The Newton step that belongs to the new values of the rows; the longest share of it that keeps everything positive.
 * `once`, `twice`: what the sum of the products gains with a share of the step, and with its square. */
static double find_step(hda_mpc_work *w) {
    W most = 1e-300 - zero, once = zero, twice = zero; /* most: of -change / value */
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *z = &w->side[low];
        const double side = low ? -1.0 : 1.0;
        for (int b = 0; b < BLOCKS; b++) {
            const W shift = z->ease[b] * (z->s[b] * z->open[b] - z->soft_product[b]);
            const W dr = side * (*(hda_mpc_wide *)(w->next.rows + 8 * b) - *(hda_mpc_wide *)(w->now.rows + 8 * b));
            const W dl = z->give[b] * (z->l[b] * (dr - shift + z->over[b]) - z->product[b]);
            const W ds = z->there[b] * (z->s[b] * z->ease[b] * dl + shift);
            const W dt = z->there[b] * (ds - dr - z->over[b]),
                    dv = z->there[b] * w->soft[b] * (w->square[b] * ds - dl - z->open[b]);
            const W pair = z->pair[b], soft_pair = z->soft_pair[b];
            const W a = -dt * z->l[b] * pair, c = -dl * z->t[b] * pair, e = -ds * z->v[b] * soft_pair,
                    g = -dv * z->s[b] * soft_pair;
            const W first = LARGER(a, c), last = LARGER(e, g), both = LARGER(first, last);
            z->dl[b] = dl;
            z->ds[b] = ds;
            z->dt[b] = dt;
            z->dv[b] = dv;
            most = LARGER(most, both);
            once += z->t[b] * dl + z->l[b] * dt + (z->s[b] * dv + z->v[b] * ds);
            twice += dt * dl + ds * dv;
        }
    }
    w->once = w->twice = 0.0;
    for (int lane = 0; lane < 8; lane++) {
        w->once += once[lane];
        w->twice += twice[lane];
    }
    const double longest = most_of(&most);
    return longest > 1.0 ? 1.0 / longest : 1.0;
}

static void apply_step(hda_mpc_work *w, double share) {
    double *now = w->now.T;
    const double *next = w->next.T;
    for (int low = 0; low < 2; low++) {
        hda_mpc_side *z = &w->side[low];
        for (int b = 0; b < BLOCKS; b++) {
            z->t[b] += share * z->dt[b];
            z->l[b] += share * z->dl[b];
            z->s[b] += share * z->ds[b];
            z->v[b] += share * z->dv[b];
        }
    }
    for (int e = 0; e < N * HDA_N; e++) now[e] += share * (next[e] - now[e]);
    for (int e = 0; e < N * HDA_MPC_NX; e++) w->now.x[e] += share * (w->next.x[e] - w->now.x[e]);
    for (int e = 0; e < ALL; e++) w->now.rows[e] += share * (w->next.rows[e] - w->now.rows[e]);
}

int hda_mpc_start_interior(const hda_mpc_qp *qp, hda_mpc_work *w, int wide) {
    memset(w->weight, 0, sizeof w->weight);
    memset(w->slope, 0, sizeof w->slope);
    memset(&w->next, 0, sizeof w->next);
    memset(&w->now, 0, sizeof w->now);
    w->rounds = 0;
    w->unmet = 1.0;
    if (hda_mpc_factor(qp, w->weight, &w->f)) { /* curved only by its rows, perhaps */
        for (int e = 0; e < ALL; e++) w->weight[e] = 1.0;
        if (hda_mpc_factor(qp, w->weight, &w->f)) return -1;
    }
    hda_mpc_solve(qp, &w->f, w->slope, w->now.T, w->now.x, w->now.rows);
    start_iterations(qp, w, wide ? WIDE : GAP);
    w->jams = wide ? HDA_MPC_INTERIOR : JAMS;
    return 0;
}

int hda_mpc_restart_interior(const hda_mpc_qp *qp, hda_mpc_work *w, const double *y) {
    static const double idle[HDA_N];
    double gap;
    memset(&w->next, 0, sizeof w->next);
    memset(&w->now, 0, sizeof w->now);
    memcpy(w->now.y, y, ALL * sizeof *y);
    w->rounds = 0;
    w->unmet = 1.0;
    hda_mpc_roll_out(qp, &w->f, idle, w->now.x, w->now.rows);
    start_iterations(qp, w, GAP);
    const double worst = measure_residuals(w, &gap);
    if (worst > ASTRAY) start_iterations(qp, w, worst < WIDE ? worst : WIDE);
    w->jams = JAMS;
    return 0;
}

/* The multiplier of one side of a row that stands at its bound, else 0, because nothing is left of it in the limit. In
 * the last step the distance of such a row shrank faster than its multiplier, whatever the units of both (El-Bakry,
 * Tapia, Zhang, SIAM Review 36 (1994) 45). */
static inline double is_standing(const hda_mpc_side *z, int e, int telling) {
    const int b = e / 8, i = e % 8;
    const double t = z->t[b][i], l = z->l[b][i];
    return (telling ? l * z->dt[b][i] < t * z->dl[b][i] : l > t) ? l : 0.0;
}

int hda_mpc_iterate_interior(const hda_mpc_qp *qp, hda_mpc_work *w, double wanted) {
    hda_mpc_point *next = &w->next;
    double last = 1e300, share = 0.0;
    int near = 0, jams = 0;
    for (; w->rounds < HDA_MPC_INTERIOR && jams < w->jams; w->rounds++) {
        double gap;
        const double worst = measure_residuals(w, &gap);
        near = worst < larger(CLOSE, wanted) && gap < wanted && w->unmet < larger(CLOSE, wanted);
        /* rounding lets it come no nearer */
        near |= gap < STALLED && gap > 0.5 * last && worst < CLOSE && w->unmet < CLOSE;
        last = gap;
        if (near || !(worst < 1e100) || !(gap < 1e100) || hda_mpc_factor(qp, w->weight, &w->f)) break;
        set_slopes(w, 0.0, 0.0);
        hda_mpc_solve(qp, &w->f, w->slope, next->T, next->x, next->rows);
        const double first = find_step(w),
                     left = larger(gap + first * (w->once + first * w->twice) / w->pairs, 0.0) / larger(gap, 1e-300);
        set_slopes(w, left * left * left * gap, 1.0);
        hda_mpc_solve(qp, &w->f, w->slope, next->T, next->x, next->rows);
        share = find_step(w);
        jams = share < JAMMED && worst > CLOSE ? jams + 1 : 0;
        share = share < 1.0 ? BOUNDARY * share : 1.0;
        apply_step(w, share);
        w->unmet *= 1.0 - share;
    }
    for (int e = 0; e < ALL; e++)
        w->now.y[e] = is_standing(&w->side[0], e, share > TELLING) - is_standing(&w->side[1], e, share > TELLING);
    return near;
}
