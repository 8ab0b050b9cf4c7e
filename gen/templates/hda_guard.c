/* The guard around every control tick; hda_guard.h says what it promises, docs/project/safety.md why.
 *
 * The checks of a tick stand in one order and the first that fails names the fault: version and latch, time, finite
 * inputs, jump and stale; the controller; finite result, force, torque, rate against the torque sent last, the last
 * assertion. One fault turns the whole vector to the safe state, never one joint. */
#include "hda_guard_held.h"

#include <string.h>

#define MEASURED ((int)(sizeof(hda_measurement) / sizeof(double)))

typedef char
    measurement_has_no_padding[sizeof(hda_measurement) == (1 + 5 * HDA_N + HDA_WRENCH) * sizeof(double) ? 1 : -1];

typedef struct finding {
    int code;
    int32_t index;
} finding;

static const finding NOTHING = {HDA_FINE, 0};

static int check_context(const hda_guard *g) {
    if (g == NULL) return HDA_FAULT_CONTEXT;
    if (g->version == 0 && g->size == 0) return HDA_FAULT_UNCONFIGURED;
    return g->version == HDA_GUARD_VERSION && g->size == sizeof(hda_guard) ? HDA_FINE : HDA_FAULT_CONTEXT;
}

static int force_limited(const hda_guard *g) {
    return g->config.force_limit < HDA_UNLIMITED;
}

/* ---- faults ---- */

/* The first fault since the last read, or that it was read. */
static int refusal_code(const hda_guard *g) {
    return g->fault.code != HDA_FINE ? g->fault.code : HDA_LATCHED;
}

static void latch_fault(hda_guard *g, finding found, const hda_measurement *m, const double *raw) {
    hda_fault *f = &g->fault;
    if (!g->latched) {
        g->latched = 1;
        g->safe_ticks = 0;
        memcpy(g->hold, g->measured.motor_position, sizeof g->hold);
        if (!g->known && g->trust > HDA_SAFE_DAMPING) g->trust = HDA_SAFE_DAMPING; /* nothing to hold on to */
    }
    if (f->code != HDA_FINE) {
        if (f->further < INT32_MAX) f->further++;
        return;
    }
    memset(f, 0, sizeof *f);
    f->code = found.code;
    f->index = found.index;
    f->now = g->now;
    f->measurement = m != NULL ? *m : g->measured;
    f->reference_count = g->reference_count;
    memcpy(f->reference, g->reference, (size_t)g->reference_count * sizeof(double));
    if (raw != NULL) memcpy(f->raw, raw, sizeof f->raw);
    memcpy(f->sent, g->sent, sizeof f->sent);
}

static void latch_code(hda_guard *g, int code) {
    const finding found = {code, 0};
    latch_fault(g, found, NULL, NULL);
}

int hda_guard_read(hda_guard *g, hda_fault *fault) {
    const int bad = check_context(g);
    if (bad != HDA_FINE) return bad;
    const int code = g->fault.code;
    if (fault != NULL) {
        *fault = g->fault;
        memset(&g->fault, 0, sizeof g->fault);
    }
    return code;
}

/* ---- what comes in ---- */

static int check_time(const hda_guard *g, double now, double stamp) {
    const double elapsed = now - g->tick_time;
    if (!hda_finite(now) || !hda_finite(stamp)) return HDA_FAULT_TIME_FINITE;
    if (g->started && elapsed <= 0.0) return HDA_FAULT_TIME_BACKWARD;
    if (g->started && elapsed < g->config.period_min) return HDA_FAULT_PERIOD_SHORT;
    if (g->started && elapsed > g->config.period_max) return HDA_FAULT_PERIOD_LONG;
    if (g->known && stamp < g->measured.stamp) return HDA_FAULT_STAMP_BACKWARD;
    return HDA_FINE;
}

