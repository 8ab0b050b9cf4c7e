/* OSQP on the sparse problem. Its workspace is one for the whole process, so every call brings all data, and starts
 * from what the same controller found last; another thread that comes meanwhile is turned away, it does not wait.
 *
 * "No solution" is a finite number in OSQP (2143289344.0): a solution counts only if the status is solved, every number
 * is finite and no larger than a sane one, and the torques lie within their bounds; the states are then recomputed from
 * the torques. */
#include "hda_mpc_solver.h"

#include <string.h>

#include "hda_mpc_osqp_tables.h"
#include "hda_osqp_osqp.h"
#include "hda_osqp_workspace.h"

enum { NX = HDA_MPC_NX, NU = HDA_N, N = HDA_MPC_N, ROWS = HDA_MPC_ROWS, SOFT = HDA_MPC_SOFT, HARD = HDA_MPC_HARD };

#define NOWHERE 1e30
#define SANE 1e8

static OSQPFloat P[P_ENTRIES], A[A_ENTRIES], q[N * WIDTH], low[N * HEIGHT], high[N * HEIGHT], start[N * WIDTH],
    dual[N * HEIGHT];
static const hda_mpc_solution *known; /* whose solution dual is of */
static unsigned char taken;           /* a thread is in it */

static void fill_matrices(const hda_mpc_qp *qp) {
    const double *from = (const double *)qp;
    for (int e = 0; e < P_ENTRIES; e++) {
        double sum = 0.0;
        for (int i = 0; i < 3; i++) sum += p_from[e][i] >= 0 ? from[p_from[e][i]] : 0.0;
        P[e] = p_sign[e] * sum;
    }
    for (int e = 0; e < A_ENTRIES; e++) A[e] = a_sign[e] * (a_from[e] >= 0 ? from[a_from[e]] : 1.0);
    for (int k = 0; k < N; k++) {
        OSQPFloat *cost = q + k * WIDTH, *l = low + k * HEIGHT, *u = high + k * HEIGHT;
        const double *bounds_low = qp->low + k * ROWS, *bounds_high = qp->high + k * ROWS;
        for (int j = 0; j < NU; j++)
            cost[j] = qp->r[k * NU + j] + qp->d[k * NU + j] - (k + 1 < N ? qp->d[(k + 1) * NU + j] : 0.0);
        for (int i = 0; i < NX; i++) cost[NU + i] = qp->h[k * NX + i];
        for (int i = 0; i < SOFT; i++) cost[NU + NX + i] = qp->linear[k * ROWS + HARD + i];
        for (int i = 0; i < NX; i++) {
            double sum = qp->b[k * NX + i];
            for (int m = 0; m < NX && k == 0; m++) sum += qp->A[m * NX + i] * qp->first[m];
            l[i] = u[i] = sum;
        }
        int row = NX;
        for (int i = 0; i < HARD; i++, row++) {
            l[row] = bounds_low[i] > -HDA_MPC_FREE ? bounds_low[i] : -NOWHERE;
            u[row] = bounds_high[i] < HDA_MPC_FREE ? bounds_high[i] : NOWHERE;
        }
        for (int i = 0; i < SOFT; i++, row++) {
            l[row] = -NOWHERE;
            u[row] = bounds_high[HARD + i] < HDA_MPC_FREE ? bounds_high[HARD + i] : NOWHERE;
        }
        for (int i = 0; i < SOFT; i++) {
            if (!has_low[i]) continue;
            l[row] = bounds_low[HARD + i] > -HDA_MPC_FREE ? bounds_low[HARD + i] : -NOWHERE;
            u[row++] = NOWHERE;
        }
        for (int i = 0; i < SOFT; i++, row++) {
            l[row] = 0.0;
            u[row] = NOWHERE;
        }
    }
}

static int are_finite(const OSQPFloat *a, int count) {
    for (int i = 0; i < count; i++)
        if (!(a[i] < SANE && a[i] > -SANE)) return 0;
    return 1;
}

