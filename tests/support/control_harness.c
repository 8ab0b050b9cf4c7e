/* The controller from C: null pointers, refused configurations, memory in refused ticks, and hostile ticks of every law under a count of
 * allocations, each in any floating-point environment beside the same in the default one. Prints one line of what went wrong and returns 1, or prints the number of ticks. */
#define _GNU_SOURCE /* feenableexcept */
#include <math.h>
#include <string.h>

#include "harness.h"
#include "hda_control.h"

#define APART __attribute__((noinline))

static hda_controller k, before, plain;

/* A number that nobody would send: any bits, or one of the famous ones. */
static double hostile(void) {
    static const double famous[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 0.0, -0.0};
    const uint64_t any = bits();
    double out;
    memcpy(&out, &any, sizeof out);
    return bits() % 2 ? out : famous[bits() % 8];
}

static hda_guard_config legal(double period) {
    hda_guard_config c = {0};
    c.version = HDA_GUARD_VERSION, c.size = sizeof c, c.joints = HDA_N, c.safe = HDA_SAFE_DAMPING;
    c.stale_stamp_ticks = 5, c.stale_bits_ticks = HDA_NEVER;
    c.period = period, c.period_min = period / 2, c.period_max = 2 * period, c.watchdog = 20 * period;
    c.force_limit = HDA_UNLIMITED;
    for (int j = 0; j < HDA_N; j++) {
        c.torque_limit[j] = 0.8, c.torque_rate[j] = 50, c.motor_jump[j] = 1, c.joint_jump[j] = 0.01;
        c.safe_damping[j] = 2e-3;
    }
    return c;
}

static void nulls(const double *p, const double *gains, const hda_guard_config *config) {
    hda_measurement m = {0};
    double reference[HDA_REFERENCE_MOST] = {0}, torque[HDA_N];
    DEMAND(hda_controller_configure(NULL, 0, p, gains, config) == HDA_CONTROL_CALL);
    DEMAND(hda_controller_configure(&k, 0, NULL, gains, config) == HDA_CONTROL_CALL);
    DEMAND(hda_controller_configure(&k, 0, p, NULL, config) == HDA_CONTROL_CALL);
    DEMAND(hda_controller_configure(&k, 0, p, gains, NULL) == HDA_CONTROL_CALL);
    DEMAND(hda_controller_recover(NULL, 0, &m) == HDA_CONTROL_CALL);
    for (int j = 0; j < HDA_N; j++) torque[j] = NAN;
    DEMAND(hda_controller_tick(NULL, 0, &m, reference, torque) == HDA_FAULT_CONTEXT);
    for (int j = 0; j < HDA_N; j++) DEMAND(torque[j] == 0);
    torque[0] = NAN; /* a context of zeros is not configured */
    DEMAND(hda_controller_tick(&k, 0, &m, reference, torque) == HDA_FAULT_UNCONFIGURED && torque[0] == 0);
    DEMAND(hda_controller_configure(&k, 0, p, gains, config) == 0);
    DEMAND(hda_controller_tick(&k, 1, NULL, reference, torque) == HDA_FAULT_CALL && hda_finite(torque[0]));
    DEMAND(hda_controller_tick(&k, 1.001, &m, NULL, torque) == HDA_FAULT_CALL && hda_finite(torque[0]));
    DEMAND(hda_controller_tick(&k, 1.002, &m, reference, NULL) == HDA_FAULT_CALL);
    memset(&k, 0, sizeof k);
}

/* Everything that may be wrong is refused, and no byte of the context changes. */
static void refusals(int law, const double *p, const double *gains, const hda_guard_config *config, int gain_count) {
    double wrong[HDA_GAINS_MOST], parameters[HDA_NP];
    hda_guard_config bad = *config;
    DEMAND(hda_controller_configure(&k, law, p, gains, config) == 0);
    before = k;
    for (int i = 1; i < gain_count; i++) {
        static const double values[] = {NAN, INFINITY, -1, 1e300};
        for (int v = 0; v < 4; v++) {
            memcpy(wrong, gains, sizeof wrong);
            wrong[i] = values[v];
            DEMAND(hda_controller_configure(&k, law, p, wrong, config) == HDA_CONTROL_GAIN);
        }
    }
    memcpy(parameters, p, sizeof parameters);
    parameters[HDA_NP - 1] = NAN;
    DEMAND(hda_controller_configure(&k, law, parameters, gains, config) == HDA_CONTROL_PARAMETER);
    DEMAND(hda_controller_configure(&k, -1, p, gains, config) == HDA_CONTROL_LAW);
    DEMAND(hda_controller_configure(&k, 99, p, gains, config) == HDA_CONTROL_LAW);
    bad.safe = HDA_SAFE_UNSET;
    DEMAND(hda_controller_configure(&k, law, p, gains, &bad) == HDA_CONFIG_SAFE);
    bad = legal(1.0); /* longer than the gain `period` may be */
    DEMAND(hda_controller_configure(&k, law, p, gains, &bad) == HDA_CONTROL_GAIN);
    DEMAND(memcmp(&k, &before, sizeof k) == 0);
}

APART static int tick_anywhere(double now, const hda_measurement *m, const double *reference, double *torque) {
    const environment entered = enter_any_environment();
    const int status = hda_controller_tick(&k, now, m, reference, torque);
    leave_environment(entered);
    return status;
}

