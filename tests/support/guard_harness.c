/* Drives the guard for the tests: many ticks in one call; and with -DGUARD_STORM, as a program for the sanitizers and
 * valgrind, a storm of hostile calls that checks every torque it gets. */
#include "hda_guard.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MEASURED = 3 + 5 * HDA_N, REFERENCES = 2, ROW = 1 + MEASURED + REFERENCES + HDA_N + 2 * HDA_N };

/* The sizes of the four structures and the places of their last members, which a mirror elsewhere must equal. */
void harness_layout(int64_t *layout)
{
    const size_t found[] = {sizeof(hda_guard_config), offsetof(hda_guard_config, safe_stiffness),
                            sizeof(hda_measurement),  offsetof(hda_measurement, tip_force),
                            sizeof(hda_fault),        offsetof(hda_fault, reference),
                            sizeof(hda_guard),        offsetof(hda_guard, fault)};
    for (size_t i = 0; i < sizeof found / sizeof *found; i++) layout[i] = (int64_t)found[i];
}

void harness_limit(int64_t count, const double *wanted, const double *last, const double *limit, const double *step,
                   double *out)
{
    for (int64_t i = 0; i < count; i++) out[i] = hda_limit(wanted[i], last[i], limit[i], step[i]);
}

void harness_finite(int64_t count, const double *x, int32_t *out)
{
    for (int64_t i = 0; i < count; i++) out[i] = hda_finite(x[i]);
}

/* rows: now, measurement, two references, raw torque, force map. Out: torque, the tick's counted time in s, status. */
void harness_run(hda_guard *g, int64_t ticks, const double *rows, double *torque, double *counted, int32_t *status)
{
    for (int64_t k = 0; k < ticks; k++) {
        const double *row = rows + k * ROW, *raw = row + 1 + MEASURED + REFERENCES;
        hda_measurement m;
        memcpy(&m, row + 1, sizeof m);
        (void)hda_guard_begin(g, row[0], &m, row + 1 + MEASURED, REFERENCES);
        counted[k] = g->elapsed;
        status[k] = hda_guard_end(g, raw, raw + HDA_N, torque + k * HDA_N);
    }
}

#ifdef GUARD_STORM

static uint64_t seed = UINT64_C(0x9e3779b97f4a7c15);

static uint64_t draw(void) /* xorshift64* (Vigna 2016) */
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return seed * UINT64_C(2685821657736338717);
}

/* Mostly a number of ordinary size, one time in `rare` any bits at all. */
static double number(double size, uint64_t rare)
{
    double x = size * ((double)(draw() >> 11) / 4503599627370496.0 - 1.0);
    if (draw() % rare == 0) {
        const uint64_t bits = draw() % 2 ? draw() : draw() | UINT64_C(0x7ff0000000000000);
        memcpy(&x, &bits, sizeof x);
    }
    return x;
}

static void fill(double *x, int count, double size, uint64_t rare)
{
    for (int i = 0; i < count; i++) x[i] = number(size, rare);
}

static hda_guard_config draw_config(void)
{
    hda_guard_config c;
    memset(&c, 0, sizeof c);
    c.version = HDA_GUARD_VERSION;
    c.size = sizeof c;
    c.joints = HDA_N;
    c.safe = (int32_t)(draw() % 4);
    c.stale_stamp_ticks = 1 + (int32_t)(draw() % 4);
    c.stale_bits_ticks = draw() % 2 ? HDA_NEVER : 5;
    c.period = 1e-3;
    c.period_min = 0.5e-3;
    c.period_max = 2e-3;
    c.watchdog = 5e-3;
    c.force_limit = draw() % 2 ? HDA_UNLIMITED : 30.0;
    for (int j = 0; j < HDA_N; j++) {
        c.torque_limit[j] = 0.2 + 0.1 * j;
        c.torque_rate[j] = 20.0 + 5.0 * j;
        c.motor_jump[j] = 0.5;
        c.joint_jump[j] = 0.5;
        c.safe_damping[j] = 0.01;
        c.safe_stiffness[j] = 2.0;
    }
    if (draw() % 8 == 0) c.torque_limit[draw() % HDA_N] = number(1.0, 2);
    return c;
}

