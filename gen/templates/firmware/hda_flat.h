/* A controller of this robot with flat arguments: numbers and arrays of numbers, no struct, so that any language calls
 * it (ctypes, MATLAB, LabVIEW, Julia, Rust). Not a safety-rated function: use it behind a certified stop.
 *
 *     memory of hda_flat_bytes() zeros, aligned as for a double, is a controller; it belongs to one thread at a time
 *     hda_flat_configure(controller, law, p, gains, safe, limits)   with what hda_flat_parameters, _gains, _limits give
 *     every period: status = hda_flat_tick(controller, now, …, torque)
 *
 * Every array has hda_flat_joints() entries unless said otherwise; units are SI. Statuses are those of hda_control.h
 * and hda_guard.h: 0 fine, positive degraded, negative refused. */
#ifndef HDA_FLAT_H
#define HDA_FLAT_H

#include "hda_limit.h" /* HDA_API */

#ifdef __cplusplus
extern "C" {
#endif

HDA_API int hda_flat_joints(void);
HDA_API int hda_flat_bytes(void);
HDA_API int hda_flat_wrench(void);

/* Lengths of the parameters p, of the limits, and of a law's gains and reference; -1 where there is no such law. */
HDA_API int hda_flat_parameter_count(void);
HDA_API int hda_flat_limit_count(void);
HDA_API int hda_flat_gain_count(int law);
HDA_API int hda_flat_reference_count(int law);

/* The number of a law by its name, -1 where there is none; the name of a law, null where there is none. */
HDA_API int hda_flat_law(const char *name);
HDA_API const char *hda_flat_law_name(int law);

/* What this robot has: parameters, limits (in the order of hda_config.h), and the default gains of a law. */
HDA_API void hda_flat_parameters(double *p);
HDA_API void hda_flat_limits(double *limits);
HDA_API int hda_flat_gains(int law, double *gains);

/* safe: 1 no torque, 2 damping, 3 hold after a fault; the last two need safe_damping and safe_stiffness in limits.
 * Returns 0, or why it is refused; then nothing changed. */
HDA_API int hda_flat_configure(void *controller, int law, const double *p, const double *gains, int safe,
                               const double *limits);

/* One tick: torques in N m at the motors are always written. tip_force has hda_flat_wrench() entries, in space the
 * moment after the force. stamp: when it was measured. */
HDA_API int hda_flat_tick(void *controller, double now, double stamp, const double *motor_position,
                          const double *motor_velocity, const double *joint_position, const double *joint_velocity,
                          const double *motor_torque, const double *tip_force, const double *reference, double *torque);

/* Writes a legal torque where a tick may be missing. */
HDA_API int hda_flat_watchdog(void *controller, double now, double *torque);

/* The first fault since the last call, 0 where there is none; the safe state stays until hda_flat_recover. */
HDA_API int hda_flat_read_fault(void *controller);

/* Leaves the safe state with a fresh measurement. */
HDA_API int hda_flat_recover(void *controller, double now, double stamp, const double *motor_position,
                             const double *motor_velocity, const double *joint_position, const double *joint_velocity,
                             const double *motor_torque, const double *tip_force);

/* The sentence of a status, never null. */
HDA_API const char *hda_flat_sentence(int status);

#ifdef __cplusplus
}
#endif

#endif