APART static int watch_anywhere(double now, double *torque) {
    const environment entered = enter_any_environment();
    const int status = hda_guard_watchdog(&k.guard, now, torque);
    leave_environment(entered);
    return status;
}

APART static int recover_anywhere(double now, const hda_measurement *m) {
    const environment entered = enter_any_environment();
    const int status = hda_controller_recover(&k, now, m);
    leave_environment(entered);
    return status;
}

APART static int configure_anywhere(int law, const double *p, const double *gains, const hda_guard_config *config) {
    const environment entered = enter_any_environment();
    const int status = hda_controller_configure(&k, law, p, gains, config);
    leave_environment(entered);
    return status;
}

static void storm(const hda_guard_config *config, int reference_count, long count) {
    hda_measurement m = {0};
    double reference[HDA_REFERENCE_MOST] = {0}, torque[HDA_N], same[HDA_N], last[HDA_N] = {0}, now = 1;
    long refused = 0, ran = 0, recovered = 0;
    const long start = allocations;
    for (long i = 0; i < count; i++) {
        now += config->period * (bits() % 2000 ? 1 : 3 * uniform() - 0.5);
        m.stamp = bits() % 50 ? now : m.stamp;
        for (int j = 0; j < HDA_N; j++) {
            m.motor_position[j] += 0.2 * (uniform() - 0.5), m.joint_position[j] += 2e-3 * (uniform() - 0.5);
            m.motor_velocity[j] = 100 * (uniform() - 0.5);
        }
        m.tip_force[0] = 200 * (uniform() - 0.5), m.tip_force[1] = 200 * (uniform() - 0.5);
        for (int r = 0; r < reference_count; r++) reference[r] = 20 * (uniform() - 0.5);
        hda_measurement given = m;
        if (bits() % 2000 == 0) ((double *)&given)[bits() % (sizeof m / sizeof(double))] = hostile();
        if (bits() % 2000 == 0) reference[bits() % (uint64_t)reference_count] = hostile();
        const int was = k.started;
        const double told = bits() % 3000 ? now : hostile();
        memcpy(before.state, k.state, sizeof k.state);
        for (int j = 0; j < HDA_N; j++) torque[j] = NAN;
        memcpy(&plain, &k, sizeof k);
        const int status = tick_anywhere(told, &given, reference, torque);
        DEMAND(hda_controller_tick(&plain, told, &given, reference, same) == status);
        DEMAND(memcmp(torque, same, sizeof same) == 0 && memcmp(&plain, &k, sizeof k) == 0);
        for (int j = 0; j < HDA_N; j++) {
            const double step = config->torque_rate[j] * config->period * (1 + 1e-12);
            DEMAND(hda_finite(torque[j]) && fabs(torque[j]) <= config->torque_limit[j]);
            DEMAND(fabs(torque[j] - last[j]) <= step);
            last[j] = torque[j];
        }
        const int moved = memcmp(before.state, k.state, sizeof k.state) != 0;
        if (was) DEMAND(moved == (status >= 0)); /* a refused tick leaves the memory alone, any other advances it */
        refused += status < 0, ran += status >= 0;
        if (status < 0 && bits() % 4 == 0) {
            hda_fault fault;
            hda_guard_read(&k.guard, &fault);
            m.stamp = now + 1e-5;
            if (recover_anywhere(m.stamp, &m) == 0) {
                DEMAND(!k.started);
                recovered++;
            }
        }
        if (bits() % 2000 == 0) {
            const int seen = watch_anywhere(bits() % 2 ? now : bits() % 2 ? now + 1 : hostile(), torque);
            for (int j = 0; j < HDA_N; j++) {
                DEMAND(hda_finite(torque[j]) && fabs(torque[j] - last[j]) <= config->torque_rate[j] * config->period * (1 + 1e-12));
                last[j] = torque[j];
            }
            refused += seen < 0;
        }
    }
    DEMAND(allocations == start);
    DEMAND(refused > count / 20 && ran > count / 20 && recovered > 5); /* all of it happened */
}

#define COUNTS(name, gains, reference, memory) {gains, reference},

/* argv: the file of p, then each law's gains in the order of hda_laws.h, as doubles; ticks of each law */
int main(int argc, char **argv) {
    static const int counts[][2] = {HDA_LAW_LIST(COUNTS)};
    const int laws = (int)(sizeof counts / sizeof *counts);
    static double p[HDA_NP], gains[HDA_GAINS_MOST];
    FILE *file = argc > 2 ? fopen(argv[1], "rb") : NULL;
    const long count = argc > 2 ? atol(argv[2]) : 0;
    const hda_guard_config config = legal(1e-3);
    DEMAND(file && fread(p, sizeof *p, HDA_NP, file) == HDA_NP);
    for (int law = 0; law < laws; law++) {
        DEMAND(fread(gains, sizeof *gains, (size_t)counts[law][0], file) == (size_t)counts[law][0]);
        memset(&k, 0, sizeof k);
        nulls(p, gains, &config);
        refusals(law, p, gains, &config, counts[law][0]);
        DEMAND(configure_anywhere(law, p, gains, &config) == 0);
        storm(&config, counts[law][1], count);
    }
    fclose(file);
    for (int status = -400; status <= 20; status++) DEMAND(strlen(hda_controller_sentence(status)) > 10);
    printf("%ld\n", laws * count);
    return 0;
}