/* A torque is legal: finite, within the limit, within the rate of the torque before and the longest step a tick has. */
static void demand_legal(const hda_guard *g, const double *before, const double *torque)
{
    for (int j = 0; j < HDA_N; j++) {
        const double limit = g->config.torque_limit[j], step = g->config.torque_rate[j] * g->config.period;
        const double moved = hda_magnitude(torque[j] - before[j]);
        if (!hda_finite(torque[j]) || !(hda_magnitude(torque[j]) <= limit) || !(moved <= step + 1e-15 * limit)) {
            printf("illegal torque %.17g of joint %d after %.17g\n", torque[j], j + 1, before[j]);
            exit(1);
        }
    }
}

int main(int argc, char **argv)
{
    const long calls = argc > 1 ? strtol(argv[1], NULL, 10) : 100000;
    long faults = 0, recovered = 0, configured = 0, degraded = 0, fine = 0;
    double now = 1e3, before[HDA_N] = {0.0};
    static hda_guard g;
    hda_guard_config c = draw_config();
    c.safe = HDA_SAFE_HOLD;
    for (int j = 0; j < HDA_N; j++) c.torque_limit[j] = 0.3;
    if (hda_guard_configure(&g, &c) != HDA_FINE) return 2;

    for (long k = 0; k < calls; k++) {
        double reference[HDA_REFERENCE_MAX], raw[HDA_N], map[2 * HDA_N], torque[HDA_N];
        hda_measurement m;
        hda_fault fault;
        const uint64_t rare = k % 4096 < 512 ? 8 : 20000;
        memset(&m, 0, sizeof m);
        m.stamp = now;
        fill(m.motor_position, HDA_N, 0.2, rare);
        fill(m.motor_velocity, HDA_N, 5.0, rare);
        fill(m.joint_position, HDA_N, 0.2, rare);
        fill(m.joint_velocity, HDA_N, 5.0, rare);
        fill(m.motor_torque, HDA_N, 0.2, rare);
        fill(m.tip_force, 2, 20.0, rare);
        fill(reference, HDA_REFERENCE_MAX, 1.0, rare * 8);
        fill(raw, HDA_N, k % 3 ? 1e-3 : 1.0, rare);
        for (int j = 0; j < HDA_N; j++) raw[j] += k % 3 ? g.sent[j] : 0.0;
        fill(map, 2 * HDA_N, k % 64 ? 50.0 : 500.0, rare);
        memcpy(before, g.sent, sizeof before);
        now += 1e-3 * (1.0 + number(0.3, rare * 100)) + (draw() % (rare * 10) == 0 ? 1.0 : 0.0);
        if (!hda_finite(now) || hda_magnitude(now) > 1e6) now = 1e3;

        const uint64_t what = draw() % (rare * 4);
        int status;
        if (what == 0) status = hda_guard_watchdog(&g, now, draw() % 2 ? torque : NULL);
        else if (what == 1) status = hda_guard_begin(&g, now, draw() % 2 ? &m : NULL, NULL, (int)(draw() % 200) - 50);
        else if (what == 2) status = hda_guard_end(&g, NULL, NULL, NULL);
        else {
            const int count = (int)(draw() % (HDA_REFERENCE_MAX + 1));
            (void)hda_guard_begin(&g, draw() % (rare * 20) ? now : number(1.0, 2), &m, reference, count);
            memcpy(torque, raw, sizeof torque);
            status = hda_guard_end(&g, draw() % (rare * 8) ? torque : NULL, draw() % (rare * 8) ? map : NULL, torque);
            demand_legal(&g, before, torque);
        }
        demand_legal(&g, before, g.sent);
        faults += status < 0;
        fine += status == HDA_FINE;
        degraded += status > 0;
        if (status < 0 && draw() % 4 == 0) {
            (void)hda_guard_read(&g, draw() % 8 ? &fault : NULL);
            m.stamp = now + 1e-9;
            recovered += hda_guard_recover(&g, now, &m) == HDA_FINE;
        }
        if (draw() % 64 == 0) {
            c = draw_config();
            configured += hda_guard_configure(&g, &c) == HDA_FINE;
        }
    }
    printf("fine %ld degraded %ld refused %ld ", fine, degraded, faults);
    printf("recovered %ld configured %ld\n", recovered, configured);
    return 0;
}

#endif
