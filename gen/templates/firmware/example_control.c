/* A position controller of this robot with the limits of its robot file (hda_robot.h). It runs against the compiled
 * model; in firmware, put your drivers in the place of read_sensors and write_torque, and a timer in that of the loop.
 *
 * Not a safety-rated function: use it behind a certified stop. */
#include "hda_config.h"
#include "hda_control.h"
#include "hda_robot.h"

#include <math.h>
#include <stdio.h>

static const double p[HDA_NP] = {HDA_ROBOT_PARAMETERS};
static const double torque_per_input[HDA_N] = {HDA_ROBOT_TORQUE_PER_INPUT};

static hda_controller controller; /* begins as zeros */

static int configure_controller(void) {
    static const double gains[][HDA_GAINS_MOST] = HDA_GAINS_NOMINAL;
    static const double limits[HDA_CONFIG_REAL] = HDA_ROBOT_LIMITS;
    /* after a fault: no torque; HDA_SAFE_DAMPING and HDA_SAFE_HOLD need safe_damping and safe_stiffness in limits */
    static const int whole[HDA_CONFIG_WHOLE] = {HDA_SAFE_ZERO, HDA_ROBOT_STALE_STAMP_TICKS, HDA_NEVER};
    hda_guard_config config = {0};
    hda_config_from_arrays(whole, limits, &config);
    return hda_controller_configure(&controller, HDA_LAW_position, p, gains[HDA_LAW_position], &config);
}

/* ---- the machine: here the model ---- */

static double x[HDA_NX], c[HDA_NC];
static hda_input_state input; /* delay, limits and lag of the motors' inputs */

static void begin_at_rest(void) {
    const double none[HDA_N] = {0};
    hda_prepare(p, c);
    hda_input_reset(&input, none, c);
}

static void read_sensors(double now, hda_measurement *m) {
    m->stamp = now;
    hda_positions(x, c, m->motor_position, m->joint_position);
}

static void write_torque(const double *torque) {
    const double h = HDA_STEP;
    double command[HDA_N], at_end[HDA_N], u[HDA_NU] = {0};
    for (int j = 0; j < HDA_N; j++) command[j] = torque[j] / torque_per_input[j];
    hda_input_step(&input, command, c, HDA_ROBOT_PERIOD, u, at_end);
    for (double left = HDA_ROBOT_PERIOD; left > 0.5 * h; left -= h) hda_step_exact(x, u, c, &h, x);
}

/* ---- the motion: each joint by a tenth of a radian (a centimetre where it slides), from rest to rest in a second ----
 */

static void plan_motion(double now, double *reference) {
    static const double way[HDA_N] = {HDA_ROBOT_EXAMPLE_WAY};
    const double s = now < 1.0 ? now : 1.0;
    for (int j = 0; j < HDA_N; j++) {
        reference[j] = way[j] * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        reference[HDA_N + j] = way[j] * 30.0 * s * s * (1.0 - s) * (1.0 - s);
        reference[2 * HDA_N + j] = way[j] * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s);
    }
}

int main(void) {
    hda_measurement measured = {0};
    double reference[3 * HDA_N], torque[HDA_N], largest = 0.0;
    const long ticks = lround(1.2 / HDA_ROBOT_PERIOD);
    begin_at_rest();
    int status = configure_controller();
    for (long k = 0; k < ticks && status >= 0; k++) {
        const double now = (double)k * HDA_ROBOT_PERIOD;
        read_sensors(now, &measured);
        plan_motion(now, reference);
        status = hda_controller_tick(&controller, now, &measured, reference, torque);
        write_torque(torque);
        for (int j = 0; j < HDA_N; j++) largest = fmax(largest, fabs(measured.joint_position[j] - reference[j]));
    }
    printf("%s: %s largest error %.6f\n", HDA_ROBOT_NAME, hda_controller_sentence(status), largest);
    return status < 0;
}
