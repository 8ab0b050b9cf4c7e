/* The extended Kalman filter: mean by the model's own step, covariance by its Jacobians.
 *
 * Legend: s = (x, d, F): state, disturbance torque at the motors, force on the tip, the last two as walks; E how many;
 * P covariance; A Jacobian of a step; h period. Readings: both encoders of a flexible joint, the joint's of a rigid
 * one, taken one by one (they are independent). The difference of the two encoders is the torsion, and with it the
 * joint torque without a sensor (the paper's (14)): the same torque, from `torque_estimate`, is what the momentum
 * observer takes as measured.
 *
 * Momentum observer: p = M v obeys p' = tau + C'v - g + J'F; outside = L (p - integral of (tau + C'v - g + outside)).
 * Sources: Simon, Optimal State Estimation (2006), 13.2; De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IROS 2006. */
#include "hda_mpc_estimate.h"

#include <math.h>
#include <string.h>

#include "hda_mpc_jacobian.h"

enum { E = HDA_MPC_SEEN, NX = HDA_NX, NU = HDA_N, AT_FORCE = NX + NU };

/* entries of x: positions and speeds of motors (of the joint where rigid) and joints */
static const int places[] = HDA_MPC_PLACES, speeds[] = HDA_MPC_SPEEDS, links[] = HDA_MPC_LINKS, turns[] = HDA_MPC_TURNS,
                 flexible[] = HDA_MPC_IS_FLEXIBLE;

static double square(double a) {
    return a * a;
}

static void fill_inputs(const double *c, const double *torque, const double *disturbance, const double *force,
                        double *u) {
    double constant[NU];
    mpc_torque_constants(c, constant);
    for (int j = 0; j < NU; j++) u[j] = (torque[j] + disturbance[j]) / constant[j];
    for (int i = 0; i < HDA_WRENCH; i++) u[NU + i] = force[i];
}

void hda_mpc_predict_state(const double *c, const double *torque, const double *disturbance, const double *force,
                           double time, double *x) {
    double u[HDA_NU], next[NX];
    const int parts = (int)(time / HDA_STEP + 0.999999);
    const double h = time / (parts > 0 ? parts : 1);
    fill_inputs(c, torque, disturbance, force, u);
    for (int part = 0; part < parts && part < 1000; part++) {
        hda_step(x, u, c, &h, next);
        memcpy(x, next, sizeof next);
    }
}

void hda_mpc_read_ratios(const double *c, double *ratio) {
    double damping[NU];
    mpc_gear(c, ratio, damping);
}

void hda_mpc_start_estimate(hda_mpc_estimator *e, const hda_measurement *m, const double *c,
                            const hda_mpc_noise *noise) {
    memset(e, 0, sizeof *e);
    mpc_gear(c, e->ratio, e->damping);
    for (int j = 0; j < NU; j++) {
        if (flexible[j]) {
            e->s[places[j]] = m->motor_position[j];
            e->P[places[j] * (E + 1)] = square(noise->motor[j]);
            e->P[speeds[j] * (E + 1)] = 1.0;
        }
        e->s[links[j]] = m->joint_position[j];
        e->P[links[j] * (E + 1)] = square(noise->joint[j]);
        e->P[turns[j] * (E + 1)] = 1e-4;
        e->P[(NX + j) * (E + 1)] = square(noise->disturbance[j]);
        e->last[j] = m->joint_position[j];
        e->twist[j] = m->motor_position[j] / e->ratio[j] - m->joint_position[j];
    }
    for (int i = 0; i < HDA_WRENCH; i++) {
        e->s[AT_FORCE + i] = m->tip_force[i];
        e->P[(AT_FORCE + i) * (E + 1)] = square(noise->force[i]);
    }
}

/* A of one period: exp(J h) to the third order; columns of d and F by the same series. */
static void transition_matrix(const hda_mpc_estimator *e, const double *torque, const double *c, double h, double *A) {
    double u[HDA_NU], by_x[NX * NX], by_u[NX * HDA_NU], constant[NU], term[NX * E], next[NX * E];
    fill_inputs(c, torque, e->s + NX, e->s + AT_FORCE, u);
    mpc_torque_constants(c, constant);
    mpc_jacobian(e->s, u, c, by_x, by_u);
    memset(A, 0, E * E * sizeof *A);
    for (int i = 0; i < E; i++) A[i * (E + 1)] = 1.0;
    for (int j = 0; j < E; j++)
        for (int i = 0; i < NX; i++)
            term[j * NX + i] = h * (j < NX         ? by_x[j * NX + i]
                                    : j < AT_FORCE ? by_u[(j - NX) * NX + i] / constant[j - NX]
                                                   : by_u[(j - NX) * NX + i]);
    for (int order = 2; order <= 4; order++) {
        for (int j = 0; j < E; j++) {
            for (int i = 0; i < NX; i++) A[j * E + i] += term[j * NX + i];
            for (int i = 0; i < NX; i++) next[j * NX + i] = 0.0;
            for (int l = 0; l < NX; l++)
                for (int i = 0; i < NX; i++) next[j * NX + i] += by_x[l * NX + i] * term[j * NX + l] * (h / order);
        }
        memcpy(term, next, sizeof term);
    }
}

