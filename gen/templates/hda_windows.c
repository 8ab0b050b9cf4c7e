/* Rollouts of windows that each begin anew, set-valued friction: one lane, or HDA_BATCH_WIDTH lanes in those of a
 * vector.
 *
 * A lane is a simulation of all windows; of a simulation alone each lane takes a window, where the windows do not
 * depend on each other. In vectors all lanes take the plain step, in which every motor slides as it
 * began to, or rests and dry friction holds it at the beginning and at the end. Lanes of which a motor has given way,
 * stopped or turned back then search the change together, each at a time of its own; the last few of them go on alone.
 */
#include "hda_model.h"
#include "hda_parts.h"
#include "hda_sliding.h"

#include <string.h>

enum { OWN = HDA_NX - HDA_MECHANICAL }; /* the effects' own states */

static int is_allowed(const double *x, const double *limit) {
    for (int i = 0; i < HDA_NX; i++) {
        if (!(fabs(x[i]) <= limit[i])) return 0;
    }
    return 1;
}

void hda_rollout_windows(const double *begun, const double *memory, const int *edges, long windows, const double *u,
                         const double *c, const double *dt, double most, const double *jump, const double *limit,
                         double *x) {
    double now[HDA_NX] = {0.0}, path[2 * HDA_NX];
    for (long w = 0; w < windows; w++) {
        if (w && edges[2 * w - 1] != edges[2 * w]) memset(now, 0, sizeof now);
        memcpy(now, begun + w * HDA_MECHANICAL, HDA_MECHANICAL * sizeof *now);
        if (memory) memcpy(now + HDA_MECHANICAL, memory + w * OWN, OWN * sizeof *now);
        int good = 1;
        for (long k = edges[2 * w]; k < edges[2 * w + 1]; k++, x += HDA_NX) {
            for (int i = 0; i < HDA_NX; i++) x[i] = now[i] + (good && jump ? jump[k * HDA_NX + i] : 0.0);
            if (!good) continue;
            hda_rollout_exact(x, u + k * HDA_NU, c, dt + k, 1, most, path);
            good = is_allowed(path + HDA_NX, limit);
            memcpy(now, good ? path + HDA_NX : x, sizeof now);
        }
    }
}

static long count_rows_inside(const int *edges, long windows) {
    long rows = 0;
    for (long w = 0; w < windows; w++) rows += edges[2 * w + 1] - edges[2 * w];
    return rows;
}

#if HDA_LANES && !HDA_STIFF

#include "hda_batch_step.h"

enum { FEW = 1 }; /* lanes that take no longer one by one than in a vector */

static const int slide[HDA_N] = HDA_SLIDE; /* entry of x whose sign is the direction of dry friction at joint j */

/* Of each lane what it reads and writes in a window of `rows`, and its input in the present row; those from `count` on
 * have no work and read what the last one reads. */
typedef struct {
    const double *begun[HDA_BATCH_WIDTH], *memory[HDA_BATCH_WIDTH], *u[HDA_BATCH_WIDTH], *c[HDA_BATCH_WIDTH],
        *jump[HDA_BATCH_WIDTH], *dt[HDA_BATCH_WIDTH], *input[HDA_BATCH_WIDTH];
    double *x[HDA_BATCH_WIDTH];
    long rows[HDA_BATCH_WIDTH];
    int count;
} lanes;

/* b in the lanes of the mask, a in the others. */
static inline __attribute__((always_inline)) void replace_lanes(const hda_batch_bits *mask, const hda_batch *b,
                                                                hda_batch *a) {
    *a = (hda_batch)((*mask & (hda_batch_bits)*b) | (~*mask & (hda_batch_bits)*a));
}

/* hda_step_sliding of all lanes, in place, over a time and in directions of its own each. */
static __attribute__((noinline)) void slide_lanes(const hda_batch *u, const hda_batch *s, const hda_batch *c,
                                                  const hda_batch *time, hda_batch *x) {
    batch_step(x, u, s, c, time);
}

