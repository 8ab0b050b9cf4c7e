/* The solvers of hda_mpc_qp.h behind one interface. Static memory; every loop has a cap. */
#ifndef HDA_MPC_SOLVER_H
#define HDA_MPC_SOLVER_H

#include "hda_mpc_riccati.h"

enum {
    HDA_MPC_ROUNDS = 6,   /* factorisations of the active set */
    HDA_MPC_POLISHES = 4, /* the same after the interior point */
    HDA_MPC_REFINES = 5,  /* solutions with one factorisation */
    HDA_MPC_INTERIOR = 40 /* iterations of the interior point */
};

/* The interior point's variables of one side of all rows, by row; see hda_mpc_interior.c. */
typedef struct hda_mpc_side {
    double there[HDA_MPC_ALL], bound[HDA_MPC_ALL];
    double t[HDA_MPC_ALL], l[HDA_MPC_ALL], s[HDA_MPC_ALL], v[HDA_MPC_ALL];
    double dt[HDA_MPC_ALL], dl[HDA_MPC_ALL], ds[HDA_MPC_ALL], dv[HDA_MPC_ALL];
    double over[HDA_MPC_ALL], open[HDA_MPC_ALL], give[HDA_MPC_ALL];
    double product[HDA_MPC_ALL], soft_product[HDA_MPC_ALL];
} hda_mpc_side;

typedef struct hda_mpc_work {
    hda_mpc_factors f;
    double weight[HDA_MPC_ALL], slope[HDA_MPC_ALL], rows[HDA_MPC_ALL];
    double T[HDA_MPC_N * HDA_N], x[HDA_MPC_N * HDA_MPC_NX];
    double y[HDA_MPC_ALL];
    double kept_T[HDA_MPC_N * HDA_N], kept_x[HDA_MPC_N * HDA_MPC_NX], kept_y[HDA_MPC_ALL], kept_rows[HDA_MPC_ALL];
    hda_mpc_side side[2]; /* of high, of low */
    double linear[HDA_MPC_ALL], square[HDA_MPC_ALL], soft[HDA_MPC_ALL];
    int ready;            /* f belongs to set */
    int set[HDA_MPC_ALL]; /* 0 free, 1 at high, 2 beyond high, -1 at low, -2 beyond low */
} hda_mpc_work;

/* Solved by the active set from solution->dual (zeros: none known), else by the interior point. Status as in hda_mpc_qp.h; where it is
 * negative the solution is left as it was. */
int hda_mpc_riccati(const hda_mpc_qp *qp, hda_mpc_solution *solution, hda_mpc_work *w);

/* Does beforehand what needs neither the first state nor the cost's slope, for the next hda_mpc_riccati with the same matrices and bounds. */
void hda_mpc_anticipate(const hda_mpc_qp *qp, const hda_mpc_solution *solution, hda_mpc_work *w);

/* The same from the interior point alone. */
int hda_mpc_interior(const hda_mpc_qp *qp, hda_mpc_solution *solution, hda_mpc_work *w);

/* The same by OSQP's generated code: one workspace for the whole process. tolerance: absolute and relative. */
int hda_mpc_osqp(const hda_mpc_qp *qp, hda_mpc_solution *solution, double tolerance, int iterations);

/* Whether every entry may be solved with. */
int hda_mpc_legal(const hda_mpc_qp *qp);

/* Iterations of the interior point until the gap is small: how many, or -1 where a factorisation failed. The rows' multipliers go to w->y. */
int hda_mpc_inside(const hda_mpc_qp *qp, hda_mpc_work *w, int *converged);

#endif
