/* The target, the cost's slope, the rows' bounds, and the trajectory one period on.
 *
 * Legend: M x'' + B x' + K x = F the wanted admittance about the commanded path; F the tip force, which fades at
 * `decay` over the horizon. In space the same holds for the rotation vector of a turn, pulled by D'm (hda_mpc_axes.h).
 */
#include "hda_mpc.h"

#include <math.h>
#include <string.h>

#include "hda_mpc_axes.h"

enum {
    NX = HDA_MPC_NX,
    NU = HDA_N,
    N = HDA_MPC_N,
    NY = HDA_MPC_NY,
    NG = HDA_MPC_NG,
    AXES = HDA_MPC_AXES,
    ROWS = HDA_MPC_ROWS,
    HARD = HDA_MPC_HARD,
    SIMPLES = HDA_MPC_SIMPLES
};

static const int simple[] = HDA_MPC_SIMPLE;
static const double scale[] = HDA_MPC_SCALE, full[] = HDA_MPC_TORQUE;
static const int is_flexible[] = HDA_MPC_IS_FLEXIBLE;

/* Share of its limit: the speed at which a tip beyond a wall, or a joint beyond its range, has to come back. */
#define BACK 0.5

/* exp of a 3 x 3 matrix, by squaring what is left of 1. */
static void matrix_exponential(const double *A, double time, double *out) {
    double X[9], Y[9], Z[9];
    for (int i = 0; i < 9; i++) Y[i] = X[i] = A[i] * time / 1099511627776.0; /* 2^40 */
    for (int order = 4; order >= 2; order--) {
        for (int i = 0; i < 9; i++) {
            Z[i] = X[i];
            for (int l = 0; l < 3; l++) Z[i] += X[i / 3 * 3 + l] * Y[l * 3 + i % 3] / order;
        }
        memcpy(Y, Z, sizeof Y);
    }
    for (int square = 0; square < 40; square++) { /* exp - 1 keeps every digit of small entries */
        for (int i = 0; i < 9; i++) {
            Z[i] = 2.0 * Y[i];
            for (int l = 0; l < 3; l++) Z[i] += Y[i / 3 * 3 + l] * Y[l * 3 + i % 3];
        }
        memcpy(Y, Z, sizeof Y);
    }
    for (int i = 0; i < 9; i++) out[i] = Y[i] + (i % 4 == 0 ? 1.0 : 0.0);
}

/* Limits of the rows and what one unit of a row is, in SI. */
static void set_row_limits(hda_mpc *k) {
    const hda_mpc_settings *s = &k->settings;
    const double keep = 1.0 - s->margin;
    double ratio[NU];
    hda_mpc_read_ratios(k->c, ratio);
    memset(k->back, 0, sizeof k->back);
    for (int j = 0; j < NU; j++) {
        const double gear = ratio[j] < 0.0 ? -ratio[j] : ratio[j], speed = s->motor_speed[j],
                     middle = 0.5 * (s->position_low[j] + s->position_high[j]),
                     half = 0.5 * (s->position_high[j] - s->position_low[j]);
        const double limits[4][3] = {
            {-k->guard.config.torque_limit[j], k->guard.config.torque_limit[j], full[j]},
            {-k->guard.config.torque_rate[j], k->guard.config.torque_rate[j], full[j]}, /* per second */
            {middle - keep * half, middle + keep * half, scale[simple[j]]},
            /* the state of a rigid joint is the joint's */
            {-keep * speed, keep * speed, scale[simple[NU + j]] * (is_flexible[j] ? 1.0 : gear)},
        };
        k->back[HARD + j] = BACK * speed / gear / scale[simple[j]];
        const int at[4] = {j, NU + j, HARD + j, HARD + NU + j};
        for (int r = 0; r < 4; r++) {
            k->unit[at[r]] = limits[r][2];
            for (int side = 0; side < 2; side++) k->limits[at[r]][side] = limits[r][side] / limits[r][2];
        }
    }
    for (int g = 0; g < NG; g++) {
        const int row = HARD + SIMPLES + g, wall = g - HDA_MPC_FLEXIBLE - 1;
        k->unit[row] = 1.0;
        k->limits[row][0] = g < HDA_MPC_FLEXIBLE ? -keep * s->joint_torque[k->flexible[g]] : -2.0 * HDA_MPC_FREE;
        k->limits[row][1] = g < HDA_MPC_FLEXIBLE ? -k->limits[row][0] : wall < 0 ? keep * s->tip_speed : s->give[wall];
        if (wall >= 0) k->back[row] = BACK * s->tip_speed;
    }
}