static void read_lane(const hda_batch *from, int count, int lane, double *to) {
    for (int i = 0; i < count; i++) to[i] = from[i][lane];
}

static void write_lane(const double *from, int count, int lane, hda_batch *to) {
    for (int i = 0; i < count; i++) to[i][lane] = from[i];
}

/* Lanes in which dry friction holds every motor that rests, s being 0. */
static __attribute__((noinline)) void find_held(const hda_batch *x, const hda_batch *u, const hda_batch *s,
                                                const hda_batch *c, hda_batch_bits *all) {
    hda_batch hold[HDA_N], level[HDA_N], size;
    batch_holding(x, u, s, c, hold, level);
    for (int j = 0; j < HDA_N; j++) {
        hda_batch_fabs(&hold[j], &size);
        *all &= (hda_batch_bits)(s[j] != 0.0) | (hda_batch_bits)(size <= level[j]);
    }
}

/* The set-valued step, from `from`, of the lanes in `changing` alone. Those in `tried` have slid through the whole step
 * already, to `went`. */
static __attribute__((noinline)) void change_lanes(const lanes *of, const hda_batch *from, const hda_batch *u,
                                                   const hda_batch *c, const hda_batch *h,
                                                   const hda_batch_bits *changing, const hda_batch_bits *tried,
                                                   const hda_batch *went, hda_batch *x) {
    hda_passage way[HDA_BATCH_WIDTH];
    hda_batch at[HDA_NX], s[HDA_N], span = {0};
    double next[HDA_NX];
    int open[HDA_BATCH_WIDTH], many = 0;
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        open[lane] = changing[0][lane] != 0;
        if (!open[lane]) continue;
        read_lane(from, HDA_NX, lane, next);
        hda_begin_passage(next, of->input[lane], of->c[lane], h[0][lane], &way[lane]);
        read_lane(went, HDA_NX, lane, next);
        if (tried[0][lane]) open[lane] = !hda_follow_passage(next, of->input[lane], of->c[lane], &way[lane]);
        many += open[lane];
    }
    memcpy(at, from, sizeof at);
    memset(s, 0, sizeof s);
    while (many > FEW) {
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            if (!open[lane]) continue;
            write_lane(way[lane].at, HDA_NX, lane, at);
            write_lane(way[lane].s, HDA_N, lane, s);
            span[lane] = way[lane].span;
        }
        slide_lanes(u, s, c, &span, at);
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            if (!open[lane]) continue;
            read_lane(at, HDA_NX, lane, next);
            open[lane] = !hda_follow_passage(next, of->input[lane], of->c[lane], &way[lane]);
            many -= !open[lane];
        }
    }
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        if (open[lane]) hda_end_passage(of->input[lane], of->c[lane], &way[lane]);
        if (changing[0][lane]) write_lane(way[lane].at, HDA_NX, lane, x);
    }
}

/* The set-valued step of all lanes; what becomes of those that are not `good` does not matter. */
static void step_lanes(const lanes *of, const hda_batch *u, const hda_batch *c, const hda_batch *h,
                       const hda_batch_bits *good, hda_batch *x) {
    hda_batch from[HDA_NX], s[HDA_N], went[HDA_NX];
    hda_batch_bits plain = *good, rests = {0}, tried = {0}, changing = {0};
    int many = 0, resting = 0, change = 0;
    for (int i = 0; i < HDA_NX; i++) from[i] = went[i] = x[i];
    for (int j = 0; j < HDA_N; j++) {
        hda_batch_sign(&from[slide[j]], &s[j]);
        plain &= (hda_batch_bits)(s[j] == s[j]);
        rests |= (hda_batch_bits)(s[j] == 0.0);
    }
    rests &= plain;
    for (int lane = 0; lane < of->count; lane++) resting |= (int)rests[lane];
    if (resting) find_held(x, u, s, c, &plain);
    for (int lane = 0; lane < of->count; lane++) many -= (int)plain[lane];
    if (many > FEW) {
        tried = plain;
        slide_lanes(u, s, c, h, x);
        memcpy(went, x, sizeof went);
        for (int j = 0; j < HDA_N; j++) {
            const hda_batch_bits still = (hda_batch_bits)(s[j] == 0.0);
            x[slide[j]] = (hda_batch)(~still & (hda_batch_bits)x[slide[j]]);
            plain &= ~(hda_batch_bits)(x[slide[j]] * s[j] < 0.0);
        }
        if (resting) find_held(x, u, s, c, &plain);
    } else {
        memset(&plain, 0, sizeof plain);
    }
    for (int lane = 0; lane < of->count; lane++) {
        changing[lane] = good[0][lane] & ~plain[lane];
        change |= changing[lane] != 0;
    }
    if (change) change_lanes(of, from, u, c, h, &changing, &tried, went, x);
}

