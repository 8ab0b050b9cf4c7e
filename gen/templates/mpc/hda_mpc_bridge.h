/* What Python calls of the predictive controller, over plain arrays. */
#include "hda_mpc.h"

enum {
    HDA_MPC_SETTINGS_REAL = sizeof(hda_mpc_settings) / sizeof(double),
    HDA_MPC_REPORT_REAL = sizeof(hda_mpc_report) / sizeof(double),
    HDA_MPC_QP_REAL = sizeof(hda_mpc_qp) / sizeof(double),
    HDA_MPC_WHOLE_REAL = HDA_MPC_NX + HDA_MPC_N * HDA_N + 4 * HDA_N + HDA_MPC_SHARED + HDA_WRENCH +
        (HDA_MPC_N + 2) * HDA_MPC_NY + 4 * HDA_MPC_ROWS + HDA_MPC_N + HDA_MPC_N * HDA_MPC_SHOWN,
    HDA_MPC_SOLUTION_REAL = sizeof(hda_mpc_solution) / sizeof(double)
};

static void bridge_mpc_configure(void *const *a) {
    hda_guard_config config = {0};
    hda_config_from_arrays(a[3], a[4], &config);
    *(int *)a[5] = hda_mpc_configure(a[0], a[1], a[2], &config);
}

static void bridge_mpc_limit(void *const *a) {
    *(int *)a[2] = hda_mpc_limit(a[0], a[1]);
}

static void bridge_mpc_tick(void *const *a) {
    *(int *)a[5] = hda_mpc_tick(a[0], *(double *)a[1], (const hda_measurement *)a[2], a[3], a[4]);
}

static void bridge_mpc_prepare(void *const *a) {
    hda_mpc_prepare(a[0]);
}

static void bridge_mpc_watchdog(void *const *a) {
    *(int *)a[3] = hda_guard_watchdog(&((hda_mpc *)a[0])->guard, *(double *)a[1], a[2]);
}

static void bridge_mpc_recover(void *const *a) {
    *(int *)a[3] = hda_mpc_recover(a[0], *(double *)a[1], (const hda_measurement *)a[2]);
}

static void bridge_mpc_read(void *const *a) {
    bridge_fault(&((hda_mpc *)a[0])->guard, a[1], a[2]);
}

static void bridge_mpc_report(void *const *a) {
    hda_mpc_fill_report(a[0]);
    memcpy(a[1], &((hda_mpc *)a[0])->report, sizeof(hda_mpc_report));
}

static void bridge_mpc_problem(void *const *a) {
    memcpy(a[1], &((hda_mpc *)a[0])->qp, sizeof(hda_mpc_qp));
    memcpy(a[2], &((hda_mpc *)a[0])->solution, sizeof(hda_mpc_solution));
}

/* The whole problem of the last tick, in the controller's units, for the truth beside it. */
static void bridge_mpc_whole(void *const *a) {
    static const double full[] = HDA_MPC_TORQUE;
    const hda_mpc *k = a[0];
    double *to = a[1];
    const struct {
        const double *from;
        int count;
    } parts[] = {{k->x, HDA_MPC_NX},
                 {k->T, HDA_MPC_N * HDA_N},
                 {k->sent[1], HDA_N},
                 {k->hold, HDA_N},
                 {k->shared, HDA_MPC_SHARED},
                 {k->report.tip_force, HDA_WRENCH},
                 {k->goal, HDA_MPC_N * HDA_MPC_NY},
                 {k->output_weight[0], HDA_MPC_NY},
                 {k->output_weight[1], HDA_MPC_NY},
                 {k->qp.R, HDA_N},
                 {k->qp.D, HDA_N},
                 {k->limits[0], 2 * HDA_MPC_ROWS},
                 {k->qp.linear, HDA_MPC_ROWS},
                 {k->qp.square, HDA_MPC_ROWS},
                 {k->fading, HDA_MPC_N},
                 {k->y, HDA_MPC_N * HDA_MPC_SHOWN}};
    for (unsigned part = 0; part < sizeof parts / sizeof *parts; part++) {
        memcpy(to, parts[part].from, (size_t)parts[part].count * sizeof *to);
        for (int j = 0; j < HDA_N && (part == 2 || part == 3); j++) to[j] /= full[j];
        to += parts[part].count;
    }
}

