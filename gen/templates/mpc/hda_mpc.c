/* The tick: guard, estimator, target, solver, guard; the part that needs no measurement goes before it. No allocation,
 * no lock, no unbounded loop. */
#include "hda_mpc.h"

#include <math.h>
#include <string.h>

#include "hda_guard_held.h"

enum { NX = HDA_MPC_NX, NU = HDA_N, N = HDA_MPC_N };

static const int state_index[] = HDA_MPC_INDEX, memory_index[] = HDA_MPC_MEMORY, places[] = HDA_MPC_PLACES,
                 speeds[] = HDA_MPC_SPEEDS, links[] = HDA_MPC_LINKS;
static const double scale[] = HDA_MPC_SCALE, full[] = HDA_MPC_TORQUE;

/* Change of a torque, as a share of the largest: the sequence of quadratic problems has converged. */
#define SETTLED 1e-10
#define ROUNDED 1e-9 /* of a limit */
#define FAR 1e4      /* of a trajectory, in the solver's units: beyond it the plan is given up */

static void scale_state(const double *x, double *z) {
    for (int i = 0; i < NX; i++) z[i] = x[state_index[i]] / scale[i];
}

/* A plan that stays where the arm is. */
static void hold_plan(hda_mpc *k) {
    for (int node = 0; node <= N; node++) {
        scale_state(k->report.x, k->x + node * NX);
        for (int i = NX / 2; i < NX && node; i++) k->x[node * NX + i] = 0.0;
    }
    for (int e = 0; e < N * NU; e++) k->T[e] = k->guard.sent[e % NU] / full[e % NU];
    memset(k->solution.dual, 0, sizeof k->solution.dual);
}

/* The torque that holds the arm against gravity, tip force and disturbance. */
static void set_holding_torque(hda_mpc *k) {
    double q[NU], g[NU], J[HDA_WRENCH * NU], velocity[HDA_WRENCH], turn[HDA_WRENCH], still[NU] = {0};
    for (int j = 0; j < NU; j++) q[j] = k->report.x[links[j]];
    hda_gravity_torque(q, k->c, g);
    hda_tip_jacobian(q, still, k->c, J, velocity, turn);
    for (int j = 0; j < NU; j++) {
        const double *column = J + HDA_WRENCH * j, *force = k->report.tip_force;
        double outside = column[0] * force[0] + column[1] * force[1];
        for (int i = 2; i < HDA_WRENCH; i++) outside += column[i] * force[i];
        const double held = (g[j] - outside) / k->estimator.ratio[j] - k->estimator.s[HDA_NX + j];
        const double most = k->guard.config.torque_limit[j];
        k->hold[j] = held > most ? most : held < -most ? -most : held;
    }
}

static void start_control(hda_mpc *k, const hda_measurement *m, const double *path) {
    hda_mpc_start_estimate(&k->estimator, m, k->c, &k->settings.noise);
    memcpy(k->report.x, k->estimator.s, sizeof k->report.x);
    memcpy(k->report.tip_force, m->tip_force, sizeof k->report.tip_force);
    hda_mpc_begin_admittance(k, m->joint_position, path);
    for (int j = 0; j < NU; j++) k->anchor[j] = k->estimator.s[places[j]];
    for (int d = 0; d < 2 * HDA_MPC_LATEST; d++) memcpy(k->sent[d], k->guard.sent, sizeof k->sent[d]);
    k->seen = m->stamp;
    hold_plan(k);
    k->started = 1;
    k->prepared = k->failures = k->rung = 0;
}

/* Whole periods in a time, at most HDA_MPC_LATEST. */
static int count_periods(const hda_mpc *k, double time) {
    const double count = time / k->guard.config.period + 0.5;
    return !(count > 0.0) ? 0 : count >= HDA_MPC_LATEST ? HDA_MPC_LATEST : (int)count;
}

/* Whether the estimate cannot be carried from the measurement to the tick: too old, or from the future. */
static int is_stale(const hda_mpc *k, double now, const hda_measurement *m) {
    const double age = (now - m->stamp) / k->guard.config.period;
    return !(age + k->settings.delay < HDA_MPC_LATEST + 0.5 && age > -0.5);
}

/* The estimate at the time of the measurement, then at the tick. A measurement that was seen before says nothing new.
 */