/* `parts` steps of h of each lane; a lane that needs fewer than another one waits. */
static void step_parts(const lanes *of, const long *parts, const hda_batch *u, const hda_batch *c, const hda_batch *h,
                       const hda_batch_bits *good, hda_batch *x) {
    long most = 0, least = parts[0];
    for (int lane = 0; lane < of->count; lane++) {
        if (parts[lane] > most) most = parts[lane];
        if (parts[lane] < least) least = parts[lane];
    }
    for (long part = 0; part < most; part++) {
        hda_batch before[HDA_NX];
        hda_batch_bits moves = *good;
        if (part >= least) memcpy(before, x, sizeof before);
        for (int lane = 0; lane < of->count; lane++) {
            if (part >= parts[lane]) moves[lane] = 0;
        }
        step_lanes(of, u, c, h, &moves, x);
        for (int i = 0; part >= least && i < HDA_NX; i++) {
            replace_lanes(&moves, &x[i], &before[i]);
            x[i] = before[i];
        }
    }
}

/* Row k: `now` becomes x, is stored and moved to the next row; lanes that would leave the limit are good no more and
 * stay. A lane whose window has ended before does nothing. */
static void advance_row(lanes *of, long k, const hda_batch *c, double most, const double *limit, hda_batch_bits *good,
                        hda_batch *now) {
    hda_batch u[HDA_NU], x[HDA_NX], h, size;
    hda_batch_bits within;
    long parts[HDA_BATCH_WIDTH], row[HDA_BATCH_WIDTH];
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        const int has_ended = k >= of->rows[lane];
        row[lane] = has_ended ? of->rows[lane] - 1 : k;
        of->input[lane] = of->u[lane] + row[lane] * HDA_NU;
        parts[lane] = has_ended ? 0 : hda_parts(of->dt[lane][row[lane]], most);
        h[lane] = has_ended ? 0.0 : of->dt[lane][row[lane]] / (double)parts[lane];
        if (has_ended) good[0][lane] = 0;
    }
    within = *good;
#define INPUT(lane) of->input[lane][i]
#define JUMP(lane) of->jump[lane][row[lane] * HDA_NX + i]
    for (int i = 0; i < HDA_NU; i++) u[i] = (hda_batch)HDA_BATCH_OF(INPUT);
    for (int i = 0; of->jump[0] && i < HDA_NX; i++) {
        const hda_batch jump = HDA_BATCH_OF(JUMP);
        now[i] += (hda_batch)(*good & (hda_batch_bits)jump);
    }
#undef INPUT
#undef JUMP
    for (int lane = 0; lane < of->count; lane++) {
        if (k >= of->rows[lane]) continue;
        for (int i = 0; i < HDA_NX; i++) of->x[lane][i] = now[i][lane];
        of->x[lane] += HDA_NX;
    }
    memcpy(x, now, sizeof x);
    step_parts(of, parts, u, c, &h, good, x);
    for (int i = 0; i < HDA_NX; i++) {
        hda_batch_fabs(&x[i], &size);
        within &= (hda_batch_bits)(size <= limit[i]);
    }
    for (int i = 0; i < HDA_NX; i++) replace_lanes(&within, &x[i], &now[i]);
    *good = within;
}