/* Penalties, in the cost's normalised units, by each row's size. */
static void set_penalties(hda_mpc *k) {
    const hda_mpc_settings *s = &k->settings;
    for (int row = 0; row < ROWS; row++) {
        k->size[row] = 0.5 * (k->limits[row][1] - k->limits[row][0]);
        /* m, of a wall */
        if (row >= HARD + SIMPLES + HDA_MPC_FLEXIBLE)
            k->size[row] = row == HARD + SIMPLES + HDA_MPC_FLEXIBLE ? s->tip_speed : 0.02;
    }
    for (int e = 0; e < HDA_MPC_ALL; e++) {
        const int row = e % ROWS;
        k->qp.linear[e] = row < HARD ? 10.0 * HDA_MPC_FREE : s->penalty_linear / k->size[row];
        k->qp.square[e] = row < HARD ? 0.0 : s->penalty_square / (k->size[row] * k->size[row]);
    }
}

void hda_mpc_set_constants(hda_mpc *k) {
    const hda_mpc_settings *s = &k->settings;
    static const int joint_of[] = HDA_MPC_FLEXIBLE_JOINTS;
    double time = 0.0;
    for (int g = 0; g < HDA_MPC_FLEXIBLE; g++) k->flexible[g] = joint_of[g];
    hda_mpc_stage_constants(k->c, k->shared);
    memcpy(k->shared + HDA_MPC_AT_SMOOTHING, s->smoothing, sizeof s->smoothing);
    for (int i = 0; i < HDA_MPC_WALL_NUMBERS * HDA_MPC_WALLS; i++) k->shared[HDA_MPC_AT_WALLS + i] = s->walls[i];
    for (int axis = 0; axis < AXES; axis++) {
        const double M = s->mass[axis],
                     A[9] = {0.0, 1.0, 0.0,      -s->stiffness[axis] / M, -s->damping[axis] / M, 1.0 / M,
                             0.0, 0.0, -s->decay};
        matrix_exponential(A, k->guard.config.period, k->carry[axis]);
        for (int node = 0; node < N; node++) matrix_exponential(A, s->grid[node], k->carry[(node + 1) * AXES + axis]);
    }
    for (int node = 0; node < N; node++) { /* in the middle of the node */
        k->fading[node] = exp(-s->decay * (time + 0.5 * s->grid[node]));
        time += s->grid[node];
    }
    double most = s->weight_position > s->weight_velocity ? s->weight_position : s->weight_velocity;
    if (HDA_MPC_POSITIONS < AXES && s->weight_orientation > most) most = s->weight_orientation;
    k->weight = 10.0 / (most > s->weight_posture ? most : s->weight_posture);
    for (int m = 0; m < NY; m++) {
        const int turns = m % AXES >= HDA_MPC_POSITIONS;
        const double weight = m < AXES       ? (turns ? s->weight_orientation : s->weight_position)
                              : m < 2 * AXES ? (turns ? s->weight_turning : s->weight_velocity)
                                             : s->weight_posture;
        k->output_weight[0][m] = k->weight * weight;
        k->output_weight[1][m] = k->weight * weight * s->terminal;
    }
    for (int e = 0; e < N * NU; e++) {
        k->qp.R[e] = k->weight * s->weight_torque; /* torques are shares of the motor's largest */
        k->qp.D[e] = k->weight * s->weight_rate;
    }
    set_row_limits(k);
    set_penalties(k);
    hda_mpc_set_torsion_limits(k);
}

