/* The guard as it is called: every function in the floating-point environment of hda_float.h, whatever the caller's is.
 */
#include "hda_guard_held.h"

int hda_guard_configure(hda_guard *g, const hda_guard_config *config) {
    const hda_float caller = hda_float_hold();
    const int status = hda_guard_configure_held(g, config);
    hda_float_restore(&caller);
    return status;
}

int hda_guard_safe_ticks(const hda_guard_config *config) {
    const hda_float caller = hda_float_hold();
    const int ticks = hda_guard_safe_ticks_held(config);
    hda_float_restore(&caller);
    return ticks;
}

int hda_guard_begin(hda_guard *g, double now, const hda_measurement *m, const double *reference, int count) {
    const hda_float caller = hda_float_hold();
    const int status = hda_guard_begin_held(g, now, m, reference, count);
    hda_float_restore(&caller);
    return status;
}

int hda_guard_end(hda_guard *g, const double *raw, const double *force_map, double *torque) {
    const hda_float caller = hda_float_hold();
    const int status = hda_guard_end_held(g, raw, force_map, torque);
    hda_float_restore(&caller);
    return status;
}

int hda_guard_watchdog(hda_guard *g, double now, double *torque) {
    const hda_float caller = hda_float_hold();
    const int status = hda_guard_watchdog_held(g, now, torque);
    hda_float_restore(&caller);
    return status;
}

int hda_guard_recover(hda_guard *g, double now, const hda_measurement *m) {
    const hda_float caller = hda_float_hold();
    const int status = hda_guard_recover_held(g, now, m);
    hda_float_restore(&caller);
    return status;
}
