/* Steps and rollouts: RK4 with smooth friction, and a step with set-valued friction that finds where a joint stops or
 * gives way.
 *
 * Legend: x state, u input held over the step, c constants, h step, k slopes, s direction of sliding (-1, 0 stuck, 1).
 * Nothing here allocates; every loop is bounded.
 */
#include "hda_model.h"
#include "hda_parts.h"
#include "hda_sliding.h"

#include <math.h>
#include <string.h>

static const int slide[HDA_N] = HDA_SLIDE; /* entry of x whose sign is the direction of dry friction at joint j */

#if !HDA_LANES /* else hda_native.c has these steps */

/* ---- explicit Runge-Kutta of order four ---- */

static void rk4_step(const double *x, const double *u, const double *s, const double *c, double h, double *out) {
    double k[4][HDA_NX], y[HDA_NX];
    const double reach[3] = {0.5 * h, 0.5 * h, h};
    for (int stage = 0; stage < 4; stage++) {
        const double *at = stage ? y : x;
        if (s) {
            hda_rhs_exact(at, u, s, c, k[stage]);
        } else {
            hda_rhs(at, u, c, k[stage]);
        }
        if (stage < 3) {
            for (int i = 0; i < HDA_NX; i++) y[i] = x[i] + reach[stage] * k[stage][i];
        }
    }
    for (int i = 0; i < HDA_NX; i++) {
        out[i] = x[i] + h / 6.0 * ((k[0][i] + k[3][i]) + 2.0 * (k[1][i] + k[2][i]));
    }
}

void hda_step_sliding(const double *x, const double *u, const double *sliding, const double *c, double h,
                      double *next) {
    rk4_step(x, u, sliding, c, h, next);
}

#if !HDA_STIFF
void hda_step(const double *x, const double *u, const double *c, const double *h, double *out) {
    rk4_step(x, u, NULL, c, *h, out);
}
#endif

#endif

#if !HDA_STIFF

/* ---- the derivatives of the smooth step; with stiff memories both stand in hda_rodas.c ---- */

/* D = ∂k/∂w by the chain through the stages: D = A (∂x/∂w + reach D before) + B, for each block of columns w. */
static void chain_derivative(const double *A, const double *B, const double *before, double reach, int identity,
                             int columns, double *D) {
    for (int j = 0; j < columns; j++) {
        double moved[HDA_NX];
        for (int i = 0; i < HDA_NX; i++)
            moved[i] = (before ? reach * before[j * HDA_NX + i] : 0.0) + (identity && i == j ? 1.0 : 0.0);
        for (int i = 0; i < HDA_NX; i++) D[j * HDA_NX + i] = B ? B[j * HDA_NX + i] : 0.0;
        for (int m = 0; m < HDA_NX; m++) {
            for (int i = 0; i < HDA_NX; i++) D[j * HDA_NX + i] += A[m * HDA_NX + i] * moved[m];
        }
    }
}

