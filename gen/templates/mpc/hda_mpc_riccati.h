/* The problem of hda_mpc_qp.h without its inequalities, but with a weight w and a slope s on every row (1/2 w row^2 + s row), by Riccati's
 * recursion: factor once, solve for as many slopes as wanted. See hda_mpc_riccati.c. */
#ifndef HDA_MPC_RICCATI_H
#define HDA_MPC_RICCATI_H

#include "hda_mpc_qp.h"

typedef struct hda_mpc_factors {
    double turned[HDA_MPC_N * HDA_MPC_NX * HDA_MPC_NX];   /* A' */
    double reach[HDA_MPC_N * HDA_MPC_NX * HDA_N];         /* Qux' = A' (P B + S) */
    double inverse[HDA_MPC_N * HDA_N * HDA_N];            /* of Quu */
    double gain[HDA_MPC_N * HDA_MPC_NX * HDA_N];          /* Quu^-1 Qux, transposed */
    double moved[HDA_MPC_N * HDA_MPC_NX];                 /* P b */
    double pulled[HDA_MPC_N * HDA_N];                     /* S' b */
    double step[HDA_MPC_N * HDA_N];                       /* D with the weights of its rows */
} hda_mpc_factors;

/* Everything that does not depend on weights and slopes. */
void hda_mpc_turn(const hda_mpc_qp *qp, hda_mpc_factors *f);

/* 0, or -1 where a pivot is not positive. */
int hda_mpc_factor(const hda_mpc_qp *qp, const double *weight, hda_mpc_factors *f);

/* Torques, states and the rows' values. */
void hda_mpc_solve(const hda_mpc_qp *qp, const hda_mpc_factors *f, const double *slope, double *T, double *x, double *rows);

#endif
