/* Linearisation: the step of every node with its Jacobians, the outputs that cost, the rows that are limited; nodes
 * side by side in vectors.
 *
 * Legend: f rate of x, J its Jacobian by x, h duration of the node. The step is exponential, x + Phi f with Phi =
 * integral of exp(J s) ds over the node: exact where the arm is linear, stable however stiff, one evaluation a node.
 * With it A = exp(J h) = 1 + J Phi and B = Phi df/dT. Phi by a series on h / 2^s, then Phi <- Phi (1 + exp), s times
 * (Hochbruck, Ostermann, Acta Numerica 19 (2010) 209, 2.1 and 2.26). */
#include "hda_mpc.h"

#include <string.h>

#include "hda_mpc_stage.h"

enum {
    NX = HDA_MPC_NX,
    HALF = NX / 2,
    NU = HDA_N,
    N = HDA_MPC_N,
    W = HDA_BATCH_WIDTH,
    NY = HDA_MPC_NY,
    NG = HDA_MPC_NG,
    SHOWN = HDA_MPC_SHOWN,
    MOST_SQUARINGS = 12
};

typedef hda_batch V;

static const V zero = {0};
static const int motors[] = HDA_MPC_MOTORS, simple[] = HDA_MPC_SIMPLE;

#define TURN 1.0 /* rad (m): no spring is wound farther */

/* C = J X for X with NX columns: the positions' rows of J are SPEED times the velocities. */
static void multiply_jacobian(const V *J, V h, const V *X, V *C) {
    const V speed = HDA_MPC_SPEED * h;
    for (int j = 0; j < NX; j++) {
        V sum[HALF];
        for (int i = 0; i < HALF; i++) sum[i] = zero;
        for (int l = 0; l < NX; l++)
            for (int i = 0; i < HALF; i++) sum[i] += J[l * HALF + i] * X[j * NX + l];
        for (int i = 0; i < HALF; i++) {
            C[j * NX + i] = speed * X[j * NX + HALF + i];
            C[j * NX + HALF + i] = h * sum[i];
        }
    }
}

/* Times that the node is halved, so that the series converges: from the largest row sum of J h over the nodes. */
static int count_halvings(const V *J, V h) {
    double most = 0.0;
    for (int i = 0; i < HALF; i++) {
        V sum = HDA_MPC_SPEED - zero;
        for (int l = 0; l < NX; l++) {
            V size;
            hda_batch_fabs(&J[l * HALF + i], &size);
            sum = sum + size;
        }
        sum = sum * h;
        for (int lane = 0; lane < W; lane++) most = sum[lane] > most ? sum[lane] : most;
    }
    int s = 0;
    for (; s < MOST_SQUARINGS && most > 0.5; s++) most *= 0.5;
    return s;
}

/* Phi and exp(J h). */
static void node_exponential(const V *J, V h, V *Phi, V *A) {
    static const double share[] = {1.0 / 7, 1.0 / 6, 1.0 / 5, 1.0 / 4, 1.0 / 3, 1.0 / 2};
    V next[NX * NX];
    const int s = count_halvings(J, h);
    const double part = 1.0 / (double)(1 << s);
    const V step = h * part;
    for (int i = 0; i < NX * NX; i++) Phi[i] = zero;
    for (int i = 0; i < NX; i++) Phi[i * (NX + 1)] = 1.0 - zero;
    for (int order = 0; order < 6; order++) { /* 1 + X/2 (1 + X/3 (...)) */
        multiply_jacobian(J, step * share[order], Phi, next);
        for (int i = 0; i < NX * NX; i++) Phi[i] = next[i];
        for (int i = 0; i < NX; i++) Phi[i * (NX + 1)] += 1.0;
    }
    for (int i = 0; i < NX * NX; i++) Phi[i] = Phi[i] * step;
    for (int square = 0; square <= s; square++) {
        multiply_jacobian(J, 1.0 - zero, Phi, A);
        for (int i = 0; i < NX; i++) A[i * (NX + 1)] += 1.0;
        if (square == s) break;
        for (int j = 0; j < NX; j++) {
            V sum[NX];
            for (int i = 0; i < NX; i++) sum[i] = Phi[j * NX + i];
            for (int l = 0; l < NX; l++)
                for (int i = 0; i < NX; i++) sum[i] += Phi[l * NX + i] * A[j * NX + l];
            for (int i = 0; i < NX; i++) next[j * NX + i] = sum[i];
        }
        for (int i = 0; i < NX * NX; i++) Phi[i] = next[i];
    }
}

/* Lane by lane into arrays of nodes. */
static void spread_lanes(const V *from, int count, int first, double *to) {
    const double *entries = (const double *)from;
    for (int lane = 0; lane < W && first + lane < N; lane++)
        for (int i = 0; i < count; i++) to[(first + lane) * count + i] = entries[i * W + lane];
}

static void gather_lanes(const double *from, int count, int first, int last, V *to) {
    double *entries = (double *)to;
    for (int lane = 0; lane < W; lane++) {
        const int k = first + lane < last ? first + lane : last;
        for (int i = 0; i < count; i++) entries[i * W + lane] = from[k * count + i];
    }
}

