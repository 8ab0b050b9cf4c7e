/* The predictive controller holds the arm where it is while something pushes its tip. mpc_settings.h is what `hdagen
 * mpc header` prints; compile with every hda_*.c but hda_python.c. */
#include "hda_mpc.h"

#include <stdio.h>
#include <string.h>

#include "mpc_settings.h"

static hda_mpc controller; /* zeros; all of the controller's memory */

static hda_guard_config guard(void) {
    hda_guard_config c = {0};
    double *const joints[] = {c.torque_limit, c.torque_rate,  c.motor_jump,
                              c.joint_jump,   c.safe_damping, c.safe_stiffness};
    c.version = HDA_GUARD_VERSION;
    c.size = sizeof c;
    c.joints = HDA_N;
    c.safe = (int32_t)mpc_guard_whole[0];
    c.stale_stamp_ticks = (int32_t)mpc_guard_whole[1];
    c.stale_bits_ticks = (int32_t)mpc_guard_whole[2];
    memcpy(&c.period, mpc_guard_real, 5 * sizeof(double)); /* period, its bounds, watchdog, force limit */
    for (int i = 0; i < 6; i++) memcpy(joints[i], mpc_guard_real + 5 + i * HDA_N, HDA_N * sizeof(double));
    return c;
}

int main(void) {
    static const double p[HDA_NP] = HDA_NOMINAL;
    hda_mpc_settings settings;
    hda_measurement m = {0};
    double c[HDA_NC], x[HDA_NX] = {0}, next[HDA_NX], u[HDA_NU] = {0}, torque[HDA_N], still[HDA_N] = {0},
                      path[HDA_MPC_PATH] = {0};
    double points[HDA_TIP * (HDA_N + 1)];
    const hda_guard_config config = guard();
    const double h = HDA_STEP;
    memcpy(&settings, mpc_settings, sizeof settings);
    hda_prepare(p, c);
    for (int j = 0; j < HDA_N; j++) x[HDA_POSITION + j] = still[j] = 0.5;
    double *const motors = x; /* flexible drives only: their motors stand first */
    for (int j = 0; j < HDA_N && HDA_MPC_FLEXIBLE == HDA_N; j++) motors[j] = 0.5 * mpc_ratio[j];
    hda_points(still, c, points);
    for (int e = 0; e < HDA_MPC_PATH; e += 2 * HDA_MPC_AXES)
        for (int a = 0; a < HDA_MPC_POSITIONS; a++) /* a tip in space turns to the base frame's orientation */
            path[e + a] = HDA_MPC_JOINT_SPACE ? still[a] : points[HDA_TIP * HDA_N + a];
    int status = hda_mpc_configure(&controller, p, &settings, &config);
    for (int k = 0; k < 300 && status >= 0; k++) {
        m.stamp = k * config.period;
        for (int j = 0; j < HDA_N; j++) {
            m.joint_position[j] = x[HDA_POSITION + j];
            m.motor_position[j] = HDA_MPC_FLEXIBLE == HDA_N ? x[j] : mpc_ratio[j] * x[HDA_POSITION + j];
        }
        m.tip_force[0] = k >= 50 && k < 150 ? 10.0 : 0.0;
        status = hda_mpc_tick(&controller, m.stamp, &m, path, torque);
        printf("%d", status);
        for (int j = 0; j < HDA_N; j++) {
            printf(" %.17g", torque[j]);
            u[j] = torque[j] / mpc_torque_constant[j];
        }
        printf("\n");
        hda_mpc_prepare(&controller);
        u[HDA_N] = m.tip_force[0];
        for (double t = 0.0; t < config.period - 0.5 * h; t += h) {
            hda_step_exact(x, u, c, &h, next);
            memcpy(x, next, sizeof x);
        }
    }
    if (status < 0) fprintf(stderr, "%s\n", hda_mpc_sentence(status));
    return status < 0;
}
