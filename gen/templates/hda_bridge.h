/* What Python calls of the controller and the input stage, over plain arrays: structs are filled and read here, so that
 * no layout is known outside C. */
#include "hda_config.h"
#include "hda_control.h"
#include "hda_input.h"
#include "hda_loops.h"

enum {
    HDA_MEASURED = sizeof(hda_measurement) / sizeof(double),
    HDA_FAULT_REAL = 1 + 2 * HDA_N + (int)HDA_MEASURED + HDA_REFERENCE_MAX /* now, raw, sent, measurement, reference */
};

static void bridge_configure(void *const *a) {
    hda_guard_config config = {0};
    hda_config_from_arrays(a[4], a[5], &config);
    *(int *)a[6] = hda_controller_configure(a[0], *(int *)a[1], a[2], a[3], &config);
}

static void bridge_tick(void *const *a) {
    *(int *)a[5] = hda_controller_tick(a[0], *(double *)a[1], (const hda_measurement *)a[2], a[3], a[4]);
}

static void bridge_watchdog(void *const *a) {
    *(int *)a[3] = hda_guard_watchdog(&((hda_controller *)a[0])->guard, *(double *)a[1], a[2]);
}

static void bridge_recover(void *const *a) {
    *(int *)a[3] = hda_controller_recover(a[0], *(double *)a[1], (const hda_measurement *)a[2]);
}

static void bridge_fault(hda_guard *guard, int *whole, double *real) {
    hda_fault fault = {0};
    whole[0] = hda_guard_read(guard, &fault);
    whole[1] = fault.index;
    whole[2] = fault.further;
    whole[3] = fault.reference_count;
    real[0] = fault.now;
    memcpy(real + 1, fault.raw, sizeof fault.raw);
    memcpy(real + 1 + HDA_N, fault.sent, sizeof fault.sent);
    memcpy(real + 1 + 2 * HDA_N, &fault.measurement, sizeof fault.measurement);
    memcpy(real + 1 + 2 * HDA_N + HDA_MEASURED, fault.reference, sizeof fault.reference);
}

static void bridge_read(void *const *a) {
    bridge_fault(&((hda_controller *)a[0])->guard, a[1], a[2]);
}

static void bridge_input_reset(void *const *a) {
    hda_input_reset(a[0], a[1], a[2]);
}

static void bridge_input_step(void *const *a) {
    hda_input_step(a[0], a[1], a[2], *(double *)a[3], a[4], a[5]);
}

static void bridge_loops_begin(void *const *a) {
    *(int *)a[6] = hda_loops_begin(a[0], *(int *)a[1], a[2], a[3], a[4], a[5]);
}

static void bridge_loops_tick(void *const *a) {
    hda_loops_tick(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]);
}

/* clang-format off */
#define HDA_BRIDGE_ENTRIES \
    {"loops_begin", 7, bridge_loops_begin, {{"loops", 'B', sizeof(hda_loops), 1}, {"law", 'i', 1, 0}, \
        {"x0", 'd', HDA_NX, 0}, {"gains", 'd', HDA_LOOPS_WIDEST * HDA_GAINS_MOST, 0}, \
        {"settings", 'd', HDA_LOOPS_SETTINGS, 0}, {"c", 'd', HDA_NC, 0}, {"status", 'i', 1, 1}}}, \
    {"loops_tick", 9, bridge_loops_tick, {{"loops", 'B', sizeof(hda_loops), 1}, \
        {"reference", 'd', HDA_REFERENCE_MOST, 0}, {"push", 'd', HDA_WRENCH, 0}, {"felt", 'd', HDA_WRENCH, 0}, \
        {"noise", 'd', 2 * HDA_N, 0}, {"c", 'd', HDA_NC, 0}, {"known", 'd', HDA_NC, 0}, \
        {"tip", 'd', HDA_LOOPS_WIDEST * HDA_TIP, 1}, {"sent", 'd', HDA_LOOPS_WIDEST * HDA_N, 1}}}, \
    {"input_reset", 3, bridge_input_reset, {{"state", 'B', sizeof(hda_input_state), 1}, {"before", 'd', HDA_N, 0}, \
        {"c", 'd', HDA_NC, 0}}}, \
    {"input_step", 6, bridge_input_step, {{"state", 'B', sizeof(hda_input_state), 1}, {"command", 'd', HDA_N, 0}, \
        {"c", 'd', HDA_NC, 0}, {"h", 'd', 1, 0}, {"mean", 'd', HDA_N, 1}, {"at_end", 'd', HDA_N, 1}}}, \
    {"controller_configure", 7, bridge_configure, {{"controller", 'B', sizeof(hda_controller), 1}, \
        {"law", 'i', 1, 0}, {"p", 'd', HDA_NP, 0}, {"gains", 'd', HDA_GAINS_MOST, 0}, \
        {"whole", 'i', HDA_CONFIG_WHOLE, 0}, {"real", 'd', HDA_CONFIG_REAL, 0}, {"status", 'i', 1, 1}}}, \
    {"controller_tick", 6, bridge_tick, {{"controller", 'B', sizeof(hda_controller), 1}, {"now", 'd', 1, 0}, \
        {"measurement", 'd', HDA_MEASURED, 0}, {"reference", 'd', HDA_REFERENCE_MOST, 0}, \
        {"torque", 'd', HDA_N, 1}, {"status", 'i', 1, 1}}}, \
    {"controller_watchdog", 4, bridge_watchdog, {{"controller", 'B', sizeof(hda_controller), 1}, \
        {"now", 'd', 1, 0}, {"torque", 'd', HDA_N, 1}, {"status", 'i', 1, 1}}}, \
    {"controller_recover", 4, bridge_recover, {{"controller", 'B', sizeof(hda_controller), 1}, {"now", 'd', 1, 0}, \
        {"measurement", 'd', HDA_MEASURED, 0}, {"status", 'i', 1, 1}}}, \
    {"controller_read", 3, bridge_read, {{"controller", 'B', sizeof(hda_controller), 1}, {"whole", 'i', 4, 1}, \
        {"real", 'd', HDA_FAULT_REAL, 1}}},
/* clang-format on */
