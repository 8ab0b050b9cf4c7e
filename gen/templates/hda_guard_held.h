/* The guard's functions without the environment of hda_float.h around them, for those that hold it already. */
#ifndef HDA_GUARD_HELD_H
#define HDA_GUARD_HELD_H

#include "hda_float.h"
#include "hda_guard.h"

HDA_APART int hda_guard_configure_held(hda_guard *g, const hda_guard_config *config);
HDA_APART int hda_guard_safe_ticks_held(const hda_guard_config *config);
HDA_APART int hda_guard_begin_held(hda_guard *g, double now, const hda_measurement *m, const double *reference,
                                   int count);
HDA_APART int hda_guard_end_held(hda_guard *g, const double *raw, const double *force_map, double *torque);
HDA_APART int hda_guard_watchdog_held(hda_guard *g, double now, double *torque);
HDA_APART int hda_guard_recover_held(hda_guard *g, double now, const hda_measurement *m);

#endif