void hda_step_jacobian(const double *x, const double *u, const double *p, const double *h, double *next, double *by_x,
                       double *by_u, double *by_p) {
    enum { WX = HDA_NX * HDA_NX, WU = HDA_NX * HDA_NU, WP = HDA_NX * HDA_NP, W = WX + WU + WP };
    double c[HDA_NC], J[W], slope[2][W], sum[W], y[HDA_NX], k[HDA_NX], x0[HDA_NX], total[HDA_NX];
    const double reach[4] = {0.0, 0.5 * *h, 0.5 * *h, *h}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    hda_prepare(p, c);
    memcpy(x0, x, sizeof x0);
    memset(sum, 0, sizeof sum);
    memset(total, 0, sizeof total);
    for (int stage = 0; stage < 4; stage++) {
        double *now = slope[stage % 2];
        const double *before = stage ? slope[(stage + 1) % 2] : NULL;
        for (int i = 0; i < HDA_NX; i++) y[i] = x0[i] + (stage ? reach[stage] * k[i] : 0.0);
        hda_rhs_jacobian(y, u, c, J, J + WX, J + WX + WU);
        hda_rhs(y, u, c, k);
        chain_derivative(J, NULL, before, reach[stage], 1, HDA_NX, now);
        chain_derivative(J, J + WX, before ? before + WX : NULL, reach[stage], 0, HDA_NU, now + WX);
        chain_derivative(J, J + WX + WU, before ? before + WX + WU : NULL, reach[stage], 0, HDA_NP, now + WX + WU);
        for (int i = 0; i < W; i++) sum[i] += *h / 6.0 * weight[stage] * now[i];
        for (int i = 0; i < HDA_NX; i++) total[i] += *h / 6.0 * weight[stage] * k[i];
    }
    for (int i = 0; i < HDA_NX; i++) next[i] = x0[i] + total[i];
    for (int i = 0; i < WX; i++) by_x[i] = sum[i] + (i % (HDA_NX + 1) == 0 ? 1.0 : 0.0);
    memcpy(by_u, sum + WX, WU * sizeof *sum);
    memcpy(by_p, sum + WX + WU, WP * sizeof *sum);
}

#endif

/* ---- set-valued friction ---- */

/* What was decided for a joint within the step: 1 or -1 the direction in which it gave way, HELD until the end, OPEN.
 */
enum { OPEN = 0, HELD = 2, MOST_ROUNDS = 4 * HDA_N, MOST_EVENTS = 4 * HDA_N, MOST_TRIALS = 12 };

/* The open joint at rest that is pushed furthest over what dry friction can hold, -1 if none; `push` is its direction
 * then. One whose load is not a number gives way too, so that it shows. */
static int find_overloaded(const double *hold, const double *level, const int *decided, const double *s, double *push) {
    double most = 0.0;
    int which = -1;
    for (int j = 0; j < HDA_N; j++) {
        const double over = fabs(hold[j]) - level[j];
        if (s[j] == 0.0 && decided[j] == OPEN && !(over <= most)) {
            most = over;
            which = j;
            *push = hold[j] > 0.0 ? 1.0 : -1.0;
        }
    }
    return which;
}

/* The open joint at rest that was let go in direction s and is pulled back, -1 if none. */
static int find_pulled_back(const double *x, const double *u, const double *c, const int *decided, const double *s) {
    double rate[HDA_NX];
    int let_go = 0;
    for (int j = 0; j < HDA_N; j++) let_go |= x[slide[j]] == 0.0 && s[j] != 0.0;
    if (!let_go) return -1;
    hda_rhs_exact(x, u, s, c, rate);
    for (int j = 0; j < HDA_N; j++) {
        if (x[slide[j]] == 0.0 && decided[j] == OPEN && rate[slide[j]] * s[j] < 0.0) return j;
    }
    return -1;
}

/* The direction of each joint: that of its speed; at rest what was decided within the step. An open one stays while dry
 * friction can hold it, else it gives way, one joint after the other, because each changes what its neighbours carry;
 * one that they pull back stays after all. Returns whether hold and level are those of these directions. */
static int choose_directions(const double *x, const double *u, const double *c, const int *decided, double *s,
                             double *hold, double *level) {
    int open = 0;
    for (int j = 0; j < HDA_N; j++) {
        const double speed = x[slide[j]];
        s[j] = speed > 0.0 ? 1.0 : speed < 0.0 ? -1.0 : decided[j] == HELD ? 0.0 : decided[j];
        open |= s[j] == 0.0 && decided[j] == OPEN;
    }
    for (int round = 0; open && round < MOST_ROUNDS; round++) {
        double push;
        hda_holding(x, u, s, c, hold, level);
        int which = find_overloaded(hold, level, decided, s, &push);
        if (which >= 0) {
            s[which] = push;
            continue;
        }
        which = find_pulled_back(x, u, c, decided, s);
        if (which < 0) return 1;
        s[which] = 0.0;
    }
    return 0;
}

