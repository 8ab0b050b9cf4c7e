/* Model predictive control that keeps the admittance, inside the guard: whatever comes in, a legal torque goes out. See
 * docs/guides/mpc.md.
 *
 *     static hda_mpc k;                                     // zeros
 *     hda_mpc_configure(&k, p, &settings, &config);
 *     every period: status = hda_mpc_tick(&k, now, &measurement, path, torque);
 *                   send the torque, then hda_mpc_prepare(&k);   // what can be done before the next measurement
 *
 * path: the commanded motion at the tick and at the end of every node, HDA_MPC_AXES positions then as many velocities
 * each (tip: x, y, in space x, y, z, the rotation vector of its orientation, and with the velocities the angular one;
 * else joint by joint). SI units throughout. Static memory, bounded loops, no libm but what the model needs. Not a
 * safety-rated function: use it behind a certified stop. */
#ifndef HDA_MPC_H
#define HDA_MPC_H

#include "hda_mpc_estimate.h"
#include "hda_mpc_solver.h"

enum {
    HDA_MPC_AXES = HDA_MPC_AXES_COUNT,
    HDA_MPC_WALL_NUMBERS = HDA_TIP + 1,               /* numbers of a wall */
    HDA_MPC_SHOWN = HDA_MPC_NY + HDA_MPC_ORIENTATION, /* what a node tells: outputs, orientation */
    HDA_MPC_PATH = 2 * HDA_MPC_AXES * (HDA_MPC_N + 1),
    HDA_MPC_FAMILIES = 7, /* motor torque, torque rate, joint position, motor speed, joint torque, tip speed, walls */
    HDA_MPC_SHIFTS = 2,   /* ticks on the last plan */
    HDA_MPC_FAILURES = 10 /* in a row, until the safe state is latched */
};

/* name, code, sentence; the guard's own statuses come through unchanged where they say more */
/* clang-format off */
#define HDA_MPC_LIST(HDA_STATUS) \
  HDA_STATUS(HDA_MPC_ROUGH, 20, "The solver ran out of iterations; its best torque was sent.") \
  HDA_STATUS(HDA_MPC_SECOND, 21, "The first solver failed; the torque is OSQP's.") \
  HDA_STATUS(HDA_MPC_SHIFTED, 22, "No solver succeeded; the torque is that of the last plan, shifted.") \
  HDA_STATUS(HDA_MPC_IMPEDANCE, 23, \
  "No solver succeeded for longer than the plan is trusted; the arm is held by an impedance with damping.") \
  HDA_STATUS(HDA_MPC_OUTSIDE, 24, "The arm is beyond a soft limit; the torque brings it back.") \
  HDA_STATUS(HDA_MPC_UNREACHED, 25, "The path is out of the arm's reach; the arm goes as near as its limits allow.") \
  HDA_STATUS(HDA_MPC_OLD, 26, \
  "The measurement is older than eight ticks, or stamped ahead of the tick; the plan stands on it as if it were not.") \
  HDA_STATUS(HDA_MPC_FAILED, -320, \
  "The solvers failed ten times in a row; the safe state is latched, and hda_mpc_recover leaves it.") \
  HDA_STATUS(HDA_MPC_CALL, -300, "A pointer is null; nothing was changed.") \
  HDA_STATUS(HDA_MPC_PARAMETER, -301, "A parameter of the model is not finite; nothing was changed.") \
  HDA_STATUS(HDA_MPC_NUMBER, -302, "A setting is not finite; nothing was changed.") \
  HDA_STATUS(HDA_MPC_GRID, -303, "Every node must last from the period to 0.2 s; nothing was changed.") \
  HDA_STATUS(HDA_MPC_WEIGHT, -304, \
  "A weight is negative, or none of the tracking weights is positive; nothing was changed.") \
  HDA_STATUS(HDA_MPC_ADMITTANCE, -305, \
  "Mass must be positive, damping and stiffness must not be negative; nothing was changed.") \
  HDA_STATUS(HDA_MPC_LIMIT, -306, "A limit is not positive, or a range is empty; nothing was changed.") \
  HDA_STATUS(HDA_MPC_WALL, -307, "A wall's normal must have length 1; nothing was changed.") \
  HDA_STATUS(HDA_MPC_NOISE, -308, "A deviation of the estimator must be positive; nothing was changed.") \
  HDA_STATUS(HDA_MPC_LATE, -309, "The delay must be 0 to 8 whole ticks, and the steps 1 to 100; nothing was changed.")
/* clang-format on */

#define HDA_STATUS_NAME(name, code, sentence) name = (code),
enum hda_mpc_status { HDA_MPC_LIST(HDA_STATUS_NAME) HDA_MPC_END = 1003 };
#undef HDA_STATUS_NAME

