/* Encoders that are read late: hdagen/arm/delayed_sensors.py says what they show. */
#include "hda_model.h"

/* of x: the joints' positions and velocities */
enum { JOINT = HDA_POSITION, RATE = HDA_MECHANICAL / 2 + HDA_POSITION };

/* Rows of a log: x (rows, NX) at `time`, each on the path of its number, where rows further apart than `far` are no
 * neighbours. */
typedef struct {
    const double *x, *time;
    const int *path;
    long rows;
    double far;
} course;

static double joint_angle(const course *of, long row, int j) {
    return of->x[row * HDA_NX + JOINT + j];
}
static double joint_rate(const course *of, long row, int j) {
    return of->x[row * HDA_NX + RATE + j];
}

/* The angle of joint j at `age` before a row by its series: where no two rows of its path enclose that. */
static double angle_by_series(const course *of, long row, int j, double age) {
    const long k = row < of->rows - 1 ? row : row - 1;
    const int slopes = k >= 0 && of->path[k] == of->path[k + 1];
    const double slope =
        slopes ? (joint_rate(of, k + 1, j) - joint_rate(of, k, j)) / (of->time[k + 1] - of->time[k]) : 0.0;
    return joint_angle(of, row, j) - age * joint_rate(of, row, j) + 0.5 * age * age * slope;
}

/* The same, between two rows of its path by Hermite's cubic of angle and speed. */
static double angle_before(const course *of, long row, int j, double age) {
    const double then = of->time[row] - age;
    long k = row;
    while (k > 0 && of->time[k] > then) k--;
    while (k < of->rows - 1 && of->time[k + 1] <= then) k++;
    if (k == of->rows - 1) k--;
    if (k < 0) return angle_by_series(of, row, j, age);
    const double h = of->time[k + 1] - of->time[k], s = (then - of->time[k]) / h, left = (1.0 - s) * (1.0 - s),
                 square = s * s;
    const int enclosed =
        s >= 0.0 && s <= 1.0 && h < of->far && of->path[k] == of->path[k + 1] && of->path[k] == of->path[row];
    if (!enclosed) return angle_by_series(of, row, j, age);
    return (1.0 + 2.0 * s) * left * joint_angle(of, k, j) + s * left * h * joint_rate(of, k, j) +
           square * (3.0 - 2.0 * s) * joint_angle(of, k + 1, j) + square * (s - 1.0) * h * joint_rate(of, k + 1, j);
}

void hda_late(const double *x, const double *time, const int *path, long rows, double far, const double *age,
              double *seen) {
    const course of = {x, time, path, rows, far};
    for (long row = 0; row < rows; row++) {
        for (int j = 0; j < HDA_N; j++) {
            if (age[j] != 0.0) seen[row * HDA_N + j] += angle_before(&of, row, j, age[j]) - joint_angle(&of, row, j);
        }
    }
}