static finding check_jump(const hda_guard *g, const hda_measurement *m) {
    for (int j = 0; j < HDA_N; j++) {
        const double motor = hda_magnitude(m->motor_position[j] - g->measured.motor_position[j]);
        const double joint = hda_magnitude(m->joint_position[j] - g->measured.joint_position[j]);
        const finding motor_jump = {HDA_FAULT_MOTOR_JUMP, j + 1}, joint_jump = {HDA_FAULT_JOINT_JUMP, j + 1};
        if (motor > g->config.motor_jump[j]) return motor_jump;
        if (joint > g->config.joint_jump[j]) return joint_jump;
    }
    return NOTHING;
}

static int check_stale(hda_guard *g, const hda_measurement *m) {
    const size_t rest = sizeof(double); /* the bits after the stamp */
    const int same_stamp = m->stamp == g->measured.stamp;
    const int same_bits = memcmp((const char *)m + rest, (const char *)&g->measured + rest, sizeof *m - rest) == 0;
    g->repeated_stamps = same_stamp ? g->repeated_stamps + (g->repeated_stamps < HDA_NEVER - 1) : 0;
    g->repeated_bits = same_bits ? g->repeated_bits + (g->repeated_bits < HDA_NEVER - 1) : 0;
    if (g->repeated_stamps >= g->config.stale_stamp_ticks) return HDA_FAULT_STALE_STAMP;
    return g->repeated_bits >= g->config.stale_bits_ticks ? HDA_FAULT_STALE_BITS : HDA_FINE;
}

/* Every check runs in every tick, as each also says what the safe law may stand on; the first that fails counts. */
static finding observe_inputs(hda_guard *g, double now, const hda_measurement *m, const double *reference, int count) {
    double measured[MEASURED];
    finding found = {check_time(g, now, m->stamp), 0};
    memcpy(measured, m, sizeof measured);
    int32_t wrong = hda_not_finite(measured, MEASURED);
    if (g->known && m->stamp < g->measured.stamp) g->trust = HDA_SAFE_ZERO;
    if (hda_not_finite(m->motor_velocity, HDA_N) == 0) {
        g->level = HDA_SAFE_DAMPING;
        memcpy(g->velocity, m->motor_velocity, sizeof g->velocity);
    }
    if (wrong == 0) {
        const finding jump = g->known ? check_jump(g, m) : NOTHING;
        const finding stale = {g->known ? check_stale(g, m) : HDA_FINE, 0};
        if (jump.code != HDA_FINE && g->trust > HDA_SAFE_DAMPING) g->trust = HDA_SAFE_DAMPING;
        if (stale.code != HDA_FINE) g->trust = HDA_SAFE_ZERO;
        g->level = HDA_SAFE_HOLD;
        g->measured = *m;
        g->known = 1;
        wrong = hda_not_finite(reference, count);
        if (wrong != 0) wrong += MEASURED;
        if (found.code == HDA_FINE && wrong == 0) found = jump.code != HDA_FINE ? jump : stale;
    }
    if (found.code == HDA_FINE && wrong != 0) {
        found.code = HDA_FAULT_INPUT_FINITE;
        found.index = wrong;
    }
    return found;
}

/* What a tick counts for in the rate limit: the time since the last torque, no less than period_min (a clock that
 * claims less, or nothing, must not keep the torque from falling), no more than period (no larger step when late). */
static double counted_time(const hda_guard *g, double now) {
    const double since = now - g->sent_time;
    if (!g->started || !(since > g->config.period_min)) return g->config.period_min;
    return since < g->config.period ? since : g->config.period;
}

