/* The problem of hda_mpc_qp.h without its inequalities, but with a weight w and a slope s on every row (1/2 w row^2 + s
 * row), by Riccati's recursion: factor once, solve for as many slopes as wanted. See hda_mpc_riccati.c. */
#ifndef HDA_MPC_RICCATI_H
#define HDA_MPC_RICCATI_H

#include "hda_mpc_qp.h"

/* Columns with an entry a state, and with an entry a joint, as vectors: the compiler makes of them what the target has.
 */
/* as arrays hold them */
typedef double hda_mpc_column __attribute__((vector_size(8 * HDA_MPC_NX_WIDE), aligned(8), may_alias));
typedef double hda_mpc_short __attribute__((vector_size(8 * HDA_MPC_N_WIDE), aligned(8), may_alias));

typedef struct hda_mpc_node {
    hda_mpc_column A[HDA_MPC_NX], turned[HDA_MPC_NX]; /* columns, rows */
    hda_mpc_column B[HDA_N], b;
    hda_mpc_short across[HDA_MPC_NX];          /* rows of B */
    hda_mpc_column G[HDA_MPC_NG];              /* rows */
    hda_mpc_column gain[HDA_N];                /* Quu^-1 Qux, row by row */
    hda_mpc_short feed[HDA_MPC_NX];            /* the same, column by column */
    hda_mpc_column moved;                      /* P b */
    hda_mpc_short inverse[HDA_N], kept[HDA_N]; /* of Quu; its product with D */
    hda_mpc_short pulled, step;                /* S' b; D with the weights of its rows */
} hda_mpc_node;

typedef struct hda_mpc_factors {
    hda_mpc_node node[HDA_MPC_N];
} hda_mpc_factors;

/* Everything that does not depend on weights and slopes. */
void hda_mpc_arrange_factors(const hda_mpc_qp *qp, hda_mpc_factors *f);

/* 0, or -1 where a pivot is not positive. */
int hda_mpc_factor(const hda_mpc_qp *qp, const double *weight, hda_mpc_factors *f);

/* Torques, states and the rows' values. */
void hda_mpc_solve(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *slope, double *T, double *x,
                   double *rows);

/* States and rows with that torque at every node. */
void hda_mpc_roll_out(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *held, double *x, double *rows);

#endif