static void bridge_mpc_solve(void *const *a) {
    const int *which = a[3];
    const double *how = a[4];
    *(int *)a[5] = which[0] == HDA_MPC_BY_OSQP       ? hda_mpc_osqp(a[0], a[1], how[0], (int)how[1])
                   : which[0] == HDA_MPC_BY_INTERIOR ? hda_mpc_interior(a[0], a[1], a[2])
                                                     : hda_mpc_riccati(a[0], a[1], a[2]);
}

/* clang-format off */
#define HDA_MPC_BRIDGE_ENTRIES \
    {"mpc_configure", 6, bridge_mpc_configure, {{"controller", 'B', sizeof(hda_mpc), 1}, {"p", 'd', HDA_NP, 0}, \
        {"settings", 'd', HDA_MPC_SETTINGS_REAL, 0}, {"whole", 'i', HDA_CONFIG_WHOLE, 0}, \
        {"real", 'd', HDA_CONFIG_REAL, 0}, {"status", 'i', 1, 1}}}, \
    {"mpc_limit", 3, bridge_mpc_limit, {{"controller", 'B', sizeof(hda_mpc), 1}, \
        {"settings", 'd', HDA_MPC_SETTINGS_REAL, 0}, {"status", 'i', 1, 1}}}, \
    {"mpc_tick", 6, bridge_mpc_tick, {{"controller", 'B', sizeof(hda_mpc), 1}, {"now", 'd', 1, 0}, \
        {"measurement", 'd', HDA_MEASURED, 0}, {"path", 'd', HDA_MPC_PATH, 0}, {"torque", 'd', HDA_N, 1}, \
        {"status", 'i', 1, 1}}}, \
    {"mpc_prepare", 1, bridge_mpc_prepare, {{"controller", 'B', sizeof(hda_mpc), 1}}}, \
    {"mpc_watchdog", 4, bridge_mpc_watchdog, {{"controller", 'B', sizeof(hda_mpc), 1}, {"now", 'd', 1, 0}, \
        {"torque", 'd', HDA_N, 1}, {"status", 'i', 1, 1}}}, \
    {"mpc_recover", 4, bridge_mpc_recover, {{"controller", 'B', sizeof(hda_mpc), 1}, {"now", 'd', 1, 0}, \
        {"measurement", 'd', HDA_MEASURED, 0}, {"status", 'i', 1, 1}}}, \
    {"mpc_read", 3, bridge_mpc_read, {{"controller", 'B', sizeof(hda_mpc), 1}, {"whole", 'i', 4, 1}, \
        {"real", 'd', HDA_FAULT_REAL, 1}}}, \
    {"mpc_report", 2, bridge_mpc_report, {{"controller", 'B', sizeof(hda_mpc), 1}, \
        {"report", 'd', HDA_MPC_REPORT_REAL, 1}}}, \
    {"mpc_problem", 3, bridge_mpc_problem, {{"controller", 'B', sizeof(hda_mpc), 1}, \
        {"problem", 'd', HDA_MPC_QP_REAL, 1}, {"solution", 'd', HDA_MPC_SOLUTION_REAL, 1}}}, \
    {"mpc_whole", 2, bridge_mpc_whole, {{"controller", 'B', sizeof(hda_mpc), 1}, \
        {"whole", 'd', HDA_MPC_WHOLE_REAL, 1}}}, \
    {"mpc_solve", 6, bridge_mpc_solve, {{"problem", 'd', HDA_MPC_QP_REAL, 0}, \
        {"solution", 'd', HDA_MPC_SOLUTION_REAL, 1}, {"work", 'B', sizeof(hda_mpc_work), 1}, {"which", 'i', 1, 0}, \
        {"how", 'd', 2, 0}, {"status", 'i', 1, 1}}},
/* clang-format on */