int hda_guard_begin_held(hda_guard *g, double now, const hda_measurement *m, const double *reference, int count) {
    const int bad = check_context(g);
    if (bad != HDA_FINE) return bad;
    const int callable = m != NULL && count >= 0 && count <= HDA_REFERENCE_MAX && (reference != NULL || count == 0);
    const int nested = g->open;
    finding found = {!callable ? HDA_FAULT_CALL : HDA_FAULT_SEQUENCE, 0};
    g->open = 1;
    g->now = now;
    g->level = HDA_SAFE_ZERO;
    g->elapsed = counted_time(g, now);
    g->reference_count = callable ? count : 0;
    if (callable) {
        if (count > 0) memcpy(g->reference, reference, (size_t)count * sizeof(double));
        const finding seen = observe_inputs(g, now, m, reference, count);
        if (!nested) found = seen;
    }
    if (hda_finite(now)) {
        g->tick_time = now;
        g->started = 1;
    }
    if (found.code != HDA_FINE) latch_fault(g, found, m, NULL);
    if (g->latched) return refusal_code(g);
    return g->repeated_stamps > 0 ? HDA_MEASUREMENT_REPEATED : HDA_FINE;
}

/* ---- what goes out ---- */

/* One step from the torque sent last straight towards target: where both ends keep the force limit, so does the way. */
static void approach_target(const hda_guard *g, const double *target, const double *step, double *out) {
    double steps = 0.0;
    for (int j = 0; j < HDA_N; j++) {
        const double gap = hda_magnitude(target[j] - g->sent[j]);
        if (gap > 0.0 && gap / step[j] > steps) steps = gap / step[j];
    }
    for (int j = 0; j < HDA_N; j++) {
        const double wanted = steps > 1.0 ? g->sent[j] + (target[j] - g->sent[j]) / steps : target[j];
        out[j] = hda_limit(wanted, g->sent[j], g->config.torque_limit[j], step[j]);
    }
}

/* Slides out towards one step to zero, as far as the force limit asks: both are legal, and so is the line between. */
static int keep_force(const hda_guard *g, const double *step, double *out) {
    static const double zero[HDA_N];
    double low[HDA_N];
    const double limit = g->config.force_limit;
    if (!force_limited(g) || !g->map_known) return HDA_FINE;
    const double force = hda_guard_force(g->force_map, out);
    if (force <= limit) return HDA_FINE;
    approach_target(g, zero, step, low);
    const double least = hda_guard_force(g->force_map, low);
    const double share = least <= limit ? (limit - least) / (force - least) : 0.0;
    for (int j = 0; j < HDA_N; j++) {
        const double wanted = low[j] + share * (out[j] - low[j]);
        out[j] = hda_limit(wanted, g->sent[j], g->config.torque_limit[j], step[j]);
    }
    return least <= limit ? HDA_FORCE_LIMITED : HDA_FAULT_FORCE;
}

/* What the force limit leaves of a torque, as a share of the whole vector. */
static double force_share(const hda_guard *g, const double *torque) {
    const double force = force_limited(g) ? hda_guard_force(g->force_map, torque) : 0.0;
    return force > g->config.force_limit ? g->config.force_limit / force : 1.0;
}

/* Force, torque, rate: the controller's torque made legal. Cutting single joints could raise the force again, so with
 * a force limit the torque limit scales the whole vector too, and the rate limit goes straight towards it. */
static int limit_result(const hda_guard *g, const double *raw, const double *step, double *out) {
    const hda_guard_config *c = &g->config;
    const double share = force_share(g, raw);
    double wanted[HDA_N], over = 1.0;
    for (int j = 0; j < HDA_N; j++) {
        wanted[j] = share * raw[j];
        const double size = hda_magnitude(wanted[j]) / c->torque_limit[j];
        if (size > over) over = size;
        out[j] = hda_limit(wanted[j], g->sent[j], c->torque_limit[j], step[j]);
    }
    if (force_limited(g)) {
        for (int j = 0; j < HDA_N; j++) wanted[j] /= over;
        approach_target(g, wanted, step, out);
    }
    int status = share < 1.0 ? HDA_FORCE_LIMITED : over > 1.0 ? HDA_TORQUE_LIMITED : HDA_FINE;
    for (int j = 0; j < HDA_N; j++)
        if (out[j] != wanted[j] && status == HDA_FINE) status = HDA_RATE_LIMITED;
    const int kept = keep_force(g, step, out);
    return kept != HDA_FINE ? kept : status;
}

