/* The predictive controller from C under a count of allocations: hostile ticks, each in any floating-point environment beside the same in the
 * default one, then adversarial problems for the solvers. Prints one line of what went wrong and returns 1, or prints what it did. Arguments: ticks, problems. */
#define _GNU_SOURCE /* feenableexcept */
#include <math.h>
#include <string.h>

#include "harness.h"
#include "hda_mpc.h"
#include "mpc_settings.h"

#define APART __attribute__((noinline))

enum { SPARSE = 200 }; /* iterations of OSQP */

static hda_mpc k, plain;
static hda_mpc_qp qp;
static hda_mpc_solution solution;
static hda_mpc_work work;

static double hostile(void) {
    static const double famous[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 1e16, -1e20};
    const uint64_t any = bits();
    double out;
    memcpy(&out, &any, sizeof out);
    return bits() % 2 ? out : famous[bits() % 8];
}

APART static int tick_anywhere(double now, const hda_measurement *m, const double *path, double *torque) {
    const environment entered = enter_any_environment();
    const int status = hda_mpc_tick(&k, now, m, path, torque);
    leave_environment(entered);
    return status;
}

APART static void prepare_anywhere(void) {
    const environment entered = enter_any_environment();
    hda_mpc_prepare(&k);
    hda_mpc_fill_report(&k);
    leave_environment(entered);
}

APART static int recover_anywhere(double now, const hda_measurement *m) {
    const environment entered = enter_any_environment();
    const int status = hda_mpc_recover(&k, now, m);
    leave_environment(entered);
    return status;
}

static hda_guard_config guard(void) {
    hda_guard_config c = {0};
    double *const joints[] = {c.torque_limit, c.torque_rate, c.motor_jump, c.joint_jump, c.safe_damping, c.safe_stiffness};
    c.version = HDA_GUARD_VERSION, c.size = sizeof c, c.joints = HDA_N;
    c.safe = (int32_t)mpc_guard_whole[0], c.stale_stamp_ticks = (int32_t)mpc_guard_whole[1], c.stale_bits_ticks = (int32_t)mpc_guard_whole[2];
    memcpy(&c.period, mpc_guard_real, 5 * sizeof(double));
    for (int i = 0; i < 6; i++) memcpy(joints[i], mpc_guard_real + 5 + i * HDA_N, HDA_N * sizeof(double));
    return c;
}

static void ticks(long count) {
    static const double p[HDA_NP] = HDA_NOMINAL;
    static double path[HDA_MPC_PATH];
    const hda_guard_config config = guard();
    hda_mpc_settings settings;
    hda_measurement m = {0};
    double torque[HDA_N], same[HDA_N], last[HDA_N] = {0}, now = 0.0;
    long good = 0, refused = 0, recovered = 0;
    memcpy(&settings, mpc_settings, sizeof settings);
    DEMAND(hda_mpc_configure(&k, p, &settings, &config) == 0);
    for (int j = 0; j < HDA_N; j++) m.joint_position[j] = 0.5, m.motor_position[j] = 0.5 * mpc_ratio[j];
    for (long i = 0; i < count; i++) {
        const int late = bits() % 500 == 0;
        now += late ? 10.0 * config.period : config.period;
        hda_measurement given = m;
        for (int j = 0; j < HDA_N; j++) given.motor_position[j] += 1e-3 * uniform();
        given.stamp = bits() % 100 == 0 ? m.stamp : now;
        for (int e = 0; e < HDA_MPC_PATH; e++) path[e] = e % 4 < 2 ? 0.25 * uniform() : 0.3 * (uniform() - 0.5);
        given.tip_force[0] = 40.0 * (uniform() - 0.5);
        if (bits() % 300 == 0) ((double *)&given)[bits() % (sizeof given / sizeof(double))] = hostile();
        if (bits() % 300 == 0) path[bits() % HDA_MPC_PATH] = hostile();
        m.stamp = given.stamp;
        const double told = bits() % 1000 ? now : hostile();
        memcpy(&plain, &k, sizeof k);
        const int status = tick_anywhere(told, &given, path, torque);
        DEMAND(hda_mpc_tick(&plain, told, &given, path, same) == status);
        DEMAND(memcmp(torque, same, sizeof same) == 0 && memcmp(&plain, &k, sizeof k) == 0);
        if (bits() % 3) prepare_anywhere();
        for (int j = 0; j < HDA_N; j++) {
            DEMAND(isfinite(torque[j]) && fabs(torque[j]) <= config.torque_limit[j]);
            DEMAND(fabs(torque[j] - last[j]) <= config.torque_rate[j] * config.period * (1.0 + 1e-9));
            last[j] = torque[j];
        }
        DEMAND(strlen(hda_mpc_sentence(status)) > 10);
        if (status >= 0) good++;
        else refused++;
        if (k.guard.latched) {
            hda_measurement fresh = m;
            fresh.stamp = now;
            hda_guard_read(&k.guard, NULL);
            hda_fault fault;
            hda_guard_read(&k.guard, &fault);
            fresh.stamp = now + 1e-9;
            m.stamp = fresh.stamp;
            recovered += recover_anywhere(now, &fresh) == 0;
        }
    }
    DEMAND(good > count / 20 && refused > 0 && recovered > count / 1000);
}