static void predict_covariance(hda_mpc_estimator *e, const double *torque, const double *c, const hda_mpc_noise *noise,
                               double h) {
    double A[E * E], AP[E * E], turned[E * E];
    transition_matrix(e, torque, c, h, A);
    hda_mpc_predict_state(c, torque, e->s + NX, e->s + AT_FORCE, h, e->s);
    for (int j = 0; j < E; j++) {
        for (int i = 0; i < E; i++) AP[j * E + i] = 0.0;
        for (int l = 0; l < E; l++)
            for (int i = 0; i < E; i++) AP[j * E + i] += A[l * E + i] * e->P[j * E + l];
        for (int i = 0; i < E; i++) turned[i * E + j] = A[j * E + i];
    }
    for (int j = 0; j < E; j++) {
        for (int i = 0; i < E; i++) e->P[j * E + i] = 0.0;
        for (int l = 0; l < E; l++)
            for (int i = 0; i < E; i++) e->P[j * E + i] += AP[l * E + i] * turned[j * E + l];
    }
    for (int j = 0; j < NU; j++) {
        if (flexible[j]) e->P[speeds[j] * (E + 1)] += h * square(noise->rotor[j]);
        e->P[turns[j] * (E + 1)] += h * square(noise->link[j]);
        e->P[(NX + j) * (E + 1)] += h * square(noise->disturbance[j]);
    }
    for (int i = 0; i < HDA_WRENCH; i++) e->P[(AT_FORCE + i) * (E + 1)] += h * square(noise->force[i]);
}

/* One reading of entry `at` of s. */
static void take_reading(hda_mpc_estimator *e, int at, double reading, double deviation) {
    double column[E];
    const double wrong = reading - e->s[at];
    memcpy(column, e->P + at * E, sizeof column);
    const double spread = column[at] + square(deviation);
    e->innovation += wrong * wrong / spread;
    for (int i = 0; i < E; i++) e->s[i] += column[i] / spread * wrong;
    for (int j = 0; j < E; j++)
        for (int i = 0; i < E; i++) e->P[j * E + i] -= column[i] * column[j] / spread;
}

static void observe_momentum(hda_mpc_estimator *e, const hda_measurement *m, const double *torque, const double *c,
                             const hda_mpc_noise *noise, double h) {
    double M[NU * NU], C[NU * NU], g[NU], series[NU], other[NU], dynamic[NU], motor[NU], still[NU] = {0};
    const double share = 1.0 - 1.0 / (1.0 + 4.0 * noise->observer * h);
    for (int j = 0; j < NU; j++) {
        e->speed[j] += share * ((m->joint_position[j] - e->last[j]) / h - e->speed[j]);
        e->last[j] = m->joint_position[j];
        const double twist = m->motor_position[j] / e->ratio[j] - m->joint_position[j];
        e->twisting[j] += share * ((twist - e->twist[j]) / h - e->twisting[j]);
        e->twist[j] = twist;
        motor[j] = flexible[j] ? m->motor_position[j] : 0.0;
    }
    hda_mass_matrix(m->joint_position, c, M);
    hda_coriolis_matrix(m->joint_position, e->speed, c, C);
    hda_gravity_torque(m->joint_position, c, g);
    hda_torque_estimate(motor, m->joint_position, still, still, torque, c, series, other, dynamic);
    for (int j = 0; j < NU; j++) {
        double momentum = 0.0,
               pushed = flexible[j] ? series[j] + e->damping[j] * e->twisting[j] : torque[j] * e->ratio[j];
        for (int i = 0; i < NU; i++) {
            momentum += M[i * NU + j] * e->speed[i];
            pushed += C[j * NU + i] * e->speed[i];
        }
        if (!e->known) e->integral[j] = momentum;
        e->integral[j] += h * (pushed - g[j] + e->outside[j]);
        e->outside[j] = noise->observer * (momentum - e->integral[j]);
    }
    e->known = 1.0;
}

void hda_mpc_estimate(hda_mpc_estimator *e, const hda_measurement *m, const double (*torque)[HDA_N], int periods,
                      const double *c, const hda_mpc_noise *noise, double period, int by_sensor) {
    for (int ago = periods - 1; ago >= 0; ago--) predict_covariance(e, torque[ago], c, noise, period);
    e->innovation = 0.0;
    for (int j = 0; j < NU; j++) {
        if (flexible[j]) take_reading(e, places[j], m->motor_position[j], noise->motor[j]);
        take_reading(e, links[j], m->joint_position[j], noise->joint[j]);
    }
    const double encoders = e->innovation;
    for (int i = 0; i < HDA_WRENCH && by_sensor; i++) take_reading(e, AT_FORCE + i, m->tip_force[i], noise->reading[i]);
    e->innovation = encoders;
    for (int j = 0; j < E; j++)
        for (int i = 0; i < j; i++) e->P[j * E + i] = e->P[i * E + j] = 0.5 * (e->P[j * E + i] + e->P[i * E + j]);
    observe_momentum(e, m, torque[0], c, noise, periods * period);
}