/* One step of the safe ramp. The law's torque moves at half the rate, so that the torque sent catches it in a stated
 * number of ticks whatever the measurements do, and from then on keeps nothing of what the controller sent. */
static void safe_torque(hda_guard *g, int level, const double *step, double *out) {
    const hda_guard_config *c = &g->config;
    double law[HDA_N] = {0.0};
    if (level > g->trust) level = g->trust;
    if (level > c->safe) level = c->safe;
    if (force_limited(g) && !g->map_known) level = HDA_SAFE_ZERO;
    for (int j = 0; j < HDA_N; j++) {
        if (level >= HDA_SAFE_DAMPING) law[j] = -c->safe_damping[j] * g->velocity[j];
        if (level >= HDA_SAFE_HOLD) law[j] += c->safe_stiffness[j] * (g->hold[j] - g->measured.motor_position[j]);
    }
    if (hda_not_finite(law, HDA_N) != 0) memset(law, 0, sizeof law);
    const double share = force_share(g, law);
    for (int j = 0; j < HDA_N; j++) {
        const double limit = c->torque_limit[j];
        const int first = g->safe_ticks == 0; /* the law alone sets where its torque starts */
        g->target[j] = hda_limit(share * law[j], first ? 0.0 : g->target[j], limit, first ? limit : 0.5 * step[j]);
    }
    approach_target(g, g->target, step, out);
    (void)keep_force(g, step, out); /* already refused: out is as near to the force limit as the rate allows */
    if (g->elapsed >= c->period_min && g->safe_ticks < INT32_MAX) g->safe_ticks++;
}

/* The last assertion, and out. It fails only where the context was overwritten: no limit is known, so zero is sent. */
static int send_torque(hda_guard *g, const double *step, const double *out, double time, int status, double *torque) {
    int legal = 1;
    for (int j = 0; j < HDA_N; j++) {
        const double limit = g->config.torque_limit[j], last = g->sent[j];
        legal = legal && limit <= HDA_UNLIMITED && hda_finite(out[j]) && hda_magnitude(out[j]) <= limit;
        legal = legal && out[j] <= last + step[j] && out[j] >= last - step[j];
    }
    if (!legal) latch_code(g, HDA_FAULT_ASSERTION);
    for (int j = 0; j < HDA_N; j++) torque[j] = g->sent[j] = legal ? out[j] : 0.0;
    g->sent_time = time;
    g->elapsed = 0.0; /* spent: a second torque before the next tick is the same torque */
    return g->latched ? refusal_code(g) : status;
}

static void rate_steps(const hda_guard *g, double *step) {
    for (int j = 0; j < HDA_N; j++) step[j] = g->config.torque_rate[j] * g->elapsed;
}

/* No context to stand on: zero, the only torque that is legal under every limit on its size. */
static int send_zero(int code, double *torque) {
    for (int j = 0; torque != NULL && j < HDA_N; j++) torque[j] = 0.0;
    return code;
}

/* Finite on the result: the torque, the map, and the force they make. A legal map is kept for the safe ramp. */
static finding check_result(hda_guard *g, const double *raw, const double *force_map) {
    const int limited = force_limited(g);
    const int mapped = limited && force_map != NULL && hda_not_finite(force_map, HDA_TIP * HDA_N) == 0;
    finding found = NOTHING;
    if (mapped) {
        memcpy(g->force_map, force_map, sizeof g->force_map);
        g->map_known = 1;
    }
    if (g->latched) return NOTHING;
    if (raw == NULL || (limited && force_map == NULL)) {
        found.code = HDA_FAULT_CALL;
        return found;
    }
    found.index = hda_not_finite(raw, HDA_N);
    if (found.index != 0 || (limited && (!mapped || !hda_finite(hda_guard_force(force_map, raw)))))
        found.code = HDA_FAULT_RESULT_FINITE;
    return found;
}