static double clamp_bound(double value) {
    return value > HDA_MPC_FREE ? 2.0 * HDA_MPC_FREE : value < -HDA_MPC_FREE ? -2.0 * HDA_MPC_FREE : value;
}

/* How far the present state is beyond its places: walls and ranges of joints; in the rows' units, 0 within. */
static void find_violations(const hda_mpc *k, double (*beyond)[2]) {
    double y[HDA_MPC_SHOWN], Y[NY * NX], g[NG], G[NG * NX];
    if (HDA_MPC_WALLS) hda_mpc_compute_outputs(k, k->x, y, Y, g, G);
    for (int row = HARD; row < ROWS; row++) {
        beyond[row][0] = beyond[row][1] = 0.0;
        if (k->back[row] == 0.0) continue;
        const double now = row < HARD + SIMPLES ? k->x[simple[row - HARD]] : g[row - HARD - SIMPLES];
        if (now < k->limits[row][0]) beyond[row][0] = k->limits[row][0] - now;
        if (now > k->limits[row][1]) beyond[row][1] = now - k->limits[row][1];
    }
}

/* What is left of it at a time, where it comes back as it has to: so the way back does not ask for more speed than is
 * allowed. */
static double remaining_violation(const hda_mpc *k, double (*beyond)[2], int row, int side, double time) {
    const double rest = row < HARD ? 0.0 : beyond[row][side] - k->back[row] * time;
    return rest > 0.0 ? rest : 0.0;
}

void hda_mpc_set_bounds(hda_mpc *k) {
    const hda_mpc_settings *s = &k->settings;
    hda_mpc_qp *qp = &k->qp;
    double beyond[ROWS][2], time = 0.0;
    find_violations(k, beyond);
    for (int node = 0; node < N; node++) {
        time += s->grid[node];
        const double *x = k->x + (node + 1) * NX, span = node ? s->grid[node - 1] : k->guard.config.period;
        double *low = qp->low + node * ROWS, *high = qp->high + node * ROWS;
        for (int row = 0; row < ROWS; row++) {
            const int j = row % NU;
            const double before = node ? k->T[(node - 1) * NU + j] : k->guard.sent[j] / full[j];
            const double change = k->T[node * NU + j] - before, share = row >= NU && row < HARD ? span : 1.0;
            const double now = row < NU               ? k->T[node * NU + j]
                               : row < HARD           ? change
                               : row < HARD + SIMPLES ? x[simple[row - HARD]]
                                                      : k->g[node * NG + row - HARD - SIMPLES];
            low[row] = clamp_bound(share * k->limits[row][0] - remaining_violation(k, beyond, row, 0, time) - now);
            high[row] = clamp_bound(share * k->limits[row][1] + remaining_violation(k, beyond, row, 1, time) - now);
        }
        for (int j = 0; j < NU; j++) {
            const double before = node ? k->T[(node - 1) * NU + j] : k->guard.sent[j] / full[j];
            qp->r[node * NU + j] = qp->R[node * NU + j] * (k->T[node * NU + j] - k->hold[j] / full[j]);
            qp->d[node * NU + j] = qp->D[node * NU + j] * (k->T[node * NU + j] - before);
        }
    }
}

static void carry_admittance(const double *E, double force, double *position, double *velocity) {
    const double x = *position, v = *velocity;
    *position = E[0] * x + E[1] * v + E[2] * force;
    *velocity = E[3] * x + E[4] * v + E[5] * force;
}

/* The force along each axis of the target: at the tip, or as torques of the joints. */
static void force_along_axes(const hda_mpc *k, const double *force, double *axis) {
    if (!HDA_MPC_JOINT_SPACE) {
        memcpy(axis, force, AXES * sizeof *axis);
        return;
    }
    double J[HDA_WRENCH * NU], velocity[HDA_WRENCH], turn[HDA_WRENCH], still[NU] = {0}, q[NU];
    for (int j = 0; j < NU; j++) q[j] = k->x[simple[j]];
    hda_tip_jacobian(q, still, k->c, J, velocity, turn);
    for (int j = 0; j < NU; j++) {
        const double *column = J + HDA_WRENCH * j;
        axis[j] = column[0] * force[0] + column[1] * force[1];
        for (int i = 2; i < HDA_WRENCH; i++) axis[j] += column[i] * force[i];
    }
}