static void update_estimate(hda_mpc *k, double now, const hda_measurement *m) {
    double acted[HDA_MPC_LATEST][NU]; /* before the measurement, the last first */
    const int late = count_periods(k, now - m->stamp) + (int)k->settings.delay,
              delay = late < HDA_MPC_LATEST ? late : HDA_MPC_LATEST;
    const int passed = count_periods(k, m->stamp - k->seen);
    const double period = k->guard.config.period, *s = k->estimator.s;
    memcpy(acted, k->sent[delay], sizeof acted);
    if (k->settings.by_current > 0.0) memcpy(acted[0], m->motor_torque, sizeof acted[0]);
    if (passed > 0)
        hda_mpc_estimate(&k->estimator, m, (const double (*)[NU])acted, passed, k->c, &k->settings.noise, period,
                         k->settings.by_sensor > 0.0);
    if (passed > 0) k->seen = m->stamp;
    memcpy(k->report.x, s, sizeof k->report.x);
    memcpy(k->report.tip_force, k->settings.by_sensor > 0.0 ? m->tip_force : s + HDA_NX + NU,
           sizeof k->report.tip_force);
    for (int d = delay - 1; d >= 0; d--)
        hda_mpc_predict_state(k->c, k->sent[d], s + HDA_NX, k->report.tip_force, period, k->report.x);
}

static void linearise_plan(hda_mpc *k) {
    int near = 1;
    for (int e = 0; e < (N + 1) * NX; e++) near &= k->x[e] < FAR && k->x[e] > -FAR;
    if (!near) hold_plan(k);
    set_holding_torque(k);
    memcpy(k->shared + HDA_MPC_AT_DISTURBANCE, k->estimator.s + HDA_NX, NU * sizeof(double));
    for (int i = 0; i < HDA_MPC_MEMORIES; i++) k->shared[HDA_MPC_AT_HELD + i] = k->report.x[memory_index[i]];
    hda_mpc_linearise(k);
    hda_mpc_set_bounds(k);
    hda_mpc_prepare_riccati(&k->qp, &k->solution, &k->work);
    k->prepared = 1;
}

HDA_APART static void prepare_tick(hda_mpc *k) {
    double x[HDA_NX];
    if (!k || !k->configured || !k->started || k->prepared || k->guard.latched) return;
    memcpy(x, k->report.x, sizeof x);
    hda_mpc_predict_state(k->c, k->guard.sent, k->estimator.s + HDA_NX, k->report.tip_force, k->guard.config.period, x);
    hda_mpc_shift_plan(k);
    scale_state(x, k->x);
    linearise_plan(k);
}

/* Solves; what was done of it, as a status of hda_mpc_qp.h. */
static int solve_problem(hda_mpc *k, int *second) {
    const hda_mpc_settings *s = &k->settings;
    const int backend = (int)s->backend;
    int status = backend == HDA_MPC_BY_OSQP       ? hda_mpc_osqp(&k->qp, &k->solution, s->tolerance, (int)s->iterations)
                 : backend == HDA_MPC_BY_INTERIOR ? hda_mpc_interior(&k->qp, &k->solution, &k->work)
                                                  : hda_mpc_riccati(&k->qp, &k->solution, &k->work);
    *second = status < 0 && backend != HDA_MPC_BY_OSQP;
    if (*second) status = hda_mpc_osqp(&k->qp, &k->solution, s->tolerance, (int)s->iterations);
    k->report.solved = status;
    return status;
}

/* Impedance with damping about the place where it began, at the motors. */
static void add_impedance(hda_mpc *k, double *raw) {
    const double *s = k->estimator.s, *stiffness = k->settings.hold_stiffness, *damping = k->settings.hold_damping;
    for (int j = 0; j < NU; j++)
        raw[j] = k->hold[j] + stiffness[j] * (k->anchor[j] - s[places[j]]) - damping[j] * s[speeds[j]];
}

/* Moves the trajectory by the solution; the largest change of a torque, as a share of the motor's largest. */
static double apply_step(hda_mpc *k) {
    double most = 0.0;
    for (int e = 0; e < N * NU; e++) {
        const double moved = k->solution.T[e];
        most = moved > most ? moved : -moved > most ? -moved : most;
        k->T[e] += moved;
    }
    for (int e = 0; e < NX; e++) k->x[e] += k->qp.first[e];
    for (int e = 0; e < N * NX; e++) k->x[NX + e] += k->solution.x[e];
    return most;
}

/* A torque that is beyond a hard limit by what is rounded, in the plan or in the clock, is at it: the guard has nothing
 * to say of that. */
static void snap_to_limits(const hda_mpc *k, double *raw) {
    const hda_guard *g = &k->guard;
    for (int j = 0; j < NU; j++) {
        const double step = g->config.torque_rate[j] * g->elapsed, most = g->config.torque_limit[j],
                     slight = ROUNDED * (step < most ? step : most);
        const double limited = hda_limit(raw[j], g->sent[j], most, step), off = raw[j] - limited;
        if (off < slight && off > -slight) raw[j] = limited;
    }
}

