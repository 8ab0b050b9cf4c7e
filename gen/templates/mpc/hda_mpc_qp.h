/* The quadratic problem of one tick, and its solution; the same for every solver. Doubles only, so that neither has
 * padding.
 *
 * Legend: x state, T torque, both as differences from the trajectory about which the problem was linearised; k node. In
 * the solver's units.
 *
 *     minimise  sum_k  1/2 x' H x + h' x  (x of node k + 1)  +  1/2 T' R T + r' T  +  1/2 (T - T_before)' D (T -
 * T_before) + d' (T - T_before) subject to  x_(k+1) = A x_k + B T_k + b,   low <= rows <= high,
 *
 * rows of node k: T_k (n), T_k - T_(k-1) (n), simple entries of x_(k+1) (HDA_MPC_SIMPLES), G x_(k+1) (HDA_MPC_NG). A
 * row is soft, with the exact penalty linear * v + 1/2 square * v^2 on the violation v, or hard where linear is at
 * least HDA_MPC_FREE, which torques and their changes are. A bound of at least HDA_MPC_FREE is none. T_(-1) is 0.
 * Matrices stand column by column. */
#ifndef HDA_MPC_QP_H
#define HDA_MPC_QP_H

#include <stdint.h>

#include "hda_mpc_sizes.h"

enum {
    HDA_MPC_N = HDA_MPC_NODES,
    HDA_MPC_HARD = 2 * HDA_N,
    HDA_MPC_SOFT = HDA_MPC_SIMPLES + HDA_MPC_NG,
    HDA_MPC_ROWS = HDA_MPC_HARD + HDA_MPC_SOFT,
    HDA_MPC_ALL = HDA_MPC_N * HDA_MPC_ROWS,
    HDA_MPC_PADDED = (HDA_MPC_ALL + 7) / 8 * 8 /* whole vectors */
};

#define HDA_MPC_FREE 1e20
#define HDA_MPC_LARGEST 1e15 /* of any entry but a bound: beyond it a problem is refused */

typedef struct hda_mpc_qp {
    double first[HDA_MPC_NX]; /* x of node 0 */
    double A[HDA_MPC_N * HDA_MPC_NX * HDA_MPC_NX], B[HDA_MPC_N * HDA_MPC_NX * HDA_N], b[HDA_MPC_N * HDA_MPC_NX];
    double H[HDA_MPC_N * HDA_MPC_NX * HDA_MPC_NX], h[HDA_MPC_N * HDA_MPC_NX];
    double R[HDA_MPC_N * HDA_N], r[HDA_MPC_N * HDA_N], D[HDA_MPC_N * HDA_N], d[HDA_MPC_N * HDA_N];
    double G[HDA_MPC_N * HDA_MPC_NG * HDA_MPC_NX]; /* row by row */
    double low[HDA_MPC_ALL], high[HDA_MPC_ALL];
    double linear[HDA_MPC_ALL], square[HDA_MPC_ALL];
} hda_mpc_qp;

/* name, code, sentence */
/* clang-format off */
#define HDA_MPC_SOLVED_LIST(HDA_STATUS) \
  HDA_STATUS(HDA_MPC_SOLVED, 0, "The problem is solved to tolerance.") \
  HDA_STATUS(HDA_MPC_CAPPED, 1, "The iterations ran out; the torques are legal, the solution is rough.") \
  HDA_STATUS(HDA_MPC_REFUSED, -1, \
  "An entry is not finite or too large, a bound is crossed, or a weight is negative; nothing was solved.") \
  HDA_STATUS(HDA_MPC_BROKEN, -2, \
  "The factorisation failed: the cost is not convex along the dynamics; nothing was solved.") \
  HDA_STATUS(HDA_MPC_BUSY, -3, \
  "OSQP's workspace is one for the process, and another thread's controller is in it; nothing was solved.")
/* clang-format on */

#define HDA_STATUS_NAME(name, code, sentence) name = (code),
enum hda_mpc_solved { HDA_MPC_SOLVED_LIST(HDA_STATUS_NAME) HDA_MPC_SOLVED_END = 1002 };
#undef HDA_STATUS_NAME

typedef struct hda_mpc_solution {
    double T[HDA_MPC_N * HDA_N], x[HDA_MPC_N * HDA_MPC_NX];
    double dual[HDA_MPC_ALL]; /* of the rows, positive where high holds; also the warm start */
    double residual;          /* largest violation of a hard row and largest wrong sign or size of a dual, scaled */
    double factored;          /* factorisations in all */
    double interior;          /* iterations of the interior point (osqp: of OSQP) */
    double active;            /* rows that stand at a bound or beyond it */
} hda_mpc_solution;

#endif