int hda_guard_end_held(hda_guard *g, const double *raw, const double *force_map, double *torque) {
    const int bad = check_context(g);
    double step[HDA_N], out[HDA_N];
    int status = HDA_FINE;
    if (bad != HDA_FINE) return send_zero(bad, torque);
    if (!g->open) latch_code(g, HDA_FAULT_SEQUENCE);
    g->open = 0;
    if (torque == NULL) {
        latch_code(g, HDA_FAULT_CALL);
        return refusal_code(g);
    }
    rate_steps(g, step);
    const finding result = check_result(g, raw, force_map);
    if (result.code != HDA_FINE) latch_fault(g, result, NULL, raw);
    if (!g->latched) {
        const finding limits = {limit_result(g, raw, step, out), 0};
        status = limits.code;
        if (status < 0) latch_fault(g, limits, NULL, raw);
    }
    if (g->latched) safe_torque(g, g->level, step, out);
    if (g->repeated_stamps > 0 && status >= 0) status = HDA_MEASUREMENT_REPEATED;
    return send_torque(g, step, out, g->tick_time, status, torque);
}

int hda_guard_watchdog_held(hda_guard *g, double now, double *torque) {
    const int bad = check_context(g);
    double step[HDA_N], out[HDA_N];
    int code = HDA_FINE;
    if (bad != HDA_FINE) return send_zero(bad, torque);
    if (torque == NULL)
        code = HDA_FAULT_CALL;
    else if (g->started && !hda_finite(now))
        code = HDA_FAULT_TIME_FINITE;
    else if (g->started && now < g->tick_time)
        code = HDA_FAULT_TIME_BACKWARD;
    else if (g->started && now - g->tick_time > g->config.watchdog)
        code = HDA_FAULT_WATCHDOG;
    if (code != HDA_FINE) {
        g->now = now;
        latch_code(g, code);
    }
    if (torque == NULL) return refusal_code(g);
    if (code == HDA_FINE) {
        memcpy(torque, g->sent, sizeof g->sent);
        return g->latched ? refusal_code(g) : HDA_FINE;
    }
    const double since = now - g->sent_time;
    g->elapsed = counted_time(g, now);
    if (code == HDA_FAULT_WATCHDOG && since >= 0.0 && since < g->elapsed) g->elapsed = since;
    rate_steps(g, step);
    safe_torque(g, HDA_SAFE_ZERO, step, out);
    return send_torque(g, step, out, code == HDA_FAULT_WATCHDOG ? now : g->sent_time, code, torque);
}

/* ---- recover ---- */

int hda_guard_recover_held(hda_guard *g, double now, const hda_measurement *m) {
    const int bad = check_context(g);
    double measured[MEASURED];
    if (bad != HDA_FINE) return bad;
    if (m == NULL) return HDA_RECOVER_CALL;
    if (!g->latched) return HDA_RECOVER_NOTHING;
    if (g->fault.code != HDA_FINE) return HDA_RECOVER_UNREAD;
    if (g->open) return HDA_RECOVER_OPEN;
    if (g->safe_ticks < g->safe_bound) return HDA_RECOVER_EARLY;
    memcpy(measured, m, sizeof measured);
    if (!hda_finite(now) || now < g->tick_time || now - g->tick_time > g->config.period_max) return HDA_RECOVER_TIME;
    if (hda_not_finite(measured, MEASURED) != 0) return HDA_RECOVER_FINITE;
    if (!g->known || m->stamp <= g->measured.stamp) return HDA_RECOVER_STALE;
    if (check_jump(g, m).code != HDA_FINE) return HDA_RECOVER_JUMP;
    g->latched = 0;
    g->trust = HDA_SAFE_HOLD;
    return HDA_FINE;
}