/* The target's displacement over one of the spans in `carry`. */
static void carry_target(const hda_mpc *k, int span, const double *force, double *yielded) {
    double pull[AXES];
    axes_pull(yielded, force, pull);
    for (int a = 0; a < AXES; a++)
        carry_admittance(k->carry[span * AXES + a], pull[a], yielded + a, yielded + AXES + a);
}

void hda_mpc_begin_admittance(hda_mpc *k, const double *q, const double *path) {
    double place[HDA_MPC_POSITIONS + HDA_MPC_ORIENTATION];
    axes_place(q, k->c, place);
    axes_begin(place, path, k->yielded);
}

void hda_mpc_step_admittance(hda_mpc *k, const double *force) {
    double axis[AXES];
    force_along_axes(k, force, axis);
    carry_target(k, 0, axis, k->yielded);
}

void hda_mpc_set_targets(hda_mpc *k, const double *path, const double *force) {
    double yielded[2 * AXES], axis[AXES], goal[NY] = {0};
    memcpy(yielded, k->yielded, sizeof yielded);
    force_along_axes(k, force, axis);
    for (int node = 0; node < N; node++) {
        const double *Y = k->Y + node * NY * NX, *y = k->y + node * HDA_MPC_SHOWN;
        double *restrict h = k->qp.h + node * NX;
        carry_target(k, node + 1, axis, yielded);
        for (int a = 0; a < AXES; a++) axis[a] *= k->carry[(node + 1) * AXES + a][8];
        axes_goal(path + (node + 1) * 2 * AXES, yielded, y + NY, goal);
        for (int i = 0; i < NX; i++) h[i] = 0.0;
        for (int m = 0; m < NY; m++) {
            k->goal[node * NY + m] = goal[m];
            const double pull = k->output_weight[node == N - 1][m] * (y[m] - goal[m]);
            for (int i = 0; i < NX; i++) h[i] += pull * Y[i * NY + m];
        }
    }
}

/* Where in the plan the time `at` lies: node, and share of it that is over. */
static int place_in_plan(const double *grid, double at, double *share) {
    int node = 0;
    while (node < N - 1 && at > grid[node]) at -= grid[node++];
    *share = at / grid[node] < 1.0 ? at / grid[node] : 1.0;
    return node;
}

/* One period on: states between the old nodes by a straight line; each torque the mean of the old ones over its new
 * node; the multipliers of the node that each new one begins in. Beyond the horizon the last node goes on. */
void hda_mpc_shift_plan(hda_mpc *k) {
    const double *grid = k->settings.grid, period = k->guard.config.period;
    double old_x[(N + 1) * NX], old_T[N * NU], old_dual[HDA_MPC_ALL], begun = period;
    memcpy(old_x, k->x, sizeof old_x);
    memcpy(old_T, k->T, sizeof old_T);
    memcpy(old_dual, k->solution.dual, sizeof old_dual);
    for (int node = 0; node < N; node++) {
        double from, to;
        const int first = place_in_plan(grid, begun, &from), last = place_in_plan(grid, begun + grid[node], &to),
                  nearest = from < 0.5 || first == N - 1 ? first : first + 1;
        for (int i = 0; i < NX; i++)
            k->x[(node + 1) * NX + i] = (1.0 - to) * old_x[last * NX + i] + to * old_x[(last + 1) * NX + i];
        for (int j = 0; j < NU; j++) {
            double sum = 0.0, time = 0.0;
            for (int m = first; m <= last; m++) {
                const double part = grid[m] * ((m == last ? to : 1.0) - (m == first ? from : 0.0));
                sum += part * old_T[m * NU + j];
                time += part;
            }
            k->T[node * NU + j] = time > 0.0 ? sum / time : old_T[last * NU + j];
        }
        memcpy(k->solution.dual + node * ROWS, old_dual + nearest * ROWS, ROWS * sizeof *old_dual);
        begun += grid[node];
    }
}
