/* The step of models with stiff memories: a Rosenbrock method of order four, L-stable, in as many parts as the
 * tolerance asks for.
 *
 * Legend: x state, u input held over the step, c constants, h step, J Jacobian of the rate by x, k slopes.
 * Source: RODAS: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.7 and their table of
 * coefficients. Nothing here allocates; every loop is bounded.
 */
#include "hda_model.h"

#include <math.h>
#include <string.h>

#if HDA_STIFF

static const double bound[HDA_NX] = HDA_BOUND;
static const double width[HDA_NX + HDA_NU + HDA_NP] = HDA_WIDTH;

/* RODAS: six stages, the last of which is its own error. */
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
static int factor_matrix(double A[HDA_NX][HDA_NX], int *row) {
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

static void solve_factored(double A[HDA_NX][HDA_NX], const int *row, double *b) {
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

static double give_up(double *out) {
    for (int i = 0; i < HDA_NX; i++) out[i] = NAN;
    return INFINITY;
}

/* One step; returns the error estimate as a multiple of the tolerance, infinite where the result is not a number. */
static double rodas_step(const double *x, const double *u, const double *c, const double *J, double h, double *out) {
    double A[HDA_NX][HDA_NX], k[6][HDA_NX], y[HDA_NX], f[HDA_NX], worst = 0.0;
    int row[HDA_NX];
    for (int i = 0; i < HDA_NX; i++) {
        for (int j = 0; j < HDA_NX; j++) A[i][j] = (i == j ? 1.0 / (h * gamma_) : 0.0) - J[j * HDA_NX + i];
    }
    if (!factor_matrix(A, row)) return give_up(out);
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
        solve_factored(A, row, k[stage]);
    }
    for (int i = 0; i < HDA_NX; i++) {
        out[i] = y[i] + k[5][i];
        const double e = fabs(k[5][i]) / (HDA_TOLERANCE * (bound[i] + fabs(x[i])));
        worst = e <= worst ? worst : e < INFINITY && worst < INFINITY ? e : INFINITY;
    }
    return worst < INFINITY ? worst : give_up(out);
}

/* The step in parts that keep the tolerance: halves of halves, at most HDA_MOST_PARTS of them, whose lengths go to
 * `lengths`. Returns their number. The error goes with the fourth power of a part, so a part is doubled where 16 times
 * its error is fine. */
static int adapt_parts(const double *x, const double *u, const double *c, double h, double *lengths, double *out) {
    double at[HDA_NX], next[HDA_NX], by_x[HDA_NX * HDA_NX];
    long part = 0, whole = 1; /* the step is divided into `whole` parts, `part` of which are done */
    int count = 0;
    memcpy(at, x, sizeof at);
    while (part < whole) {
        double error;
        hda_state_jacobian(at, u, c, by_x);
        while ((error = rodas_step(at, u, c, by_x, h / (double)whole, next)) > 1.0 && whole < HDA_MOST_PARTS) {
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
static void follow_parts(const double *x, const double *u, const double *c, const double *lengths, int count,
                         double *out) {
    double at[HDA_NX], by_x[HDA_NX * HDA_NX];
    memcpy(at, x, sizeof at);
    for (int k = 0; k < count; k++) {
        double next[HDA_NX];
        hda_state_jacobian(at, u, c, by_x);
        rodas_step(at, u, c, by_x, lengths[k], next);
        memcpy(at, next, sizeof at);
    }
    memcpy(out, at, sizeof at);
}

void hda_step(const double *x, const double *u, const double *c, const double *h, double *out) {
    double lengths[HDA_MOST_PARTS];
    adapt_parts(x, u, c, *h, lengths, out);
}

/* Central differences over the parts of the step itself, so that no change of parts disturbs them. */
void hda_step_jacobian(const double *x, const double *u, const double *p, const double *h, double *next, double *by_x,
                       double *by_u, double *by_p) {
    double c[HDA_NC], w[HDA_NX + HDA_NU + HDA_NP], high[HDA_NX], low[HDA_NX], lengths[HDA_MOST_PARTS];
    memcpy(w, x, HDA_NX * sizeof *w);
    memcpy(w + HDA_NX, u, HDA_NU * sizeof *w);
    memcpy(w + HDA_NX + HDA_NU, p, HDA_NP * sizeof *w);
    hda_prepare(w + HDA_NX + HDA_NU, c);
    const int count = adapt_parts(w, w + HDA_NX, c, *h, lengths, next);
    for (int j = 0; j < HDA_NX + HDA_NU + HDA_NP; j++) {
        const int parameter = j >= HDA_NX + HDA_NU;
        const double keep = w[j], d = 6e-6 * (fabs(keep) + width[j]);
        double *column = j < HDA_NX  ? by_x + j * HDA_NX
                         : parameter ? by_p + (j - HDA_NX - HDA_NU) * HDA_NX
                                     : by_u + (j - HDA_NX) * HDA_NX;
        w[j] = keep + d;
        if (parameter) hda_prepare(w + HDA_NX + HDA_NU, c);
        follow_parts(w, w + HDA_NX, c, lengths, count, high);
        w[j] = keep - d;
        if (parameter) hda_prepare(w + HDA_NX + HDA_NU, c);
        follow_parts(w, w + HDA_NX, c, lengths, count, low);
        w[j] = keep;
        for (int i = 0; i < HDA_NX; i++) column[i] = (high[i] - low[i]) / (2.0 * d);
    }
}

#endif
