/* Ticks of the predictive controller on prescribed measurements, so that nothing feeds back but its own plan: each tick's status, torques, and the
 * dynamics that were linearised, as text. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hda_mpc.h"
#include "mpc_settings.h"

static hda_mpc k;

int main(void) {
    static const double p[HDA_NP] = HDA_NOMINAL;
    hda_mpc_settings settings;
    hda_guard_config c = {0};
    hda_measurement m = {0};
    double *const joints[] = {c.torque_limit, c.torque_rate, c.motor_jump, c.joint_jump, c.safe_damping, c.safe_stiffness};
    double path[HDA_MPC_PATH], torque[HDA_N], points[2 * (HDA_N + 1)];
    c.version = HDA_GUARD_VERSION, c.size = sizeof c, c.joints = HDA_N;
    c.safe = (int32_t)mpc_guard_whole[0], c.stale_stamp_ticks = (int32_t)mpc_guard_whole[1], c.stale_bits_ticks = (int32_t)mpc_guard_whole[2];
    memcpy(&c.period, mpc_guard_real, 5 * sizeof(double));
    for (int i = 0; i < 6; i++) memcpy(joints[i], mpc_guard_real + 5 + i * HDA_N, HDA_N * sizeof(double));
    memcpy(&settings, mpc_settings, sizeof settings);
    if (hda_mpc_configure(&k, p, &settings, &c)) return 1;
    for (int tick = 0; tick < 200; tick++) {
        m.stamp = tick * c.period;
        for (int j = 0; j < HDA_N; j++) {
            m.joint_position[j] = 0.6 - 1.8 * j + 0.01 * sin(0.02 * tick + j);
            m.motor_position[j] = mpc_ratio[j] * (m.joint_position[j] + 2e-5 * sin(0.05 * tick));
        }
        hda_points(m.joint_position, k.c, points);
        for (int e = 0; e < HDA_MPC_PATH; e++) path[e] = e % 4 < 2 ? points[2 * HDA_N + e % 4] : 0.0;
        m.tip_force[0] = 0.5 * sin(0.1 * tick);
        printf("%d", hda_mpc_tick(&k, m.stamp, &m, path, torque));
        for (int j = 0; j < HDA_N; j++) printf(" %.17g", torque[j]);
        for (int node = 0; node < HDA_MPC_N; node++) {
            double sum = 0.0;
            for (int e = 0; e < HDA_MPC_NX * HDA_MPC_NX; e++) sum += (e + 1) * k.qp.A[node * HDA_MPC_NX * HDA_MPC_NX + e];
            printf(" %.17g", sum);
        }
        printf("\n");
        hda_mpc_prepare(&k);
    }
    return 0;
}
