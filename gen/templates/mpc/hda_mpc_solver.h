/* The solvers of hda_mpc_qp.h behind one interface. Static memory; every loop has a cap. */
#ifndef HDA_MPC_SOLVER_H
#define HDA_MPC_SOLVER_H

#include "hda_mpc_riccati.h"

enum {
    HDA_MPC_ROUNDS = 6,   /* factorisations of the active set */
    HDA_MPC_POLISHES = 8, /* the same after the interior point */
    HDA_MPC_REFINES = 5,  /* solutions with one factorisation */
    HDA_MPC_INTERIOR = 30 /* iterations of the interior point from one start; it has two */
};

/* Eight rows side by side. */
typedef double hda_mpc_wide __attribute__((vector_size(64), aligned(8), may_alias));

enum { HDA_MPC_BLOCKS = HDA_MPC_PADDED / 8 };

/* The interior point's variables of one side of all rows; see hda_mpc_interior.c. */
typedef struct hda_mpc_side {
    hda_mpc_wide there[HDA_MPC_BLOCKS], bound[HDA_MPC_BLOCKS];
    hda_mpc_wide t[HDA_MPC_BLOCKS], l[HDA_MPC_BLOCKS], s[HDA_MPC_BLOCKS], v[HDA_MPC_BLOCKS];
    hda_mpc_wide dt[HDA_MPC_BLOCKS], dl[HDA_MPC_BLOCKS], ds[HDA_MPC_BLOCKS], dv[HDA_MPC_BLOCKS];
    hda_mpc_wide over[HDA_MPC_BLOCKS], open[HDA_MPC_BLOCKS], give[HDA_MPC_BLOCKS], ease[HDA_MPC_BLOCKS];
    hda_mpc_wide pair[HDA_MPC_BLOCKS], soft_pair[HDA_MPC_BLOCKS]; /* reciprocals of t l and s v */
    hda_mpc_wide product[HDA_MPC_BLOCKS], soft_product[HDA_MPC_BLOCKS];
} hda_mpc_side;

/* A point of the iteration. */
typedef struct hda_mpc_point {
    double T[HDA_MPC_N * HDA_N], x[HDA_MPC_N * HDA_MPC_NX];
    double rows[HDA_MPC_PADDED], y[HDA_MPC_PADDED];
} hda_mpc_point;

typedef struct hda_mpc_work {
    hda_mpc_factors f;
    double weight[HDA_MPC_PADDED], slope[HDA_MPC_PADDED];
    double length[HDA_MPC_ALL], stiff[HDA_MPC_ALL]; /* of the rows: see stiffen() in hda_mpc_active.c */
    hda_mpc_point now, next, kept;
    hda_mpc_side side[2]; /* of high, of low */
    hda_mpc_wide linear[HDA_MPC_BLOCKS], square[HDA_MPC_BLOCKS], soft[HDA_MPC_BLOCKS];
    double pairs, unmet;
    double once, twice;   /* see stride() in hda_mpc_interior.c */
    int rounds, ready;    /* iterations of the interior point; what f belongs to, see expect() in hda_mpc_active.c */
    int jams;             /* short steps in a row that the interior point bears */
    int changed;          /* rows that came or went in the last solution */
    int set[HDA_MPC_ALL]; /* 0 free, 1 at high, 2 beyond high, -1 at low, -2 beyond low */
} hda_mpc_work;

/* Solved by the active set from solution->dual (zeros: none known), else by the interior point. Status as in
 * hda_mpc_qp.h; where it is negative the solution is left as it was. */
int hda_mpc_riccati(const hda_mpc_qp *qp, hda_mpc_solution *solution, hda_mpc_work *w);

/* Does beforehand what needs neither the first state nor the cost's slope, for the next hda_mpc_riccati with the same
 * matrices and bounds. */
void hda_mpc_prepare_riccati(const hda_mpc_qp *qp, const hda_mpc_solution *solution, hda_mpc_work *w);

/* The same from the interior point alone. */
int hda_mpc_interior(const hda_mpc_qp *qp, hda_mpc_solution *solution, hda_mpc_work *w);

/* The same by OSQP's generated code: one workspace for the whole process. tolerance: absolute and relative. */
int hda_mpc_osqp(const hda_mpc_qp *qp, hda_mpc_solution *solution, double tolerance, int iterations);

/* Whether every entry may be solved with. */
int hda_mpc_is_valid(const hda_mpc_qp *qp);

/* The interior point's beginning, wide: far from every bound. 0, or -1 where the factorisation failed. */
int hda_mpc_start_interior(const hda_mpc_qp *qp, hda_mpc_work *w, int wide);

/* The same from the plan as it is (no change of torque) and multipliers of its rows. */
int hda_mpc_restart_interior(const hda_mpc_qp *qp, hda_mpc_work *w, const double *y);

/* Its iterations until the gap is that small: 1, or 0 where they ran out. */
int hda_mpc_iterate_interior(const hda_mpc_qp *qp, hda_mpc_work *w, double gap);

#endif
