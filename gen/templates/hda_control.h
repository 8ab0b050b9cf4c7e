/* A controller and its guard in one context: whatever comes in, a legal torque goes out. See docs/project/safety.md.
 *
 *     static hda_controller k;                        // zeros
 *     hda_controller_configure(&k, HDA_LAW_impedance_cartesian, p, gains, &config);
 *     every period: status = hda_controller_tick(&k, now, &measurement, reference, torque);
 *
 * Not a safety-rated function: use it behind a certified stop. */
#ifndef HDA_CONTROL_H
#define HDA_CONTROL_H

#include "hda.h"
#include "hda_laws.h" /* HDA_LAW_LIST, the largest numbers of gains, references and memory */

/* name, code, sentence; the guard's own statuses come through unchanged */
/* clang-format off */
#define HDA_CONTROL_LIST(HDA_STATUS) \
  HDA_STATUS(HDA_CONTROL_CALL, -300, "A pointer is null; nothing was changed.") \
  HDA_STATUS(HDA_CONTROL_LAW, -301, "There is no law of that number; see hda_laws.h. Nothing was changed.") \
  HDA_STATUS(HDA_CONTROL_GAIN, -302, \
  "A gain is not finite or out of its bounds; the manifest has them. Nothing was changed.") \
  HDA_STATUS(HDA_CONTROL_PARAMETER, -303, "A parameter of the model is not finite; nothing was changed.")
/* clang-format on */

#define HDA_STATUS_NAME(name, code, sentence) name = (code),
enum hda_control_status { HDA_CONTROL_LIST(HDA_STATUS_NAME) HDA_CONTROL_END = 1001 };
#undef HDA_STATUS_NAME

typedef struct hda_controller {
    hda_guard guard;
    int32_t law;
    int32_t started; /* the memory belongs to the present run of ticks */
    double gains[HDA_GAINS_MOST];
    double state[HDA_MEMORY_MOST];
    double c[HDA_NC];
} hda_controller;

#ifdef __cplusplus
extern "C" {
#endif

/* Sets or replaces law, parameters, gains (the gain `period` is config's, within that gain's bounds) and the guard's
 * configuration: all, or none and a negative status. A change of law restarts the memory, a change of gains keeps it.
 */
HDA_API int hda_controller_configure(hda_controller *k, int law, const double *p, const double *gains,
                                     const hda_guard_config *config);

/* One tick: HDA_N torques in N m at the motors are always written. Status as in hda_guard.h. */
HDA_API int hda_controller_tick(hda_controller *k, double now, const hda_measurement *m, const double *reference,
                                double *torque);

/* Leaves the safe state with a fresh measurement; the law starts anew from it. Returns 0, or says why not. */
HDA_API int hda_controller_recover(hda_controller *k, double now, const hda_measurement *m);

/* The sentence of a status, the guard's too; never null. */
HDA_API const char *hda_controller_sentence(int status);

#ifdef __cplusplus
}
#endif

#endif