enum hda_mpc_rung { HDA_MPC_ON_PLAN = 0, HDA_MPC_ON_SHIFTED = 1, HDA_MPC_ON_IMPEDANCE = 2, HDA_MPC_ON_RAMP = 3 };

enum hda_mpc_backend { HDA_MPC_BY_RICCATI = 0, HDA_MPC_BY_OSQP = 1, HDA_MPC_BY_INTERIOR = 2 };

/* Doubles only. */
typedef struct hda_mpc_settings {
    double backend;               /* enum hda_mpc_backend */
    double tolerance, iterations; /* of OSQP */
    double delay;                 /* ticks from a sample to its use beyond what its stamp says, 0 to 8 */
    double steps;                 /* of sequential quadratic programming a tick, at most; 1: real-time iteration */
    double by_sensor;             /* 1: the tip force is measured; 0: estimated */
    double by_current;            /* 1: the torque that acted before a sample is the measured one; 0: the one sent */
    double decay;                 /* 1/s, of the tip force over the horizon */
    double terminal;              /* factor of the tracking weights at the last node */
    /* 1/m^2 (1/rad^2), s^2/m^2, s^2/rad^2; torques as shares of the largest */
    double weight_position, weight_velocity, weight_posture, weight_torque, weight_rate;
    double weight_orientation, weight_turning; /* 1/rad^2, s^2/rad^2: turns of a tip in space */
    double penalty_linear, penalty_square;     /* of a soft limit, per share of the limit */
    double tip_speed;                          /* m/s */
    double margin;                             /* share of soft limits that is kept free */
    double grid[HDA_MPC_N];                    /* s */
    double mass[HDA_MPC_AXES], damping[HDA_MPC_AXES], stiffness[HDA_MPC_AXES];
    double position_low[HDA_N], position_high[HDA_N], motor_speed[HDA_N], joint_torque[HDA_N];
    double smoothing[HDA_N]; /* rad/s at the motor: width of friction's smooth sign in the prediction */
    /* N m/rad, N m s/rad at the motor, of the impedance on the ladder */
    double hold_stiffness[HDA_N], hold_damping[HDA_N];
    /* normal, offset: kept is n . tip <= offset + give */
    double walls[HDA_MPC_WALL_NUMBERS * (HDA_MPC_WALLS ? HDA_MPC_WALLS : 1)];
    double give[HDA_MPC_WALLS ? HDA_MPC_WALLS : 1]; /* m: contact force allowed over the wall's stiffness */
    hda_mpc_noise noise;
} hda_mpc_settings;

/* What happened, for logs and people. Doubles only. */
typedef struct hda_mpc_report {
    double rung, failures, solved; /* enum hda_mpc_rung; failures in a row; status of the solver */
    double factored, interior, active, residual;
    double active_of[HDA_MPC_FAMILIES];   /* rows of the plan at or beyond their bound */
    double violated_by[HDA_MPC_FAMILIES]; /* the present state's largest violation, SI */
    double foreseen_by[HDA_MPC_FAMILIES]; /* the plan's, SI, to first order */
    double tip_force[HDA_WRENCH];         /* that the target is driven by, N, in space and N m */
    double observed_force[HDA_TIP];       /* by the momentum observer, N */
    double disturbance[HDA_N];            /* N m at the motors */
    /* squared, normalised; its mean is the number of encoders where the estimator is consistent */
    double innovation;
    double collision;                 /* 1 while the observed force departs from its own slow mean */
    double yielded[2 * HDA_MPC_AXES]; /* the target's displacement and velocity */
    double x[HDA_NX];                 /* estimated state */
    double plan[HDA_MPC_N * HDA_N], predicted[HDA_MPC_N * HDA_MPC_NX]; /* N m at the motors; state, SI */
} hda_mpc_report;

