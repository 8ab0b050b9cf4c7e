/* A guard's configuration from plain arrays, for callers that know no layout of structs. */
#ifndef HDA_CONFIG_H
#define HDA_CONFIG_H

#include "hda_guard.h"

#include <string.h>

enum {
    HDA_CONFIG_WHOLE = 3, /* safe, stale_stamp_ticks, stale_bits_ticks */
    /* period, _min, _max, watchdog, force_limit; torque_limit, torque_rate, motor_jump, joint_jump, safe_damping and
     * safe_stiffness of each joint */
    HDA_CONFIG_REAL = 5 + 6 * HDA_N
};

static inline void hda_config_from_arrays(const int *whole, const double *real, hda_guard_config *config) {
    double *const joints[] = {config->torque_limit, config->torque_rate,  config->motor_jump,
                              config->joint_jump,   config->safe_damping, config->safe_stiffness};
    config->version = HDA_GUARD_VERSION;
    config->size = sizeof *config;
    config->joints = HDA_N;
    config->safe = whole[0];
    config->stale_stamp_ticks = whole[1];
    config->stale_bits_ticks = whole[2];
    config->period = real[0];
    config->period_min = real[1];
    config->period_max = real[2];
    config->watchdog = real[3];
    config->force_limit = real[4];
    for (int i = 0; i < 6; i++) memcpy(joints[i], real + 5 + i * HDA_N, sizeof config->torque_limit);
}

#endif
