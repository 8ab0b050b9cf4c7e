/* The tick: guard, law, guard. No allocation, no lock, no unbounded loop. */
#include "hda_control.h"

#include <string.h>

#include "hda_guard_held.h"

typedef struct {
    int gains, reference, memory;
    void (*start)(const double *measured, const double *reference, const double *c, double *state);
    void (*tick)(const double *measured, const double *sent, const double *reference, const double *gains,
                 const double *c, const double *state, double *torque, double *next);
} law;

#define HDA_LAW_ROW(name, gains, reference, memory) {gains, reference, memory, hda_##name##_start, hda_##name##_tick},
static const law laws[] = {HDA_LAW_LIST(HDA_LAW_ROW)};
static const double low[][HDA_GAINS_MOST] = HDA_GAINS_LOW, high[][HDA_GAINS_MOST] = HDA_GAINS_HIGH;

enum { LAWS = sizeof laws / sizeof *laws };

HDA_APART static int set_controller(hda_controller *k, int number, const double *p, const double *gains,
                                    const hda_guard_config *config) {
    if (!k || !p || !gains || !config) return HDA_CONTROL_CALL;
    if (number < 0 || number >= LAWS) return HDA_CONTROL_LAW;
    for (int i = 0; i < HDA_NP; i++) {
        if (!hda_finite(p[i])) return HDA_CONTROL_PARAMETER;
    }
    for (int i = 0; i < laws[number].gains; i++) { /* gain 0 is the period: the guard's */
        const double gain = i ? gains[i] : config->period;
        if (!hda_finite(gain) || gain < low[number][i] || gain > high[number][i]) return HDA_CONTROL_GAIN;
    }
    const int refused = hda_guard_configure_held(&k->guard, config);
    if (refused) return refused;
    k->started = k->started && k->law == number;
    k->law = number;
    memcpy(k->gains, gains, (size_t)laws[number].gains * sizeof *gains);
    k->gains[0] = config->period;
    hda_prepare(p, k->c);
    return 0;
}

static void gather_measurement(const hda_measurement *m, double *measured) {
    memcpy(measured, m->motor_position, sizeof m->motor_position);
    memcpy(measured + HDA_N, m->joint_position, sizeof m->joint_position);
    memcpy(measured + 2 * HDA_N, m->tip_force, sizeof m->tip_force);
}

HDA_APART static int run_tick(hda_controller *k, double now, const hda_measurement *m, const double *reference,
                              double *torque) {
    double raw[HDA_N] = {0}, map[HDA_TIP * HDA_N] = {0}, measured[2 * HDA_N + HDA_WRENCH], next[HDA_MEMORY_MOST];
    if (!k || k->law < 0 || k->law >= LAWS) return hda_guard_end_held(k ? &k->guard : NULL, raw, map, torque);
    const law *chosen = &laws[k->law];
    const int opened = hda_guard_begin_held(&k->guard, now, m, reference, chosen->reference);
    if (opened >= 0) {
        gather_measurement(m, measured);
        if (!k->started) {
            chosen->start(measured, reference, k->c, k->state);
            k->started = 1;
        }
        chosen->tick(measured, k->guard.sent, reference, k->gains, k->c, k->state, raw, next);
        hda_force_map(m->joint_position, k->c, map);
    }
    const int status = hda_guard_end_held(&k->guard, raw, map, torque);
    if (opened >= 0 && status >= 0) memcpy(k->state, next, (size_t)chosen->memory * sizeof *next);
    return status;
}

int hda_controller_configure(hda_controller *k, int law, const double *p, const double *gains,
                             const hda_guard_config *config) {
    const hda_float caller = hda_float_hold();
    const int status = set_controller(k, law, p, gains, config);
    hda_float_restore(&caller);
    return status;
}

int hda_controller_tick(hda_controller *k, double now, const hda_measurement *m, const double *reference,
                        double *torque) {
    const hda_float caller = hda_float_hold();
    const int status = run_tick(k, now, m, reference, torque);
    hda_float_restore(&caller);
    return status;
}

int hda_controller_recover(hda_controller *k, double now, const hda_measurement *m) {
    if (!k) return HDA_CONTROL_CALL;
    const int status = hda_guard_recover(&k->guard, now, m);
    if (!status) k->started = 0;
    return status;
}

const char *hda_controller_sentence(int status) {
#define HDA_STATUS_CASE(name, code, sentence) \
    case code: return sentence;
    switch (status) {
        HDA_CONTROL_LIST(HDA_STATUS_CASE)
        default: return hda_status_sentence(status);
    }
#undef HDA_STATUS_CASE
}