/* What each joint has left before it changes, below 0 when it is overdue: its speed along its direction; at rest what
 * dry friction can still hold, with the direction of the push. */
static void measure_margins(const double *x, const double *s, const double *hold, const double *level, double *margin,
                            int *push) {
    for (int j = 0; j < HDA_N; j++) {
        margin[j] = s[j] != 0.0 ? x[slide[j]] * s[j] : level[j] - fabs(hold[j]);
        push[j] = hold[j] > 0.0 ? 1 : -1;
    }
}

static void find_margins(const double *x, const double *u, const double *c, const double *s, double *margin,
                         int *push) {
    double hold[HDA_N] = {0}, level[HDA_N] = {0};
    int rests = 0;
    for (int j = 0; j < HDA_N; j++) rests |= s[j] == 0.0;
    if (rests) hda_holding(x, u, s, c, hold, level);
    measure_margins(x, s, hold, level, margin, push);
}

/* The joint that changes first within the step, -1 if none, and after which share of it, by straight lines; the share
 * is -1 for a joint that has just moved off and turned back, and for one that rests though it is overloaded: where
 * friction is more the way it is pushed than at rest it would be pulled back at once. */
static int first_change(const double *before, const double *after, const double *s, const int *decided, double *share) {
    int which = -1;
    for (int j = 0; j < HDA_N; j++) {
        if (!(after[j] < 0.0) || (s[j] == 0.0 && decided[j] == HELD)) continue;
        const int stays = before[j] < 0.0 || (s[j] != 0.0 && before[j] == 0.0);
        const double own = stays ? -1.0 : before[j] / (before[j] - after[j]);
        if (which < 0 || own < *share) {
            which = j;
            *share = own;
        }
    }
    return which;
}

/* The next part of the step begins: to its end, unless something changes on the way. */
static void begin_part(hda_passage *way, const double *u, const double *c) {
    double hold[HDA_N], level[HDA_N];
    int push[HDA_N];
    way->phase = HDA_WHOLE;
    if (way->event++ == MOST_EVENTS) { /* too many changes in one step: whoever rests now rests until its end */
        for (int j = 0; j < HDA_N; j++) way->decided[j] = way->at[slide[j]] == 0.0 ? HELD : OPEN;
        way->phase = HDA_LAST;
    }
    if (choose_directions(way->at, u, c, way->decided, way->s, hold, level)) {
        measure_margins(way->at, way->s, hold, level, way->before, push);
    } else {
        find_margins(way->at, u, c, way->s, way->before, push);
    }
    way->span = way->left;
}

void hda_begin_passage(const double *x, const double *u, const double *c, double h, hda_passage *way) {
    memcpy(way->at, x, sizeof way->at);
    for (int j = 0; j < HDA_N; j++) way->decided[j] = OPEN;
    way->left = h;
    way->event = 0;
    begin_part(way, u, c);
}

/* The step ends in `next`, where no motor has turned back. */
static int end_passage(const double *next, hda_passage *way) {
    memcpy(way->at, next, sizeof way->at);
    for (int j = 0; j < HDA_N; j++) {
        if (way->s[j] == 0.0 || next[slide[j]] * way->s[j] < 0.0) way->at[slide[j]] = 0.0;
    }
    return 1;
}

/* The whole part ended in `next`: that is all, or the search for the first change begins. */
static int follow_whole(const double *next, const double *u, const double *c, hda_passage *way) {
    double after[HDA_N], share = 1.0;
    int push[HDA_N];
    find_margins(next, u, c, way->s, after, push);
    const int j = first_change(way->before, after, way->s, way->decided, &share);
    if (j < 0) return end_passage(next, way);
    if (share < 0.0) { /* friction holds it after all */
        way->decided[j] = HELD;
        begin_part(way, u, c);
        return 0;
    }
    way->phase = HDA_LOCATING;
    way->which = j;
    way->trial = way->side = 0;
    way->begin = 0.0;
    way->end = 1.0;
    way->first = way->before[j];
    way->last = after[j];
    way->share = share;
    way->span = share * way->left;
    return 0;
}

