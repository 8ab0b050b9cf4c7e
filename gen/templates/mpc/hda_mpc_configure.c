/* What a controller is told, checked: all of it is taken, or nothing. */
#include "hda_mpc.h"

#include <math.h>
#include <string.h>

#include "hda_guard_held.h"

enum { NU = HDA_N, N = HDA_MPC_N, AXES = HDA_MPC_AXES, REALS = sizeof(hda_mpc_settings) / sizeof(double) };

#define LONGEST_NODE 0.2 /* s */

static int is_positive(const double *a, int count) {
    for (int i = 0; i < count; i++)
        if (!(a[i] > 0.0)) return 0;
    return 1;
}

static int is_not_negative(const double *a, int count) {
    for (int i = 0; i < count; i++)
        if (!(a[i] >= 0.0)) return 0;
    return 1;
}

static int check_soft_limits(const hda_mpc_settings *s) {
    for (int j = 0; j < NU; j++)
        if (!(s->position_low[j] < s->position_high[j])) return HDA_MPC_LIMIT;
    if (!is_positive(s->motor_speed, NU) || !is_positive(s->joint_torque, NU) || !(s->tip_speed > 0.0) ||
        !(s->margin >= 0.0 && s->margin < 0.5))
        return HDA_MPC_LIMIT;
    for (int w = 0; w < HDA_MPC_WALLS; w++) {
        const double length = hda_mpc_length(s->walls + HDA_MPC_WALL_NUMBERS * w);
        if (!(length > 1.0 - 1e-9 && length < 1.0 + 1e-9)) return HDA_MPC_WALL;
        if (!(s->give[w] >= 0.0)) return HDA_MPC_LIMIT;
    }
    return 0;
}

static int find_wrong_setting(const hda_mpc_settings *s, double period) {
    const double weights[] = {
        s->weight_position,    s->weight_velocity, s->weight_posture, s->weight_torque,  s->weight_rate,
        s->weight_orientation, s->weight_turning,  s->penalty_linear, s->penalty_square, s->decay};
    if (hda_not_finite((const double *)s, REALS)) return HDA_MPC_NUMBER;
    for (int node = 0; node < N; node++)
        if (!(s->grid[node] >= period * (1.0 - 1e-9) && s->grid[node] <= LONGEST_NODE)) return HDA_MPC_GRID;
    if (!is_not_negative(weights, (int)(sizeof weights / sizeof *weights)) ||
        !(s->weight_position + s->weight_velocity > 0.0) || !(s->weight_torque + s->weight_rate > 0.0) ||
        !(s->terminal >= 0.0))
        return HDA_MPC_WEIGHT;
    if (!is_positive(s->mass, AXES) || !is_not_negative(s->damping, AXES) || !is_not_negative(s->stiffness, AXES))
        return HDA_MPC_ADMITTANCE;
    if (!is_positive(s->smoothing, NU) || !is_not_negative(s->hold_stiffness, NU) ||
        !is_not_negative(s->hold_damping, NU))
        return HDA_MPC_LIMIT;
    if (!is_positive((const double *)&s->noise, sizeof s->noise / sizeof(double))) return HDA_MPC_NOISE;
    if (!(s->steps >= 1.0 && s->steps <= 100.0 && s->steps == (double)(int)s->steps)) return HDA_MPC_LATE;
    if (!(s->delay >= 0.0 && s->delay <= HDA_MPC_LATEST && s->delay == (double)(int)s->delay)) return HDA_MPC_LATE;
    if (!(s->backend == 0.0 || s->backend == 1.0 || s->backend == 2.0) || !(s->tolerance > 0.0) ||
        !(s->iterations >= 1.0 && s->iterations <= 1e6))
        return HDA_MPC_NUMBER;
    return check_soft_limits(s);
}

HDA_APART static int configure(hda_mpc *k, const double *p, const hda_mpc_settings *settings,
                               const hda_guard_config *config) {
    if (!k || !p || !settings || !config) return HDA_MPC_CALL;
    if (hda_not_finite(p, HDA_NP)) return HDA_MPC_PARAMETER;
    const int refused = find_wrong_setting(settings, config->period);
    if (refused) return refused;
    const int guard = hda_guard_configure_held(&k->guard, config);
    if (guard) return guard;
    memset((char *)k + sizeof k->guard, 0, sizeof *k - sizeof k->guard);
    k->settings = *settings;
    hda_prepare(p, k->c);
    hda_mpc_set_constants(k);
    k->configured = 1;
    return 0;
}

HDA_APART static int limit(hda_mpc *k, const hda_mpc_settings *settings) {
    if (!k || !settings) return HDA_MPC_CALL;
    hda_mpc_settings moved = k->settings;
    memcpy(moved.position_low, settings->position_low, sizeof moved.position_low);
    memcpy(moved.position_high, settings->position_high, sizeof moved.position_high);
    memcpy(moved.motor_speed, settings->motor_speed, sizeof moved.motor_speed);
    memcpy(moved.joint_torque, settings->joint_torque, sizeof moved.joint_torque);
    memcpy(moved.walls, settings->walls, sizeof moved.walls);
    memcpy(moved.give, settings->give, sizeof moved.give);
    moved.tip_speed = settings->tip_speed;
    if (hda_not_finite((const double *)&moved, REALS)) return HDA_MPC_NUMBER;
    const int refused = check_soft_limits(&moved);
    if (refused) return refused;
    k->settings = moved;
    hda_mpc_set_constants(k);
    k->prepared = 0;
    return 0;
}

int hda_mpc_configure(hda_mpc *k, const double *p, const hda_mpc_settings *settings, const hda_guard_config *config) {
    const hda_float caller = hda_float_hold();
    const int status = configure(k, p, settings, config);
    hda_float_restore(&caller);
    return status;
}

int hda_mpc_limit(hda_mpc *k, const hda_mpc_settings *settings) {
    const hda_float caller = hda_float_hold();
    const int status = limit(k, settings);
    hda_float_restore(&caller);
    return status;
}
