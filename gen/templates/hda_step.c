/* Steps and rollouts: RK4, a Rosenbrock method for stiff memories, and a step with set-valued friction.
 *
 * Legend: x state, u input held over the step, c constants, h step, k slopes, s direction of sliding (-1, 0 stuck, 1).
 * Sources: RODAS: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.7 and their table of coefficients.
 * Nothing here allocates; every loop is bounded.
 */
#include "hda.h"

#include <math.h>
#include <string.h>

static const int slide[HDA_N] = HDA_SLIDE; /* entry of x whose sign is the direction of dry friction at joint j */
static const double bound[HDA_NX] = HDA_BOUND;

/* ---- explicit Runge-Kutta of order four ---- */

static void rk4(const double *x, const double *u, const double *s, const double *c, double h, double *out) {
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

#if HDA_STIFF

/* ---- RODAS, order four, L-stable, six stages, with its embedded error ---- */

static const double gamma_ = 0.25;
static const double a_[6][5] = {
    {0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0},
};
static const double c_[6][5] = {
    {0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054},
};

/* LU with row exchange in place; 0 where the matrix is singular. */
static int factor(double A[HDA_NX][HDA_NX], int *row) {
    for (int k = 0; k < HDA_NX; k++) {
        int best = k;
        for (int i = k + 1; i < HDA_NX; i++) {
            if (fabs(A[i][k]) > fabs(A[best][k])) best = i;
        }
        row[k] = best;
        if (!(fabs(A[best][k]) > 0.0)) return 0;
        if (best != k) {
            for (int j = 0; j < HDA_NX; j++) {
                const double t = A[k][j];
                A[k][j] = A[best][j];
                A[best][j] = t;
            }
        }
        const double pivot = 1.0 / A[k][k];
        for (int i = k + 1; i < HDA_NX; i++) {
            if (A[i][k] == 0.0) continue;
            A[i][k] *= pivot;
            for (int j = k + 1; j < HDA_NX; j++) A[i][j] -= A[i][k] * A[k][j];
        }
    }
    return 1;
}

static void solve(double A[HDA_NX][HDA_NX], const int *row, double *b) {
    for (int k = 0; k < HDA_NX; k++) {
        const double t = b[row[k]];
        b[row[k]] = b[k];
        b[k] = t;
    }
    for (int i = 1; i < HDA_NX; i++) {
        for (int j = 0; j < i; j++) b[i] -= A[i][j] * b[j];
    }
    for (int i = HDA_NX - 1; i >= 0; i--) {
        for (int j = i + 1; j < HDA_NX; j++) b[i] -= A[i][j] * b[j];
        b[i] /= A[i][i];
    }
}

static double lost(double *out) {
    for (int i = 0; i < HDA_NX; i++) out[i] = NAN;
    return INFINITY;
}

/* One step; returns the error estimate as a multiple of the tolerance, infinite where the result is not a number. */
static double rodas(const double *x, const double *u, const double *c, const double *J, double h, double *out) {
    double A[HDA_NX][HDA_NX], k[6][HDA_NX], y[HDA_NX], f[HDA_NX], worst = 0.0;
    int row[HDA_NX];
    for (int i = 0; i < HDA_NX; i++) {
        for (int j = 0; j < HDA_NX; j++) A[i][j] = (i == j ? 1.0 / (h * gamma_) : 0.0) - J[j * HDA_NX + i];
    }
    if (!factor(A, row)) return lost(out);
    for (int stage = 0; stage < 6; stage++) {
        for (int i = 0; i < HDA_NX; i++) {
            double sum = x[i];
            for (int m = 0; m < stage; m++) sum += a_[stage][m] * k[m][i];
            y[i] = sum;
        }
        hda_rhs(y, u, c, f);
        for (int i = 0; i < HDA_NX; i++) {
            double sum = 0.0;
            for (int m = 0; m < stage; m++) sum += c_[stage][m] * k[m][i];
            k[stage][i] = f[i] + sum / h;
        }
        solve(A, row, k[stage]);
    }
    for (int i = 0; i < HDA_NX; i++) {
        out[i] = y[i] + k[5][i];
        const double e = fabs(k[5][i]) / (HDA_TOLERANCE * (bound[i] + fabs(x[i])));
        worst = e <= worst ? worst : e < INFINITY && worst < INFINITY ? e : INFINITY;
    }
    return worst < INFINITY ? worst : lost(out);
}

/* The step in parts that keep the tolerance: halves of halves, at most HDA_MOST_PARTS of them, whose lengths go to `lengths`.
 * Returns their number. The error goes with the fourth power of a part, so a part is doubled where 16 times its error is fine. */
static int adapt(const double *x, const double *u, const double *c, double h, double *lengths, double *out) {
    double at[HDA_NX], next[HDA_NX], by_x[HDA_NX * HDA_NX];
    long part = 0, whole = 1; /* the step is divided into `whole` parts, `part` of which are done */
    int count = 0;
    memcpy(at, x, sizeof at);
    while (part < whole) {
        double error;
        hda_state_jacobian(at, u, c, by_x);
        while ((error = rodas(at, u, c, by_x, h / (double)whole, next)) > 1.0 && whole < HDA_MOST_PARTS) {
            part *= 2;
            whole *= 2;
        }
        lengths[count++] = h / (double)whole;
        memcpy(at, next, sizeof at);
        if (error == INFINITY) break; /* not a number, and it stays so */
        for (part++; part % 2 == 0 && part < whole && 16.0 * error < 1.0; error *= 16.0) {
            part /= 2;
            whole /= 2;
        }
    }
    memcpy(out, at, sizeof at);
    return count;
}

/* The step in given parts. */
static void follow(const double *x, const double *u, const double *c, const double *lengths, int count, double *out) {
    double at[HDA_NX], by_x[HDA_NX * HDA_NX];
    memcpy(at, x, sizeof at);
    for (int k = 0; k < count; k++) {
        double next[HDA_NX];
        hda_state_jacobian(at, u, c, by_x);
        rodas(at, u, c, by_x, lengths[k], next);
        memcpy(at, next, sizeof at);
    }
    memcpy(out, at, sizeof at);
}

void hda_step(const double *x, const double *u, const double *c, const double *h, double *out) {
    double lengths[HDA_MOST_PARTS];
    adapt(x, u, c, *h, lengths, out);
}

/* Central differences over the parts of the step itself, so that no change of parts disturbs them. */
void hda_step_jacobian(const double *x, const double *u, const double *p, const double *h, double *next, double *by_x, double *by_u, double *by_p) {
    double c[HDA_NC], w[HDA_NX + HDA_NU + HDA_NP], high[HDA_NX], low[HDA_NX], lengths[HDA_MOST_PARTS];
    memcpy(w, x, HDA_NX * sizeof *w);
    memcpy(w + HDA_NX, u, HDA_NU * sizeof *w);
    memcpy(w + HDA_NX + HDA_NU, p, HDA_NP * sizeof *w);
    hda_prepare(w + HDA_NX + HDA_NU, c);
    const int count = adapt(w, w + HDA_NX, c, *h, lengths, next);
    for (int j = 0; j < HDA_NX + HDA_NU + HDA_NP; j++) {
        const int parameter = j >= HDA_NX + HDA_NU;
        const double keep = w[j], d = 6e-6 * (fabs(keep) + (j < HDA_NX ? bound[j] * 1e-2 : keep == 0.0 ? 1e-3 : 0.0));
        double *column = j < HDA_NX ? by_x + j * HDA_NX : parameter ? by_p + (j - HDA_NX - HDA_NU) * HDA_NX : by_u + (j - HDA_NX) * HDA_NX;
        w[j] = keep + d;
        if (parameter) hda_prepare(w + HDA_NX + HDA_NU, c);
        follow(w, w + HDA_NX, c, lengths, count, high);
        w[j] = keep - d;
        if (parameter) hda_prepare(w + HDA_NX + HDA_NU, c);
        follow(w, w + HDA_NX, c, lengths, count, low);
        w[j] = keep;
        for (int i = 0; i < HDA_NX; i++) column[i] = (high[i] - low[i]) / (2.0 * d);
    }
}

#else

void hda_step(const double *x, const double *u, const double *c, const double *h, double *out) { rk4(x, u, NULL, c, *h, out); }

/* D = ∂k/∂w by the chain through the stages: D = A (∂x/∂w + reach D before) + B, for each block of columns w. */
static void chain(const double *A, const double *B, const double *before, double reach, int identity, int columns, double *D) {
    for (int j = 0; j < columns; j++) {
        double moved[HDA_NX];
        for (int i = 0; i < HDA_NX; i++) moved[i] = (before ? reach * before[j * HDA_NX + i] : 0.0) + (identity && i == j ? 1.0 : 0.0);
        for (int i = 0; i < HDA_NX; i++) D[j * HDA_NX + i] = B ? B[j * HDA_NX + i] : 0.0;
        for (int m = 0; m < HDA_NX; m++) {
            for (int i = 0; i < HDA_NX; i++) D[j * HDA_NX + i] += A[m * HDA_NX + i] * moved[m];
        }
    }
}

void hda_step_jacobian(const double *x, const double *u, const double *p, const double *h, double *next, double *by_x, double *by_u, double *by_p) {
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
        chain(J, NULL, before, reach[stage], 1, HDA_NX, now);
        chain(J, J + WX, before ? before + WX : NULL, reach[stage], 0, HDA_NU, now + WX);
        chain(J, J + WX + WU, before ? before + WX + WU : NULL, reach[stage], 0, HDA_NP, now + WX + WU);
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

/* The direction of each joint: that of its speed; at rest it stays while dry friction can hold it, else it gives way, the most
 * overloaded first, because a joint that moves off changes what its neighbours carry. */
static void choose(const double *x, const double *u, const double *c, const int *kept, double *s) {
    int resting = 0;
    for (int j = 0; j < HDA_N; j++) {
        const double speed = x[slide[j]];
        s[j] = speed > 0.0 ? 1.0 : speed < 0.0 ? -1.0 : 0.0;
        resting |= s[j] == 0.0;
    }
    for (int round = 0; resting && round < HDA_N; round++) {
        double hold[HDA_N], level[HDA_N], most = 0.0;
        int which = -1;
        hda_holding(x, u, s, c, hold, level);
        for (int j = 0; j < HDA_N; j++) {
            const double over = fabs(hold[j]) - level[j];
            if (s[j] == 0.0 && !kept[j] && over > most) {
                most = over;
                which = j;
            }
        }
        if (which < 0) return;
        s[which] = hold[which] > 0.0 ? 1.0 : -1.0;
    }
}

static int reversed(const double *x, const double *s, int j) { return s[j] != 0.0 && x[slide[j]] * s[j] < 0.0; }

/* The share of the step after which the first joint stops; 1 where none does, and -1 where one that just moved off turns back. */
static double first_stop(const double *x, const double *next, const double *s, int *which) {
    double first = 1.0;
    *which = -1;
    for (int j = 0; j < HDA_N; j++) {
        if (!reversed(next, s, j)) continue;
        const double from = x[slide[j]], share = from == 0.0 ? -1.0 : from / (from - next[slide[j]]);
        if (*which < 0 || share < first) {
            first = share;
            *which = j;
        }
    }
    return first;
}

static void exact(const double *x, const double *u, const double *c, double h, double *out) {
    double at[HDA_NX], next[HDA_NX], s[HDA_N], left = h;
    int kept[HDA_N] = {0}, done = 0;
    memcpy(at, x, sizeof at);
    for (int event = 0; event < 4 * HDA_N; event++) {
        int which;
        choose(at, u, c, kept, s);
        rk4(at, u, s, c, left, next);
        double share = first_stop(at, next, s, &which);
        done = which < 0;
        if (done) break;
        if (share < 0.0) { /* friction holds it after all */
            kept[which] = 1;
            continue;
        }
        double a = 0.0, b = 1.0, fa = at[slide[which]], fb = next[slide[which]];
        for (int trial = 0; trial < 8; trial++) { /* regula falsi with Illinois' halving */
            rk4(at, u, s, c, share * left, next);
            const double f = next[slide[which]];
            if (fabs(f) <= 1e-12 * bound[slide[which]]) break;
            if ((f > 0.0) == (fa > 0.0)) {
                a = share;
                fa = f;
                fb *= 0.5;
            } else {
                b = share;
                fb = f;
                fa *= 0.5;
            }
            share = (a * fb - b * fa) / (fb - fa);
        }
        for (int j = 0; j < HDA_N; j++) {
            if (j == which || reversed(next, s, j)) next[slide[j]] = 0.0;
        }
        memcpy(at, next, sizeof at);
        left *= 1.0 - share;
    }
    if (!done) { /* too many stops in one step: whoever rests now rests until its end */
        for (int j = 0; j < HDA_N; j++) kept[j] = at[slide[j]] == 0.0;
        choose(at, u, c, kept, s);
        rk4(at, u, s, c, left, next);
    }
    for (int j = 0; j < HDA_N; j++) {
        if (s[j] == 0.0 || reversed(next, s, j)) next[slide[j]] = 0.0;
    }
    memcpy(out, next, sizeof at);
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
    for (long part = 0; part < parts; part++) exact(at, u, c, *h / (double)parts, at);
    memcpy(out, at, sizeof at);
}

/* ---- rollouts: row k of u is held for dt[k]; x has a row more than u ---- */

static void roll(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, int set_valued, double *x) {
    memmove(x, x0, HDA_NX * sizeof *x);
    for (long k = 0; k < rows; k++) {
        const double *from = x + k * HDA_NX;
        double at[HDA_NX];
        const double want = dt[k] / most;
        const long steps = want > 1.0 && want < 1e6 ? (long)ceil(want - 1e-9) : 1;
        const double h = dt[k] / (double)steps;
        memcpy(at, from, sizeof at);
        for (long step = 0; step < steps; step++) {
            if (set_valued) {
                hda_step_exact(at, u + k * HDA_NU, c, &h, at);
            } else {
                hda_step(at, u + k * HDA_NU, c, &h, at);
            }
        }
        memcpy(x + (k + 1) * HDA_NX, at, sizeof at);
    }
}

void hda_rollout(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, double *x) {
    roll(x0, u, c, dt, rows, most, 0, x);
}

void hda_rollout_exact(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, double *x) {
    roll(x0, u, c, dt, rows, most, 1, x);
}