/* The share of the part at which the margin of a joint is 0, to rounding, by regula falsi, and Illinois halves the
 * value at an end that stays; `next` is the state after the share that was tried. There the next part begins. */
static int follow_trial(const double *next, const double *u, const double *c, hda_passage *way) {
    double margin[HDA_N];
    int push[HDA_N];
    find_margins(next, u, c, way->s, margin, push);
    const double f = margin[way->which], share = way->share;
    if (f > 0.0) {
        way->begin = share;
        way->first = f;
        if (way->side > 0) way->last *= 0.5;
        way->side = 1;
    } else {
        way->end = share;
        way->last = f;
        if (way->side < 0) way->first *= 0.5;
        way->side = -1;
    }
    const double better =
        f == 0.0 ? share : (way->begin * way->last - way->end * way->first) / (way->last - way->first);
    if (fabs(better - share) > 1e-14 && way->trial++ < MOST_TRIALS) {
        way->share = better;
        way->span = better * way->left;
        return 0;
    }
    memcpy(way->at, next, sizeof way->at);
    for (int j = 0; j < HDA_N; j++) {
        if (way->s[j] == 0.0) {
            if (j == way->which) way->decided[j] = push[j];
        } else if (j == way->which || margin[j] < 0.0) {
            way->decided[j] = OPEN;
            way->at[slide[j]] = 0.0;
        }
    }
    way->left *= 1.0 - share;
    begin_part(way, u, c);
    return 0;
}

int hda_follow_passage(const double *next, const double *u, const double *c, hda_passage *way) {
    if (way->phase == HDA_LAST) return end_passage(next, way);
    return way->phase == HDA_WHOLE ? follow_whole(next, u, c, way) : follow_trial(next, u, c, way);
}

void hda_end_passage(const double *u, const double *c, hda_passage *way) {
    double next[HDA_NX];
    do {
        hda_step_sliding(way->at, u, way->s, c, way->span, next);
    } while (!hda_follow_passage(next, u, c, way));
}

static void step_set_valued(const double *x, const double *u, const double *c, double h, double *out) {
    hda_passage way;
    hda_begin_passage(x, u, c, h, &way);
    hda_end_passage(u, c, &way);
    memcpy(out, way.at, sizeof way.at);
}

void hda_step_exact(const double *x, const double *u, const double *c, const double *h, double *out) {
    long parts = 1;
#if HDA_STIFF
    double rate;
    hda_stiffness_rate(x, u, c, &rate);
    parts = rate * *h < 2.0 * HDA_MOST_PARTS ? (long)(0.5 * rate * *h) + 1 : HDA_MOST_PARTS;
#endif
    double at[HDA_NX];
    memcpy(at, x, sizeof at);
    for (long part = 0; part < parts; part++) step_set_valued(at, u, c, *h / (double)parts, at);
    memcpy(out, at, sizeof at);
}

/* ---- rollouts: row k of u is held for dt[k]; x has a row more than u ---- */

static void roll_out(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                     int set_valued, double *x) {
    memmove(x, x0, HDA_NX * sizeof *x);
    for (long k = 0; k < rows; k++) {
        const double *from = x + k * HDA_NX;
        double *to = x + (k + 1) * HDA_NX;
        const long steps = hda_parts(dt[k], most);
        const double h = dt[k] / (double)steps;
        for (long step = 0; step < steps; step++, from = to) {
            if (set_valued) {
                hda_step_exact(from, u + k * HDA_NU, c, &h, to);
            } else {
                hda_step(from, u + k * HDA_NU, c, &h, to);
            }
        }
    }
}

void hda_rollout(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                 double *x) {
    roll_out(x0, u, c, dt, rows, most, 0, x);
}

void hda_rollout_exact(const double *x0, const double *u, const double *c, const double *dt, long rows, double most,
                       double *x) {
    roll_out(x0, u, c, dt, rows, most, 1, x);
}
