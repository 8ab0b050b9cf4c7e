/* What a guard may be configured to, in how many ticks it is then safe, and the sentences of its statuses. */
#include "hda_guard_held.h"

#include <string.h>

static int legal_limit(double x) {
    return hda_finite(x) && x >= HDA_SMALLEST_LIMIT && x <= HDA_UNLIMITED;
}

static int legal_limits(const double *x) {
    for (int j = 0; j < HDA_N; j++)
        if (!legal_limit(x[j])) return 0;
    return 1;
}

int hda_guard_safe_ticks_held(const hda_guard_config *c) {
    double worst = 0.0;
    if (c == NULL) return HDA_CONFIG_CALL;
    if (c->version != HDA_GUARD_VERSION) return HDA_CONFIG_VERSION;
    if (c->size != sizeof(hda_guard_config) || c->joints != HDA_N) return HDA_CONFIG_SIZE;
    if (c->safe < HDA_SAFE_ZERO || c->safe > HDA_SAFE_HOLD) return HDA_CONFIG_SAFE;
    if (!legal_limit(c->period_min) || !legal_limit(c->period) || !legal_limit(c->period_max) ||
        c->period_min > c->period || c->period > c->period_max)
        return HDA_CONFIG_PERIOD;
    if (!legal_limit(c->watchdog) || c->watchdog < c->period_max) return HDA_CONFIG_WATCHDOG;
    if (c->stale_stamp_ticks < 1 || c->stale_bits_ticks < 1) return HDA_CONFIG_STALE;
    if (!legal_limit(c->force_limit)) return HDA_CONFIG_FORCE_LIMIT;
    if (!legal_limits(c->torque_limit)) return HDA_CONFIG_TORQUE_LIMIT;
    if (!legal_limits(c->torque_rate)) return HDA_CONFIG_TORQUE_RATE;
    if (!legal_limits(c->motor_jump) || !legal_limits(c->joint_jump)) return HDA_CONFIG_JUMP;
    if (c->safe >= HDA_SAFE_DAMPING && !legal_limits(c->safe_damping)) return HDA_CONFIG_DAMPING;
    if (c->safe >= HDA_SAFE_HOLD && !legal_limits(c->safe_stiffness)) return HDA_CONFIG_STIFFNESS;

    for (int j = 0; j < HDA_N; j++) {
        const double ticks = c->torque_limit[j] / (c->torque_rate[j] * c->period_min);
        if (ticks > worst) worst = ticks;
    }
    /* Zero stands still and is at most the limit away. The other laws move at half the rate and start at most twice the
     * limit away, so that the gap closes by half a step a tick. One tick rounds up, one is for the steps' rounding. */
    if (c->safe != HDA_SAFE_ZERO) worst *= 4.0;
    return worst <= HDA_SAFE_TICKS_MAX - 2 ? (int)worst + 2 : HDA_CONFIG_SLOW;
}

double hda_guard_force(const double *force_map, const double *torque) {
    double total = 0.0;
    for (int k = 0; k < HDA_TIP; k++) {
        double along = 0.0;
        for (int j = 0; j < HDA_N; j++) along += force_map[k * HDA_N + j] * torque[j];
        total = k ? hda_length(total, along) : along;
    }
    return total;
}

int hda_guard_configure_held(hda_guard *g, const hda_guard_config *config) {
    const int ticks = hda_guard_safe_ticks_held(config);
    if (g == NULL) return HDA_CONFIG_CALL;
    if (ticks < 0) return ticks;
    if (g->version != 0 || g->size != 0) {
        if (g->version != HDA_GUARD_VERSION || g->size != sizeof(hda_guard)) return HDA_CONFIG_CONTEXT;
        if (g->latched || g->open) return HDA_CONFIG_BUSY;
        for (int j = 0; j < HDA_N; j++)
            if (hda_magnitude(g->sent[j]) > config->torque_limit[j]) return HDA_CONFIG_SENT;
        if (config->force_limit < HDA_UNLIMITED && hda_guard_force(g->force_map, g->sent) > config->force_limit)
            return HDA_CONFIG_SENT;
    } else {
        memset(g, 0, sizeof *g);
        g->version = HDA_GUARD_VERSION;
        g->size = sizeof *g;
        g->trust = HDA_SAFE_HOLD;
    }
    g->config = *config;
    g->safe_bound = ticks;
    return HDA_FINE;
}

const char *hda_status_sentence(int status) {
    switch (status) {
#define SENTENCE(name, code, sentence) \
    case code: return sentence;
        HDA_STATUS_LIST(SENTENCE)
#undef SENTENCE
        default: return "This number is not a status of the guard; compare the header with the library.";
    }
}
