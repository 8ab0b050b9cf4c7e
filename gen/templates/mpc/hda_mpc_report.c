/* The report of a tick: what is active, what is violated and by how much, what was planned. */
#include "hda_mpc.h"

#include <string.h>

#include "hda_float.h"

enum {
    NX = HDA_MPC_NX,
    NU = HDA_N,
    N = HDA_MPC_N,
    ROWS = HDA_MPC_ROWS,
    HARD = HDA_MPC_HARD,
    SIMPLES = HDA_MPC_SIMPLES,
    NG = HDA_MPC_NG
};

static const double scale[] = HDA_MPC_SCALE, full[] = HDA_MPC_TORQUE;
static const int simple[] = HDA_MPC_SIMPLE;

#define SLIGHT 0.05 /* share of a limit: what is beyond it by less, noise may have moved there */
#define SLOW 0.2    /* s: a force that comes within it is a collision, one that grows slower is a push */

static int family_of_row(int row) {
    if (row < HARD + SIMPLES) return row / NU;
    row -= HARD + SIMPLES;
    return row < HDA_MPC_FLEXIBLE ? 4 : row == HDA_MPC_FLEXIBLE ? 5 : 6;
}

static void keep_largest(double *most, double value) {
    if (value > *most) *most = value;
}

/* How far beyond its limits a row is, SI. */
static double violation_of_row(const hda_mpc *k, int row, double value) {
    const double high = value - k->limits[row][1], low = k->limits[row][0] - value;
    return (high > low ? high : low) * k->unit[row];
}

double hda_mpc_length(const double *a) {
    double length = hda_length(a[0], a[1]);
    for (int i = 2; i < HDA_TIP; i++) length = hda_length(length, a[i]);
    return length;
}

void hda_mpc_detect_contact(hda_mpc *k) {
    hda_mpc_report *r = &k->report;
    double map[HDA_TIP * NU], departed[HDA_TIP];
    hda_force_map(k->estimator.last, k->c, map);
    for (int i = 0; i < HDA_TIP; i++) {
        r->observed_force[i] = 0.0;
        for (int j = 0; j < NU; j++)
            r->observed_force[i] += map[i * NU + j] * k->estimator.outside[j] / k->estimator.ratio[j];
    }
    for (int i = 0; i < HDA_TIP; i++) departed[i] = r->observed_force[i] - k->expected[i];
    r->collision = hda_mpc_length(departed) > k->settings.noise.collision;
    for (int i = 0; i < HDA_TIP; i++)
        k->expected[i] += k->guard.config.period / SLOW * (r->observed_force[i] - k->expected[i]);
}

static double distance(const double *a, const double *b) {
    double apart[HDA_TIP];
    for (int i = 0; i < HDA_TIP; i++) apart[i] = a[i] - b[i];
    return hda_mpc_length(apart);
}

/* Whether a path's point is farther than the arm is long, nearer than its longest link lets the others come, or beyond
 * the range of a joint. */
static int is_out_of_reach(const hda_mpc *k, const double *path) {
    if (HDA_MPC_JOINT_SPACE) {
        for (int j = 0; j < NU; j++)
            if (path[j] < k->settings.position_low[j] || path[j] > k->settings.position_high[j]) return 1;
        return 0;
    }
    double points[HDA_TIP * (NU + 1)], q[NU], length = 0.0, longest = 0.0;
    for (int j = 0; j < NU; j++) q[j] = k->x[simple[j]];
    hda_points(q, k->c, points);
    for (int i = 0; i < NU; i++) {
        const double link = distance(points + HDA_TIP * (i + 1), points + HDA_TIP * i);
        length += link;
        keep_largest(&longest, link);
    }
    const double far = distance(path, points);
    return HDA_MPC_TURNING && (far > length || far < 2.0 * longest - length);
}

int hda_mpc_check_limits(const hda_mpc *k, const double *path) {
    double y[HDA_MPC_SHOWN], Y[HDA_MPC_NY * NX], g[NG], G[NG * NX];
    hda_mpc_compute_outputs(k, k->x, y, Y, g, G);
    for (int row = HARD; row < ROWS; row++) {
        const double value = row < HARD + SIMPLES ? k->x[simple[row - HARD]] : g[row - HARD - SIMPLES];
        if (violation_of_row(k, row, value) > SLIGHT * k->size[row] * k->unit[row]) return HDA_MPC_OUTSIDE;
    }
    return is_out_of_reach(k, path) ? HDA_MPC_UNREACHED : 0;
}

HDA_APART static void fill_report(hda_mpc *k) {
    hda_mpc_report *r = &k->report;
    double y[HDA_MPC_SHOWN], Y[HDA_MPC_NY * NX], g[NG], G[NG * NX];
    memset(r->active_of, 0, sizeof r->active_of);
    memset(r->violated_by, 0, sizeof r->violated_by);
    memset(r->foreseen_by, 0, sizeof r->foreseen_by);
    hda_mpc_compute_outputs(k, k->x, y, Y, g, G);
    for (int i = 0; i < SIMPLES; i++)
        keep_largest(&r->violated_by[family_of_row(HARD + i)], violation_of_row(k, HARD + i, k->x[simple[i]]));
    for (int i = 0; i < NG; i++)
        keep_largest(&r->violated_by[family_of_row(HARD + SIMPLES + i)], violation_of_row(k, HARD + SIMPLES + i, g[i]));
    for (int e = 0; e < HDA_MPC_ALL; e++) {
        const int row = e % ROWS, node = e / ROWS;
        if (k->solution.dual[e] != 0.0) r->active_of[family_of_row(row)] += 1.0;
        if (row < HARD) continue;
        double beyond = -1.0;
        if (row < HARD + SIMPLES) {
            beyond = violation_of_row(k, row, k->x[(node + 1) * NX + simple[row - HARD]]);
        } else {
            const double *slope = k->qp.G + (node * NG + row - HARD - SIMPLES) * NX;
            double value = k->g[node * NG + row - HARD - SIMPLES];
            for (int i = 0; i < NX; i++) value += slope[i] * k->solution.x[node * NX + i];
            beyond = violation_of_row(k, row, value);
        }
        keep_largest(&r->foreseen_by[family_of_row(row)], beyond);
    }
    r->failures = k->failures;
    r->factored = k->solution.factored;
    r->interior = k->solution.interior;
    r->active = k->solution.active;
    r->residual = k->solution.residual;
    r->innovation = k->estimator.innovation;
    memcpy(r->disturbance, k->estimator.s + HDA_NX, sizeof r->disturbance);
    memcpy(r->yielded, k->yielded, sizeof r->yielded);
    for (int e = 0; e < N * NU; e++) r->plan[e] = full[e % NU] * k->T[e];
    for (int e = 0; e < N * NX; e++) r->predicted[e] = scale[e % NX] * k->x[NX + e];
}

void hda_mpc_fill_report(hda_mpc *k) {
    const hda_float caller = hda_float_hold();
    fill_report(k);
    hda_float_restore(&caller);
}
