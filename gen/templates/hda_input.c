/* The stage before the mechanics: delay, limits and lag of the current.
 *
 * Legend: u command, i(u) what limits and sag let through of it, d delay, T time constant of the lag, h row, s; w mean
 * over the row of i(u(t - d)); y what acts: i(u(t - d)) without a lag, else T dy/dt = i(u(t - d)) - y. Nothing here
 * allocates; every loop is bounded.
 */
#include "hda_model.h"

#include <math.h>

#define WHOLE (1.0 - 1e-6) /* of a row: as much of it is all of it */

void hda_input_reset(hda_input_state *state, const double *before, const double *c) {
    double delay[HDA_N], lag[HDA_N];
    hda_input_law(before, c, state->acting, delay, lag);
    for (int j = 0; j < HDA_N; j++) state->current[0][j] = state->acting[j];
    state->length[0] = INFINITY;
    state->newest = 0;
    state->count = 1;
}

/* Of joint j's current, `delay` s late, over the newest row: its mean, and what acts at the row's end, each row's part
 * of it through the lag, exactly, so that a lag which vanishes leaves the delay alone. The oldest row is taken to begin
 * before all time. */
static void apply_delay_and_lag(const hda_input_state *state, int j, double delay, double lag, double *mean,
                                double *acts) {
    const double h = state->length[state->newest];
    double begin = delay, end = delay + h; /* of the row that is looked at, after the delay */
    long row = state->newest;
    *mean = 0.0;
    *acts = lag > 0.0 ? state->acting[j] * exp(-h / lag) : 0.0;
    for (long back = 1; back <= state->count; back++) {
        const double from = back < state->count && begin > 0.0 ? begin : 0.0, to = end < h ? end : h;
        if (to > from) *mean += (to - from) / h * state->current[row][j];
        if (to > from && lag > 0.0) *acts += (exp((to - h) / lag) - exp((from - h) / lag)) * state->current[row][j];
        if (!(begin > 0.0)) break;
        row = row ? row - 1 : HDA_INPUT_ROWS - 1;
        end = begin;
        begin -= state->length[row];
    }
}

/* Joint j's current, `delay` s late, at the end of the newest row; a delay of whole rows is one though rounding splits
 * them: what arrives at that end does not act yet. */
static double delayed_current(const hda_input_state *state, int j, double delay) {
    const double h = WHOLE * state->length[state->newest];
    double begin = delay; /* of the row that is looked at, after the delay */
    long row = state->newest;
    for (long back = 1; back < state->count && begin >= h; back++) {
        row = row ? row - 1 : HDA_INPUT_ROWS - 1;
        begin -= state->length[row];
    }
    return state->current[row][j];
}

void hda_input_step(hda_input_state *state, const double *command, const double *c, double h, double *mean,
                    double *at_end) {
    double delay[HDA_N], lag[HDA_N], through[HDA_N];
    hda_input_law(command, c, through, delay, lag);
    state->newest = state->newest + 1 < HDA_INPUT_ROWS ? state->newest + 1 : 0;
    if (state->count < HDA_INPUT_ROWS) state->count++;
    state->length[state->newest] = h;
    for (int j = 0; j < HDA_N; j++) state->current[state->newest][j] = through[j];
    for (int j = 0; j < HDA_N; j++) {
        const double d = delay[j] > 0.0 ? delay[j] : 0.0;
        mean[j] = at_end[j] = through[j];
        if (d > 0.0 || lag[j] > 0.0) {
            apply_delay_and_lag(state, j, d, lag[j], &mean[j], &at_end[j]);
            if (lag[j] > 0.0)
                mean[j] += (state->acting[j] - at_end[j]) * lag[j] / h;
            else
                at_end[j] = delayed_current(state, j, d);
        }
        state->acting[j] = at_end[j];
    }
}
