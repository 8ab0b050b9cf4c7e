/* Steps the arm from rest with a fifth of the largest input at every joint and prints where the tip goes. */
#include "hda.h"

#include <stdio.h>

int main(void) {
    static const double p[HDA_NP] = HDA_NOMINAL, most[HDA_NU] = HDA_INPUT_BOUND;
    double c[HDA_NC], x[HDA_NX] = {0}, u[HDA_NU] = {0}, points[HDA_TIP * (HDA_N + 1)];
    const double h = HDA_STEP;
    hda_prepare(p, c);
    for (int j = 0; j < HDA_N; j++) u[j] = (j % 2 ? -0.2 : 0.2) * most[j];
    for (int k = 0; k <= 1000; k++) {
        if (k % 200 == 0) {
            hda_points(x + HDA_POSITION, c, points);
            printf("%.3f s  tip %+.6f %+.6f m\n", k * h, points[HDA_TIP * HDA_N], points[HDA_TIP * HDA_N + 1]);
        }
        hda_step_exact(x, u, c, &h, x);
    }
    return 0;
}
