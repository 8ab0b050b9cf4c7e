/* States, disturbance and tip force from encoders and the torque sent: an extended Kalman filter, and a momentum
 * observer beside it. See hda_mpc_estimate.c. */
#ifndef HDA_MPC_ESTIMATE_H
#define HDA_MPC_ESTIMATE_H

#include "hda_guard.h"
#include "hda.h"
#include "hda_mpc_sizes.h"

enum { HDA_MPC_SEEN = HDA_NX + HDA_N + HDA_WRENCH, HDA_MPC_LATEST = 8 };

/* Standard deviations: of readings, and of what changes over a second. Doubles only. */
typedef struct hda_mpc_noise {
    double motor[HDA_N], joint[HDA_N]; /* rad, of the encoders */
    double rotor[HDA_N], link[HDA_N];  /* rad/s per sqrt(s): white accelerations of motors and joints */
    double disturbance[HDA_N];         /* N m per sqrt(s) at the motor: walk of the disturbance */
    double force[HDA_WRENCH];          /* N (in space and N m) per sqrt(s): walk of the tip force */
    double reading[HDA_WRENCH];        /* N (N m), of the force sensor */
    double observer;                   /* rad/s, of the momentum observer */
    double collision;                  /* N, departure of the observed force that is called a collision */
} hda_mpc_noise;

typedef struct hda_mpc_estimator {
    double s[HDA_MPC_SEEN]; /* x, disturbance (N m at the motors), tip force (N, in space and N m) */
    double P[HDA_MPC_SEEN * HDA_MPC_SEEN];
    double integral[HDA_N], outside[HDA_N]; /* momentum observer: its integral, joint torques from outside */
    double last[HDA_N];                     /* joint positions a tick before */
    double speed[HDA_N];                    /* filtered difference of the joint positions */
    double twist[HDA_N], twisting[HDA_N];   /* torsion a tick before, and its difference by the same filter */
    double ratio[HDA_N], damping[HDA_N];    /* of the gears */
    double known;                           /* the integral has begun */
    double innovation;                      /* squared, normalised, summed over the encoders */
} hda_mpc_estimator;

/* At rest at the measured positions, the springs bearing what they show. */
void hda_mpc_start_estimate(hda_mpc_estimator *e, const hda_measurement *m, const double *c,
                            const hda_mpc_noise *noise);

/* `periods` (at least 1) with the torques that were held, the last first, then the measurement. by_sensor: the force is
 * measured too. */
void hda_mpc_estimate(hda_mpc_estimator *e, const hda_measurement *m, const double (*torque)[HDA_N], int periods,
                      const double *c, const hda_mpc_noise *noise, double period, int by_sensor);

/* Ratios of the gears. */
void hda_mpc_read_ratios(const double *c, double *ratio);

/* The state so much later with the torque held. */
void hda_mpc_predict_state(const double *c, const double *torque, const double *disturbance, const double *force,
                           double time, double *x);

#endif
