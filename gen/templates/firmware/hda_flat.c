/* The controller of hda_control.h with flat arguments. */
#include "hda_flat.h"
#include "hda_config.h"
#include "hda_control.h"
#include "hda_robot.h"

#include <stddef.h>
#include <string.h>

#define LAW_ROW(name, gains, reference, memory) {#name, gains, reference},
static const struct {
    const char *name;
    int gains, reference;
} laws[] = {HDA_LAW_LIST(LAW_ROW)};
static const double nominal[][HDA_GAINS_MOST] = HDA_GAINS_NOMINAL;

enum { LAWS = sizeof laws / sizeof *laws, STALE_STAMP_TICKS = HDA_ROBOT_STALE_STAMP_TICKS };

int hda_flat_joints(void) {
    return HDA_N;
}

int hda_flat_bytes(void) {
    return (int)sizeof(hda_controller);
}

int hda_flat_wrench(void) {
    return HDA_WRENCH;
}

int hda_flat_parameter_count(void) {
    return HDA_NP;
}

int hda_flat_limit_count(void) {
    return HDA_CONFIG_REAL;
}

int hda_flat_gain_count(int law) {
    return law >= 0 && law < LAWS ? laws[law].gains : -1;
}

int hda_flat_reference_count(int law) {
    return law >= 0 && law < LAWS ? laws[law].reference : -1;
}

int hda_flat_law(const char *name) {
    for (int law = 0; name && law < LAWS; law++) {
        if (!strcmp(laws[law].name, name)) return law;
    }
    return -1;
}

const char *hda_flat_law_name(int law) {
    return law >= 0 && law < LAWS ? laws[law].name : NULL;
}

void hda_flat_parameters(double *p) {
    static const double own[HDA_NP] = {HDA_ROBOT_PARAMETERS};
    memcpy(p, own, sizeof own);
}

void hda_flat_limits(double *limits) {
    static const double own[HDA_CONFIG_REAL] = HDA_ROBOT_LIMITS;
    memcpy(limits, own, sizeof own);
}

int hda_flat_gains(int law, double *gains) {
    if (!gains) return HDA_CONTROL_CALL;
    if (law < 0 || law >= LAWS) return HDA_CONTROL_LAW;
    memcpy(gains, nominal[law], (size_t)laws[law].gains * sizeof *gains);
    return 0;
}

int hda_flat_configure(void *controller, int law, const double *p, const double *gains, int safe,
                       const double *limits) {
    const int whole[HDA_CONFIG_WHOLE] = {safe, STALE_STAMP_TICKS, HDA_NEVER};
    hda_guard_config config = {0};
    if (!limits) return HDA_CONTROL_CALL;
    hda_config_from_arrays(whole, limits, &config);
    return hda_controller_configure(controller, law, p, gains, &config);
}

/* 0 where a channel is null. */
static int gather_channels(double stamp, const double *const channels[5], const double *tip_force, hda_measurement *m) {
    double *const places[5] = {m->motor_position, m->motor_velocity, m->joint_position, m->joint_velocity,
                               m->motor_torque};
    m->stamp = stamp;
    for (int i = 0; i < 5; i++) {
        if (!channels[i]) return 0;
        memcpy(places[i], channels[i], sizeof m->motor_position);
    }
    if (!tip_force) return 0;
    memcpy(m->tip_force, tip_force, sizeof m->tip_force);
    return 1;
}

int hda_flat_tick(void *controller, double now, double stamp, const double *motor_position,
                  const double *motor_velocity, const double *joint_position, const double *joint_velocity,
                  const double *motor_torque, const double *tip_force, const double *reference, double *torque) {
    const double *const channels[5] = {motor_position, motor_velocity, joint_position, joint_velocity, motor_torque};
    hda_measurement m = {0};
    const int whole = gather_channels(stamp, channels, tip_force, &m);
    return hda_controller_tick(controller, now, whole ? &m : NULL, reference, torque);
}

int hda_flat_watchdog(void *controller, double now, double *torque) {
    return hda_guard_watchdog(controller ? &((hda_controller *)controller)->guard : NULL, now, torque);
}

int hda_flat_read_fault(void *controller) {
    hda_fault fault = {0};
    if (!controller) return HDA_CONTROL_CALL;
    return hda_guard_read(&((hda_controller *)controller)->guard, &fault);
}

int hda_flat_recover(void *controller, double now, double stamp, const double *motor_position,
                     const double *motor_velocity, const double *joint_position, const double *joint_velocity,
                     const double *motor_torque, const double *tip_force) {
    const double *const channels[5] = {motor_position, motor_velocity, joint_position, joint_velocity, motor_torque};
    hda_measurement m = {0};
    const int whole = gather_channels(stamp, channels, tip_force, &m);
    return hda_controller_recover(controller, now, whole ? &m : NULL);
}

const char *hda_flat_sentence(int status) {
    return hda_controller_sentence(status);
}