/* A window of each lane; where `memory` is NULL, the effects' own states begin as `now` has them. */
static void roll_window(lanes *of, const hda_batch *c, double most, const double *limit, hda_batch *now) {
    hda_batch_bits good = {0};
    long longest = 0;
    for (int lane = 0; lane < of->count; lane++) {
        good[lane] = -1;
        if (of->rows[lane] > longest) longest = of->rows[lane];
    }
#define BEGUN(lane) of->begun[lane][i]
#define MEMORY(lane) of->memory[lane][i - HDA_MECHANICAL]
    for (int i = 0; i < HDA_MECHANICAL; i++) now[i] = (hda_batch)HDA_BATCH_OF(BEGUN);
    for (int i = HDA_MECHANICAL; of->memory[0] && i < HDA_NX; i++) now[i] = (hda_batch)HDA_BATCH_OF(MEMORY);
#undef BEGUN
#undef MEMORY
    for (long k = 0; k < longest; k++) advance_row(of, k, c, most, limit, &good, now);
}

/* All windows of a simulation a lane. */
static void roll_simulations(lanes *of, const double *const *u, const double *const *jump, const int *edges,
                             long windows, const double *dt, double most, const double *limit) {
    hda_batch c[HDA_NC], now[HDA_NX];
#define CONSTANT(lane) of->c[lane][i]
    for (int i = 0; i < HDA_NC; i++) c[i] = (hda_batch)HDA_BATCH_OF(CONSTANT);
#undef CONSTANT
    memset(now, 0, sizeof now);
    for (long w = 0; w < windows; w++) {
        if (w && edges[2 * w - 1] != edges[2 * w]) memset(now, 0, sizeof now);
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            of->u[lane] = u[lane] + edges[2 * w] * HDA_NU;
            of->jump[lane] = jump[lane] ? jump[lane] + edges[2 * w] * HDA_NX : NULL;
            of->dt[lane] = dt + edges[2 * w];
            of->rows[lane] = edges[2 * w + 1] - edges[2 * w];
        }
        roll_window(of, c, most, limit, now);
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            of->begun[lane] += HDA_MECHANICAL;
            if (of->memory[lane]) of->memory[lane] += OWN;
        }
    }
}

static int has_empty_window(const int *edges, long windows) {
    for (long w = 0; w < windows; w++) {
        if (edges[2 * w + 1] <= edges[2 * w]) return 1;
    }
    return 0;
}

/* hda_rollout_windows of windows none of which is empty and each of which has its memory, a window a lane. */
static void roll_windows_side_by_side(const double *begun, const double *memory, const int *edges, long windows,
                                      const double *u, const double *c, const double *dt, double most,
                                      const double *jump, const double *limit, double *x) {
    hda_batch constants[HDA_NC], now[HDA_NX];
    for (int i = 0; i < HDA_NC; i++) constants[i] = (hda_batch){0} + c[i];
    for (long first = 0; first < windows; first += HDA_BATCH_WIDTH) {
        lanes of;
        of.count = windows - first < HDA_BATCH_WIDTH ? (int)(windows - first) : HDA_BATCH_WIDTH;
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            const long w = first + (lane < of.count ? lane : of.count - 1), row = edges[2 * w];
            of.begun[lane] = begun + w * HDA_MECHANICAL;
            of.memory[lane] = memory + w * OWN;
            of.u[lane] = u + row * HDA_NU;
            of.c[lane] = c;
            of.jump[lane] = jump ? jump + row * HDA_NX : NULL;
            of.dt[lane] = dt + row;
            of.rows[lane] = edges[2 * w + 1] - row;
            of.x[lane] = x;
            if (lane < of.count) x += of.rows[lane] * HDA_NX;
        }
        roll_window(&of, constants, most, limit, now);
    }
}