/* The states that belong to the torques, within their bounds. */
static void roll_out(const hda_mpc_qp *qp, const OSQPFloat *found, hda_mpc_solution *s) {
    for (int k = 0; k < N; k++) {
        const double *now = k ? s->x + (k - 1) * NX : qp->first, *bounds_low = qp->low + k * ROWS,
                     *bounds_high = qp->high + k * ROWS;
        for (int j = 0; j < NU; j++) {
            const double before = k ? s->T[(k - 1) * NU + j] : 0.0;
            double most = bounds_high[j], least = bounds_low[j], T = found[k * WIDTH + j];
            if (before + bounds_high[NU + j] < most) most = before + bounds_high[NU + j];
            if (before + bounds_low[NU + j] > least) least = before + bounds_low[NU + j];
            if (T > most) T = most;
            if (T < least) T = least;
            if (T > bounds_high[j]) T = bounds_high[j];
            if (T < bounds_low[j]) T = bounds_low[j];
            s->T[k * NU + j] = T;
        }
        for (int i = 0; i < NX; i++) {
            double sum = qp->b[k * NX + i];
            for (int m = 0; m < NX; m++) sum += qp->A[k * NX * NX + m * NX + i] * now[m];
            for (int j = 0; j < NU; j++) sum += qp->B[k * NX * NU + j * NX + i] * s->T[k * NU + j];
            s->x[k * NX + i] = sum;
        }
    }
}

/* Multipliers of the rows; how many count. */
static double read_multipliers(const OSQPFloat *y, hda_mpc_solution *s) {
    double active = 0.0;
    for (int k = 0; k < N; k++) {
        const OSQPFloat *from = y + k * HEIGHT + NX;
        int lower = HARD + SOFT;
        for (int i = 0; i < ROWS; i++) {
            double value = from[i];
            if (i >= HARD && has_low[i - HARD]) value += from[lower++];
            s->dual[k * ROWS + i] = value;
            active += value > 1e-6 || value < -1e-6;
        }
    }
    return active;
}

static int solve_alone(const hda_mpc_qp *qp, hda_mpc_solution *s, double tolerance, int iterations) {
    OSQPSolver *solver = &hda_osqp_solver;
    OSQPSettings settings = *solver->settings;
    settings.eps_abs = settings.eps_rel = tolerance;
    settings.max_iter = iterations;
    settings.warm_starting = 1;
    fill_matrices(qp);
    if (osqp_update_settings(solver, &settings) ||
        osqp_update_data_mat(solver, P, NULL, P_ENTRIES, A, NULL, A_ENTRIES) ||
        osqp_update_data_vec(solver, q, low, high)) {
        osqp_cold_start(solver);
        known = NULL;
        return HDA_MPC_BROKEN;
    }
    if (known == s)
        osqp_warm_start(solver, start, dual);
    else
        osqp_cold_start(solver);
    osqp_solve(solver);
    const int solved = solver->info->status_val == OSQP_SOLVED,
              rough = solver->info->status_val == OSQP_MAX_ITER_REACHED ||
                      solver->info->status_val == OSQP_SOLVED_INACCURATE;
    known =
        solved && are_finite(solver->solution->x, N * WIDTH) && are_finite(solver->solution->y, N * HEIGHT) ? s : NULL;
    if (!known) {
        const int keep = rough && are_finite(solver->solution->x, N * WIDTH);
        if (keep) {
            roll_out(qp, solver->solution->x, s);
            memset(s->dual, 0, sizeof s->dual);
            s->interior = (double)solver->info->iter;
            s->factored = s->active = s->residual = 0.0;
        }
        osqp_cold_start(solver);
        return keep ? HDA_MPC_CAPPED : HDA_MPC_BROKEN;
    }
    memcpy(dual, solver->solution->y, sizeof dual);
    roll_out(qp, solver->solution->x, s);
    s->active = read_multipliers(solver->solution->y, s);
    s->residual = solver->info->prim_res;
    s->factored = (double)solver->info->rho_updates + 1.0;
    s->interior = (double)solver->info->iter;
    return HDA_MPC_SOLVED;
}

int hda_mpc_osqp(const hda_mpc_qp *qp, hda_mpc_solution *s, double tolerance, int iterations) {
    if (!hda_mpc_is_valid(qp)) return HDA_MPC_REFUSED;
    if (__atomic_test_and_set(&taken, __ATOMIC_ACQUIRE)) return HDA_MPC_BUSY;
    const int status = solve_alone(qp, s, tolerance, iterations);
    __atomic_clear(&taken, __ATOMIC_RELEASE);
    return status;
}