/* A problem of a given kind of malice: 0 plain, then degenerate, huge, tiny, singular, crossed bounds, not a number, contradictory, unstable. */
static void make(int kind) {
    double *all = (double *)&qp;
    for (size_t i = 0; i < sizeof qp / sizeof(double); i++) all[i] = 2.0 * uniform() - 1.0;
    for (int n = 0; n < HDA_MPC_N; n++) {
        double *H = qp.H + n * HDA_MPC_NX * HDA_MPC_NX, column[HDA_MPC_NX], *A = qp.A + n * HDA_MPC_NX * HDA_MPC_NX;
        for (int i = 0; i < HDA_MPC_NX; i++) column[i] = uniform();
        for (int j = 0; j < HDA_MPC_NX; j++)
            for (int i = 0; i < HDA_MPC_NX; i++) {
                H[j * HDA_MPC_NX + i] = kind == 4 ? 0.0 : column[i] * column[j] + (i == j ? 0.1 : 0.0);
                A[j * HDA_MPC_NX + i] *= kind == 8 ? 1.5 : 0.3;
            }
    }
    for (int e = 0; e < HDA_MPC_N * HDA_N; e++) qp.R[e] = kind == 4 ? 0.0 : uniform() + 0.01, qp.D[e] = kind == 4 ? 0.0 : uniform();
    for (int e = 0; e < HDA_MPC_ALL; e++) {
        const double width = kind == 1 ? (bits() % 2 ? 0.0 : 1e-9) : uniform() + 0.01;
        const int hard = e % HDA_MPC_ROWS < HDA_MPC_HARD;
        qp.low[e] = -width - (hard ? 0.0 : 0.5 * uniform()), qp.high[e] = width;
        if (kind == 7 && !hard) qp.low[e] += 5.0, qp.high[e] += 5.0;
        qp.linear[e] = hard ? 10.0 * HDA_MPC_FREE : pow(10.0, 4.0 * uniform() - 2.0);
        qp.square[e] = hard ? 0.0 : pow(10.0, 4.0 * uniform() - 2.0);
    }
    if (kind == 2) for (int e = 0; e < HDA_MPC_N * HDA_MPC_NX; e++) qp.h[e] *= 1e12;
    if (kind == 3) for (int e = 0; e < HDA_MPC_N * HDA_MPC_NX * HDA_MPC_NX; e++) qp.H[e] *= 1e-12;
    if (kind == 5) qp.low[bits() % HDA_MPC_ALL] = 7.0;
    if (kind == 6) all[bits() % (sizeof qp / sizeof(double))] = hostile();
}

static void problems(long count) {
    long solved = 0, rough = 0, refused = 0, broken = 0;
    for (long i = 0; i < count; i++) {
        const int kind = (int)(i % 9);
        make(kind);
        memset(solution.dual, 0, sizeof solution.dual);
        if (bits() % 2) for (int e = 0; e < HDA_MPC_ALL; e++) solution.dual[e] = hostile();
        work.ready = 0;
        const int embedded = bits() % 50 == 0; /* it is slow */
        const int status = embedded ? hda_mpc_osqp(&qp, &solution, 1e-3, SPARSE) : bits() % 4 ? hda_mpc_riccati(&qp, &solution, &work) : hda_mpc_interior(&qp, &solution, &work);
        DEMAND(status == HDA_MPC_SOLVED || status == HDA_MPC_CAPPED || status == HDA_MPC_REFUSED || status == HDA_MPC_BROKEN);
        DEMAND(kind != 5 || status == HDA_MPC_REFUSED);
        DEMAND(kind == 5 || kind == 6 || status != HDA_MPC_REFUSED);
        DEMAND(embedded || kind != 0 || status == HDA_MPC_SOLVED || status == HDA_MPC_CAPPED);
        solved += status == HDA_MPC_SOLVED, rough += status == HDA_MPC_CAPPED, refused += status == HDA_MPC_REFUSED, broken += status == HDA_MPC_BROKEN;
        if (status < 0) continue;
        DEMAND(solution.interior <= (embedded ? SPARSE : HDA_MPC_INTERIOR) && solution.factored <= 3 * HDA_MPC_INTERIOR);
        for (int n = 0; n < HDA_MPC_N; n++)
            for (int j = 0; j < HDA_N; j++) {
                const double T = solution.T[n * HDA_N + j], before = n ? solution.T[(n - 1) * HDA_N + j] : 0.0;
                const int e = n * HDA_MPC_ROWS + j;
                DEMAND(isfinite(T) && T <= qp.high[e] && T >= qp.low[e]);
                const int possible = before + qp.low[e + HDA_N] <= qp.high[e] && before + qp.high[e + HDA_N] >= qp.low[e];
                DEMAND(!possible || (T - before <= qp.high[e + HDA_N] + 1e-12 && T - before >= qp.low[e + HDA_N] - 1e-12));
            }
    }
    printf("%ld problems: %ld solved, %ld rough, %ld refused, %ld broken\n", count, solved, rough, refused, broken);
}

int main(int argc, char **argv) {
    const long count = argc > 1 ? atol(argv[1]) : 1000, many = argc > 2 ? atol(argv[2]) : 1000;
    const long before = allocations;
    void *own = malloc(10);
    DEMAND(own && allocations == before + COUNTED); /* the count works */
    free(own);
    const long begun = allocations;
    ticks(count);
    DEMAND(allocations == begun);
    problems(many);
    DEMAND(allocations <= begun + 1); /* the line that was printed */
    printf("%ld ticks without an allocation\n", count);
    return 0;
}