static void linearise_steps(hda_mpc *k, int first) {
    V x[NX], T[NU], F[HDA_WRENCH], rate[NX], J[NX * HALF], by_T[HALF * NU], Phi[NX * NX], A[NX * NX], B[NX * NU],
        next[NX], h;
    gather_lanes(k->x, NX, first, N - 1, x);
    gather_lanes(k->T, NU, first, N - 1, T);
    gather_lanes(k->settings.grid, 1, first, N - 1, &h);
    for (int i = 0; i < HDA_WRENCH; i++) F[i] = k->report.tip_force[i] - zero;
    for (int lane = 0; lane < W; lane++)
        for (int i = 0; i < HDA_WRENCH; i++) F[i][lane] *= k->fading[first + lane < N ? first + lane : N - 1];
    stage_rate(x, T, F, k->shared, rate + HALF, J, by_T);
    for (int i = 0; i < HALF; i++) rate[i] = HDA_MPC_SPEED * x[HALF + i];
    node_exponential(J, h, Phi, A);
    for (int i = 0; i < NX; i++) next[i] = x[i];
    for (int l = 0; l < NX; l++)
        for (int i = 0; i < NX; i++) next[i] += Phi[l * NX + i] * rate[l];
    for (int j = 0; j < NU; j++)
        for (int i = 0; i < NX; i++) {
            V sum = zero;
            for (int l = 0; l < HALF; l++) sum += Phi[(HALF + l) * NX + i] * by_T[j * HALF + l];
            B[j * NX + i] = sum;
        }
    spread_lanes(A, NX * NX, first, k->qp.A);
    spread_lanes(B, NX * NU, first, k->qp.B);
    spread_lanes(next, NX, first, k->qp.b);
}

static void linearise_outputs(hda_mpc *k, int first) {
    V x[NX], y[SHOWN], Y[NY * NX], g[NG], G[NG * NX];
    gather_lanes(k->x + NX, NX, first, N - 1, x);
    stage_look(x, k->shared, y, Y, g, G);
    spread_lanes(y, SHOWN, first, k->y);
    spread_lanes(Y, NY * NX, first, k->Y);
    spread_lanes(g, NG, first, k->g);
    spread_lanes(G, NG * NX, first, k->G);
}

/* H of node k + 1 from the outputs' Jacobian. */
static void set_curvature(hda_mpc *k, int node) {
    double *restrict H = k->qp.H + node * NX * NX;
    const double *Y = k->Y + node * NY * NX;
    for (int i = 0; i < NX * NX; i++) H[i] = 0.0;
    for (int m = 0; m < NY; m++) {
        double row[NX], scaled[NX];
        const double weight = k->output_weight[node == N - 1][m];
        for (int i = 0; i < NX; i++) {
            row[i] = Y[i * NY + m];
            scaled[i] = weight * row[i];
        }
        for (int j = 0; j < NX; j++)
            for (int i = 0; i < NX; i++) H[j * NX + i] += scaled[j] * row[i];
    }
    for (int g = 0; g < NG; g++)
        for (int i = 0; i < NX; i++) k->qp.G[(node * NG + g) * NX + i] = k->G[(node * NX + i) * NG + g];
}

/* Where a spring is wound beyond its joint's limit, the motor's angle is taken back to that limit: a spring that
 * stiffens has its pole not far beyond, and a line about a point near the pole says nothing of the arm. The node's
 * defect holds the difference. */
static void limit_torsion(hda_mpc *k) {
    for (int f = 0; f < HDA_MPC_FLEXIBLE; f++) {
        const int motor = motors[k->flexible[f]], link = simple[k->flexible[f]];
        const double side = k->wound[f] < 0.0 ? -1.0 : 1.0, most = side * k->wound[f];
        for (int node = 1; node <= N; node++) {
            double *x = k->x + node * NX;
            const double twist = side * x[motor] - x[link];
            if (twist > most) x[motor] = side * (x[link] + most);
            if (twist < -most) x[motor] = side * (x[link] - most);
        }
    }
}

void hda_mpc_linearise(hda_mpc *k) {
    limit_torsion(k);
    for (int first = 0; first < N; first += W) {
        linearise_steps(k, first);
        linearise_outputs(k, first);
    }
    for (int node = 0; node < N; node++) {
        for (int i = 0; i < NX; i++) k->qp.b[node * NX + i] -= k->x[(node + 1) * NX + i];
        set_curvature(k, node);
    }
}

void hda_mpc_stage_constants(const double *c, double *shared) {
    stage_constants(c, shared);
}

void hda_mpc_compute_outputs(const hda_mpc *k, const double *x, double *y, double *Y, double *g, double *G) {
    V at[NX], values[SHOWN], slopes[NY * NX], rows[NG], row_slopes[NG * NX];
    gather_lanes(x, NX, 0, 0, at);
    stage_look(at, k->shared, values, slopes, rows, row_slopes);
    for (int i = 0; i < SHOWN; i++) y[i] = values[i][0];
    for (int i = 0; i < NY * NX; i++) Y[i] = slopes[i][0];
    for (int i = 0; i < NG; i++) g[i] = rows[i][0];
    for (int i = 0; i < NG * NX; i++) G[i] = row_slopes[i][0];
}

void hda_mpc_set_torsion_limits(hda_mpc *k) {
    double x[NX] = {0}, y[SHOWN], Y[NY * NX], g[NG], G[NG * NX];
    for (int f = 0; f < HDA_MPC_FLEXIBLE; f++) {
        const int motor = motors[k->flexible[f]];
        double least = 0.0, most = TURN, side = 1.0;
        for (int half = 0; half < 50; half++) {
            x[motor] = 0.5 * (least + most);
            hda_mpc_compute_outputs(k, x, y, Y, g, G);
            side = g[f] < 0.0 ? -1.0 : 1.0; /* the ratio's sign */
            if (side * g[f] < k->settings.joint_torque[k->flexible[f]])
                least = x[motor];
            else
                most = x[motor];
        }
        x[motor] = 0.0;
        k->wound[f] = side * most;
    }
}