/* The context: begins as zeros, belongs to one thread at a time. */
typedef struct hda_mpc {
    hda_guard guard;
    hda_mpc_settings settings;
    hda_mpc_estimator estimator;
    hda_mpc_report report;
    hda_mpc_qp qp;
    hda_mpc_solution solution;
    hda_mpc_work work;
    double c[HDA_NC], shared[HDA_MPC_SHARED];
    /* trajectory that the problem is linearised about */
    double x[(HDA_MPC_N + 1) * HDA_MPC_NX], T[HDA_MPC_N * HDA_N];
    /* outputs of nodes 1 on, and their Jacobians */
    double y[HDA_MPC_N * HDA_MPC_SHOWN], Y[HDA_MPC_N * HDA_MPC_NY * HDA_MPC_NX];
    double g[HDA_MPC_N * HDA_MPC_NG], G[HDA_MPC_N * HDA_MPC_NG * HDA_MPC_NX]; /* general rows, and their Jacobians */
    double goal[HDA_MPC_N * HDA_MPC_NY];
    double fading[HDA_MPC_N];            /* share of the present force that is left at each node */
    double output_weight[2][HDA_MPC_NY]; /* of the outputs; at the last node */
    /* the admittance over the period, then over each node: (x, v, F) to (x, v, F) */
    double carry[(HDA_MPC_N + 1) * HDA_MPC_AXES][9];
    double limits[HDA_MPC_ROWS][2]; /* of the rows, in their units: low, high */
    double unit[HDA_MPC_ROWS];      /* SI of 1 in each row */
    double size[HDA_MPC_ROWS];      /* of each soft limit, in its row's units */
    /* 1/s, of a place that the arm is beyond: how fast it has to come back, in its row's units; else 0 */
    double back[HDA_MPC_ROWS];
    double weight;                          /* of all cost, so that its curvature is near 1 */
    double sent[2 * HDA_MPC_LATEST][HDA_N]; /* torques sent, the last first */
    double seen;                            /* stamp of the measurement that the estimate stands on */
    double yielded[2 * HDA_MPC_AXES];
    double anchor[HDA_N];     /* motor positions that the impedance holds */
    double hold[HDA_N];       /* torque that holds the arm, N m at the motor */
    double expected[HDA_TIP]; /* the observed force, as it has been of late */
    double wound[HDA_N];      /* torsion at the limit of each torque row, negative where the ratio is */
    int32_t flexible[HDA_N];  /* joint, from 0, of each torque row */
    int32_t configured, started, prepared, failures, rung;
} hda_mpc;

#ifdef __cplusplus
extern "C" {
#endif

/* Sets or replaces everything: all, or none and a negative status. Between ticks; the motion starts anew from the next
 * measurement. */
HDA_API int hda_mpc_configure(hda_mpc *k, const double *p, const hda_mpc_settings *settings,
                              const hda_guard_config *config);

/* Moves limits while running: ranges, speeds, torques, walls; all or none. */
HDA_API int hda_mpc_limit(hda_mpc *k, const hda_mpc_settings *settings);

/* One tick: HDA_N torques in N m at the motors are always written. */
HDA_API int hda_mpc_tick(hda_mpc *k, double now, const hda_measurement *m, const double *path, double *torque);

/* The part of the next tick that needs no measurement. Without a call the tick does it itself. */
HDA_API void hda_mpc_prepare(hda_mpc *k);

/* Leaves the safe state with a fresh measurement. Returns 0, or says why not. */
HDA_API int hda_mpc_recover(hda_mpc *k, double now, const hda_measurement *m);

/* Completes the report of the last tick; before hda_mpc_prepare, which goes on to the next one. */
HDA_API void hda_mpc_fill_report(hda_mpc *k);

/* The sentence of a status, the guard's too; never null. */
HDA_API const char *hda_mpc_sentence(int status);

#ifdef __cplusplus
}
#endif

/* Parts of the tick, each in its own file. */
void hda_mpc_set_constants(hda_mpc *k); /* settings and parameters -> what is computed once */
void hda_mpc_stage_constants(const double *c, double *shared);
void hda_mpc_linearise(hda_mpc *k);          /* trajectory -> dynamics, outputs, cost's curvature, rows */
void hda_mpc_set_torsion_limits(hda_mpc *k); /* torsions at the limits of the joint torques */
void hda_mpc_set_bounds(hda_mpc *k);         /* trajectory and limits -> bounds of the rows */
void hda_mpc_set_targets(hda_mpc *k, const double *path, const double *force);  /* target -> slope of the cost */
void hda_mpc_begin_admittance(hda_mpc *k, const double *q, const double *path); /* displaced as far as the arm is */
void hda_mpc_step_admittance(hda_mpc *k, const double *force);                  /* one period of the admittance */
void hda_mpc_shift_plan(hda_mpc *k);                            /* trajectory and active set, one period on */
int hda_mpc_check_limits(const hda_mpc *k, const double *path); /* HDA_MPC_OUTSIDE, HDA_MPC_UNREACHED or 0 */
/* outputs and rows at one state */
void hda_mpc_compute_outputs(const hda_mpc *k, const double *x, double *y, double *Y, double *g, double *G);
void hda_mpc_detect_contact(hda_mpc *k); /* momentum observer -> observed force and collision */
double hda_mpc_length(const double *a);  /* of HDA_TIP numbers */

#endif