/* The torque of this tick by the ladder; its status. */
static int compute_torque(hda_mpc *k, double now, const hda_measurement *m, const double *path, double *raw) {
    int second, solved = solve_problem(k, &second);
    for (int more = (int)k->settings.steps; solved >= 0; more--) {
        const double moved = apply_step(k);
        if (more <= 1 || moved < SETTLED) break;
        linearise_plan(k);
        memset(k->qp.first, 0, sizeof k->qp.first);
        hda_mpc_set_targets(k, path, k->report.tip_force);
        solved = solve_problem(k, &second);
    }
    if (solved >= 0) {
        for (int j = 0; j < NU; j++) k->anchor[j] = k->estimator.s[places[j]];
        k->failures = 0;
        k->rung = HDA_MPC_ON_PLAN;
    } else {
        k->failures++;
        k->rung = k->failures <= HDA_MPC_SHIFTS    ? HDA_MPC_ON_SHIFTED
                  : k->failures < HDA_MPC_FAILURES ? HDA_MPC_ON_IMPEDANCE
                                                   : HDA_MPC_ON_RAMP;
        memset(k->solution.dual, 0, sizeof k->solution.dual);
    }
    /* the guard latches what is not a number */
    for (int j = 0; j < NU; j++) raw[j] = k->rung == HDA_MPC_ON_RAMP ? NAN : full[j] * k->T[j];
    if (k->rung == HDA_MPC_ON_IMPEDANCE) add_impedance(k, raw);
    snap_to_limits(k, raw);
    return k->rung == HDA_MPC_ON_RAMP        ? HDA_MPC_FAILED
           : k->rung == HDA_MPC_ON_IMPEDANCE ? HDA_MPC_IMPEDANCE
           : k->rung == HDA_MPC_ON_SHIFTED   ? HDA_MPC_SHIFTED
           : solved == HDA_MPC_CAPPED        ? HDA_MPC_ROUGH
           : second                          ? HDA_MPC_SECOND
           : is_stale(k, now, m)             ? HDA_MPC_OLD
                                             : hda_mpc_check_limits(k, path);
}

static int follow_path(hda_mpc *k, double now, const hda_measurement *m, const double *path, double *raw) {
    double x[NX];
    if (k->started) {
        prepare_tick(k);
        hda_mpc_step_admittance(k, k->report.tip_force);
        update_estimate(k, now, m);
    } else {
        start_control(k, m, path);
        linearise_plan(k);
    }
    scale_state(k->report.x, x);
    for (int i = 0; i < NX; i++) k->qp.first[i] = x[i] - k->x[i];
    hda_mpc_set_targets(k, path, k->report.tip_force);
    return compute_torque(k, now, m, path, raw);
}

HDA_APART static int run_tick(hda_mpc *k, double now, const hda_measurement *m, const double *path, double *torque) {
    double raw[NU] = {0}, map[HDA_TIP * NU] = {0};
    int followed = 0;
    if (!k || !k->configured) return hda_guard_end_held(k ? &k->guard : NULL, raw, map, torque);
    const int opened = hda_guard_begin_held(&k->guard, now, m, path, HDA_MPC_PATH);
    if (opened >= 0) {
        followed = follow_path(k, now, m, path, raw);
        hda_force_map(m->joint_position, k->c, map);
    }
    const int status = hda_guard_end_held(&k->guard, raw, map, torque);
    memmove(k->sent[1], k->sent[0], sizeof k->sent - sizeof k->sent[0]);
    memcpy(k->sent[0], k->guard.sent, sizeof k->sent[0]);
    k->prepared = 0;
    if (k->guard.latched) k->rung = HDA_MPC_ON_RAMP;
    if (opened >= 0) hda_mpc_detect_contact(k);
    k->report.rung = k->rung;
    return followed < 0 || (status >= 0 && followed > 0) ? followed : status;
}

int hda_mpc_tick(hda_mpc *k, double now, const hda_measurement *m, const double *path, double *torque) {
    const hda_float caller = hda_float_hold();
    const int status = run_tick(k, now, m, path, torque);
    hda_float_restore(&caller);
    return status;
}

void hda_mpc_prepare(hda_mpc *k) {
    const hda_float caller = hda_float_hold();
    prepare_tick(k);
    hda_float_restore(&caller);
}

int hda_mpc_recover(hda_mpc *k, double now, const hda_measurement *m) {
    if (!k) return HDA_MPC_CALL;
    const int status = hda_guard_recover(&k->guard, now, m);
    if (!status) k->started = k->failures = k->rung = 0;
    return status;
}

const char *hda_mpc_sentence(int status) {
#define HDA_STATUS_CASE(name, code, sentence) \
    case code: return sentence;
    switch (status) {
        HDA_MPC_LIST(HDA_STATUS_CASE)
        default: return hda_status_sentence(status);
    }
#undef HDA_STATUS_CASE
}