/* The steps of at most HDA_BATCH_WIDTH states. */
static void step_vector(double (*x)[HDA_NX], const double (*u)[HDA_NU], const double *c, double h, long steps,
                        int count) {
    hda_batch constants[HDA_NC], in[HDA_NU], at[HDA_NX];
    hda_batch_bits good = {0};
    const hda_batch time = (hda_batch){0} + h;
    lanes of;
    memset(&of, 0, sizeof of);
    of.count = count;
#define LAST(lane) ((lane) < count ? (lane) : count - 1)
#define INPUT(lane) u[LAST(lane)][i]
#define STATE(lane) x[LAST(lane)][i]
    for (int i = 0; i < HDA_NC; i++) constants[i] = (hda_batch){0} + c[i];
    for (int i = 0; i < HDA_NU; i++) in[i] = (hda_batch)HDA_BATCH_OF(INPUT);
    for (int i = 0; i < HDA_NX; i++) at[i] = (hda_batch)HDA_BATCH_OF(STATE);
    for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
        of.input[lane] = u[LAST(lane)];
        of.c[lane] = c;
    }
#undef LAST
#undef INPUT
#undef STATE
    for (int lane = 0; lane < count; lane++) good[lane] = -1;
    for (long step = 0; step < steps; step++) step_lanes(&of, in, constants, &time, &good, at);
    for (int lane = 0; lane < count; lane++) read_lane(at, HDA_NX, lane, x[lane]);
}

#endif

void hda_step_side_by_side(double (*x)[HDA_NX], const double (*u)[HDA_NU], const double *c, double h, long steps,
                           int count) {
    int first = 0;
#if HDA_LANES && !HDA_STIFF
    for (; count - first > FEW; first += HDA_BATCH_WIDTH) {
        const int own = count - first < HDA_BATCH_WIDTH ? count - first : HDA_BATCH_WIDTH;
        step_vector(x + first, u + first, c, h, steps, own);
    }
#endif
    for (; first < count; first++) {
        for (long step = 0; step < steps; step++) hda_step_exact(x[first], u[first], c, &h, x[first]);
    }
}

void hda_rollout_windows_batch(const double *begun, const double *memory, const int *edges, long windows,
                               const double *u, const double *c, const double *dt, long rows, double most,
                               const double *jump, const double *limit, long count, double *x) {
    const long mechanical = windows * HDA_MECHANICAL, own = windows * OWN,
               size = count_rows_inside(edges, windows) * HDA_NX;
    long first = 0;
#if HDA_LANES && !HDA_STIFF
    while (count - first > FEW) {
        const double *inputs[HDA_BATCH_WIDTH], *jumps[HDA_BATCH_WIDTH];
        lanes of;
        of.count = count - first < HDA_BATCH_WIDTH ? (int)(count - first) : HDA_BATCH_WIDTH;
        for (int lane = 0; lane < HDA_BATCH_WIDTH; lane++) {
            const long which = first + (lane < of.count ? lane : of.count - 1);
            inputs[lane] = u + which * rows * HDA_NU;
            jumps[lane] = jump ? jump + which * rows * HDA_NX : NULL;
            of.begun[lane] = begun + which * mechanical;
            of.memory[lane] = memory ? memory + which * own : NULL;
            of.c[lane] = c + which * HDA_NC;
            of.x[lane] = x + which * size;
        }
        roll_simulations(&of, inputs, jumps, edges, windows, dt, most, limit);
        first += of.count;
    }
    const int independent = memory && windows > FEW && !has_empty_window(edges, windows);
    for (; first < count && independent; first++) {
        roll_windows_side_by_side(begun + first * mechanical, memory + first * own, edges, windows,
                                  u + first * rows * HDA_NU, c + first * HDA_NC, dt, most,
                                  jump ? jump + first * rows * HDA_NX : NULL, limit, x + first * size);
    }
#endif
    for (; first < count; first++) {
        hda_rollout_windows(begun + first * mechanical, memory ? memory + first * own : NULL, edges, windows,
                            u + first * rows * HDA_NU, c + first * HDA_NC, dt, most,
                            jump ? jump + first * rows * HDA_NX : NULL, limit, x + first * size);
    }
}
