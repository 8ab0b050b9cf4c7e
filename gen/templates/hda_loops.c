/* Closed loops in lanes; see hda_loops.h. Nothing here allocates; every loop is bounded. */
#include "hda_loops.h"

#include <math.h>
#include <string.h>

#if HDA_LANES && !HDA_STIFF

#include "hda_loops_laws.h"

enum { WIDTH = HDA_BATCH_WIDTH };

static int prepare_law(const hda_loops *loops, const double *gains, double *k) {
    loops_laws[loops->law].prepare(gains, k);
    return loops_laws[loops->law].prepared;
}

#define LOAD(to, from, count) \
    for (int i = 0; i < (count); i++) memcpy(&(to)[i], (from)[i], sizeof(hda_batch))
#define STORE(from, to, count) \
    for (int i = 0; i < (count); i++) memcpy((to)[i], &(from)[i], sizeof(hda_batch))

static void read_sensors(const hda_loops *loops, const double *c, double seen[][HDA_LOOPS_WIDEST],
                         double tip[][HDA_LOOPS_WIDEST]) {
    hda_batch x[HDA_NX], u[HDA_NU], theta[HDA_N], q[HDA_N], at[HDA_TIP];
    memset(u, 0, sizeof u);
    LOAD(x, loops->x, HDA_NX);
    loops_sensed(x, u, c, theta, q, at);
    STORE(theta, seen, HDA_N);
    STORE(q, seen + HDA_N, HDA_N);
    STORE(at, tip, HDA_TIP);
}

static void run_controller(hda_loops *loops, double measured[][HDA_LOOPS_WIDEST], const double *reference,
                           const double *known, double raw[][HDA_LOOPS_WIDEST], double later[][HDA_LOOPS_WIDEST]) {
    hda_batch m[2 * HDA_N + HDA_WRENCH], sent[HDA_N], gains[HDA_GAINS_MOST], k[LOOPS_PREPARED], state[HDA_MEMORY_MOST],
        torque[HDA_N], next[HDA_MEMORY_MOST];
    memset(next, 0, sizeof next);
    LOAD(m, measured, 2 * HDA_N + HDA_WRENCH);
    LOAD(sent, loops->sent, HDA_N);
    LOAD(gains, loops->gains, HDA_GAINS_MOST);
    LOAD(k, loops->prepared, LOOPS_PREPARED);
    LOAD(state, loops->state, HDA_MEMORY_MOST);
    loops_laws[loops->law].tick(m, sent, reference, gains, k, known, state, torque, next);
    STORE(torque, raw, HDA_N);
    STORE(next, later, HDA_MEMORY_MOST);
}

/* RK4 of all lanes, the input held. */
static void step_lanes(hda_loops *loops, double input[][HDA_LOOPS_WIDEST], const double *push, const double *c,
                       double h, long steps) {
    hda_batch x[HDA_NX], u[HDA_NU], k[HDA_NX], y[HDA_NX], from[HDA_NX];
    const double reach[4] = {0.5 * h, 0.5 * h, h, 0.0}, weight[4] = {h / 6.0, h / 3.0, h / 3.0, h / 6.0};
    LOAD(x, loops->x, HDA_NX);
    LOAD(u, input, HDA_N);
    for (int i = 0; i < HDA_WRENCH; i++) u[HDA_N + i] = push[i] - (hda_batch){0};
    for (long step = 0; step < steps; step++) {
        memcpy(from, x, sizeof from);
        for (int stage = 0; stage < 4; stage++) {
            loops_rhs(stage ? y : from, u, c, k);
            for (int i = 0; i < HDA_NX; i++) {
                y[i] = from[i] + reach[stage] * k[i];
                x[i] += weight[stage] * k[i];
            }
        }
    }
    STORE(x, loops->x, HDA_NX);
}

#else

enum { WIDTH = 1 };

#define COLUMN(to, from, count) \
    for (int i = 0; i < (count); i++) (to)[i] = (from)[i][0]
#define BACK(from, to, count) \
    for (int i = 0; i < (count); i++) (to)[i][0] = (from)[i]

typedef void scalar_tick(const double *, const double *, const double *, const double *, const double *, const double *,
                         double *, double *);
#define TICK(name, gains, reference, memory) hda_##name##_tick,
static scalar_tick *const ticks[] = {HDA_LAW_LIST(TICK)};

static int prepare_law(const hda_loops *loops, const double *gains, double *k) {
    (void)loops;
    (void)gains;
    (void)k;
    return 0;
}

static void read_sensors(const hda_loops *loops, const double *c, double seen[][HDA_LOOPS_WIDEST],
                         double tip[][HDA_LOOPS_WIDEST]) {
    double x[HDA_NX], u[HDA_NU] = {0.0}, theta[HDA_N], q[HDA_N], at[HDA_TIP], side[6][HDA_N], speed[HDA_WRENCH];
    COLUMN(x, loops->x, HDA_NX);
    hda_outputs(x, u, c, theta, side[0], side[1], side[2], side[3], q, side[4], side[5], at, speed);
    BACK(theta, seen, HDA_N);
    BACK(q, seen + HDA_N, HDA_N);
    BACK(at, tip, HDA_TIP);
}

static void run_controller(hda_loops *loops, double measured[][HDA_LOOPS_WIDEST], const double *reference,
                           const double *known, double raw[][HDA_LOOPS_WIDEST], double later[][HDA_LOOPS_WIDEST]) {
    double m[2 * HDA_N + HDA_WRENCH], sent[HDA_N], gains[HDA_GAINS_MOST], state[HDA_MEMORY_MOST], torque[HDA_N],
        next[HDA_MEMORY_MOST] = {0.0};
    COLUMN(m, measured, 2 * HDA_N + HDA_WRENCH);
    COLUMN(sent, loops->sent, HDA_N);
    COLUMN(gains, loops->gains, HDA_GAINS_MOST);
    COLUMN(state, loops->state, HDA_MEMORY_MOST);
    ticks[loops->law](m, sent, reference, gains, known, state, torque, next);
    BACK(torque, raw, HDA_N);
    BACK(next, later, HDA_MEMORY_MOST);
}

static void step_lanes(hda_loops *loops, double input[][HDA_LOOPS_WIDEST], const double *push, const double *c,
                       double h, long steps) {
    double x[HDA_NX], u[HDA_NU];
    COLUMN(x, loops->x, HDA_NX);
    COLUMN(u, input, HDA_N);
    for (int i = 0; i < HDA_WRENCH; i++) u[HDA_N + i] = push[i];
    for (long step = 0; step < steps; step++) hda_step(x, u, c, &h, x);
    BACK(x, loops->x, HDA_NX);
}

#endif

typedef void starter(const double *, const double *, const double *, double *);
#define START(name, gains, reference, memory) hda_##name##_start,
static starter *const starters[] = {HDA_LAW_LIST(START)};
#define COUNT(name, gains, reference, memory) gains,
static const int gain_counts[] = {HDA_LAW_LIST(COUNT)};

enum { LAWS = sizeof starters / sizeof *starters, MOST_STEPS = 1000 };

int hda_loops_width(void) {
    return WIDTH;
}

int hda_loops_begin(hda_loops *loops, int law, const double *x0, const double *gains, const double *settings,
                    const double *c) {
    const double zero[HDA_N] = {0.0};
    if (law < 0 || law >= LAWS || !(settings[1] >= 1.0 && settings[1] <= MOST_STEPS) ||
        !(settings[2] >= 0.0 && settings[2] <= HDA_LOOPS_LATE)) {
        return -1;
    }
    memset(loops, 0, sizeof *loops);
    loops->law = law;
    memcpy(loops->settings, settings, sizeof loops->settings);
    for (int lane = 0; lane < WIDTH; lane++) {
        double k[512] = {0.0};
        const double *own = gains + lane * HDA_GAINS_MOST;
        const int prepared = prepare_law(loops, own, k);
        for (int i = 0; i < gain_counts[law]; i++) loops->gains[i][lane] = own[i];
        for (int i = 0; i < prepared; i++) loops->prepared[i][lane] = k[i];
        for (int i = 0; i < HDA_NX; i++) loops->x[i][lane] = x0[i];
        hda_input_reset(&loops->input[lane], zero, c);
    }
    return 0;
}

/* Adding 1.5 · 2^52 rounds to the nearest whole number, halves to the even one. */
static double read_out(double value, double resolution) {
    if (!(resolution > 0.0)) return value;
    const double shifted = value / resolution + 6755399441055744.0;
    return (shifted - 6755399441055744.0) * resolution;
}

/* The law's memory at its first tick, lane by lane. */
static void start_memory(hda_loops *loops, double measured[][HDA_LOOPS_WIDEST], const double *reference,
                         const double *known) {
    double m[2 * HDA_N + HDA_WRENCH], state[HDA_MEMORY_MOST] = {0.0};
    for (int lane = 0; lane < WIDTH; lane++) {
        for (int i = 0; i < 2 * HDA_N + HDA_WRENCH; i++) m[i] = measured[i][lane];
        starters[loops->law](m, reference, known, state);
        for (int i = 0; i < HDA_MEMORY_MOST; i++) loops->state[i][lane] = state[i];
    }
}

/* Size and rate, as the guard limits a vector without a limit of force; then the input stage. */
static void send_torques(hda_loops *loops, double raw[][HDA_LOOPS_WIDEST], double later[][HDA_LOOPS_WIDEST],
                         const double *c, double input[][HDA_LOOPS_WIDEST]) {
    const double *s = loops->settings, *limit = s + 3 + 2 * HDA_N, *rate = limit + HDA_N, *constant = rate + HDA_N;
    const double elapsed = loops->ticks ? s[0] : 0.5 * s[0]; /* the guard's first tick counts as its shortest period */
    for (int lane = 0; lane < WIDTH; lane++) {
        double command[HDA_N], mean[HDA_N], at_end[HDA_N];
        int finite = 1;
        for (int j = 0; j < HDA_N; j++) finite &= hda_finite(raw[j][lane]);
        for (int j = 0; j < HDA_N; j++) {
            const double last = loops->sent[j][lane];
            loops->sent[j][lane] = hda_limit(finite ? raw[j][lane] : last, last, limit[j], rate[j] * elapsed);
            command[j] = loops->sent[j][lane] / constant[j];
        }
        if (finite) {
            for (int i = 0; i < HDA_MEMORY_MOST; i++) loops->state[i][lane] = later[i][lane];
        }
        hda_input_step(&loops->input[lane], command, c, s[0], mean, at_end);
        for (int j = 0; j < HDA_N; j++) input[j][lane] = mean[j];
    }
}

void hda_loops_tick(hda_loops *loops, const double *reference, const double *push, const double *felt,
                    const double *noise, const double *c, const double *known, double *tip, double *sent) {
    /* gcc loses sight of what fills it where a vector has four lanes */
    double seen[2 * HDA_N][HDA_LOOPS_WIDEST] = {{0.0}};
    double at[HDA_TIP][HDA_LOOPS_WIDEST], measured[2 * HDA_N + HDA_WRENCH][HDA_LOOPS_WIDEST];
    double raw[HDA_N][HDA_LOOPS_WIDEST], later[HDA_MEMORY_MOST][HDA_LOOPS_WIDEST], input[HDA_N][HDA_LOOPS_WIDEST];
    const double *s = loops->settings;
    const long now = loops->ticks % (HDA_LOOPS_LATE + 1), delay = (long)s[2];
    const long late = loops->ticks < delay ? 0 : (loops->ticks - delay) % (HDA_LOOPS_LATE + 1);
    read_sensors(loops, c, seen, at);
    for (int i = 0; i < 2 * HDA_N; i++) {
        for (int lane = 0; lane < WIDTH; lane++)
            loops->seen[now][i][lane] = read_out(seen[i][lane] + noise[i], s[3 + i]);
    }
    for (int i = 0; i < HDA_WRENCH; i++) loops->felt[now][i] = felt[i];
    for (int lane = 0; lane < WIDTH; lane++) {
        for (int i = 0; i < 2 * HDA_N; i++) measured[i][lane] = loops->seen[late][i][lane];
        for (int i = 0; i < HDA_WRENCH; i++) measured[2 * HDA_N + i][lane] = loops->felt[late][i];
    }
    if (!loops->ticks) start_memory(loops, measured, reference, known);
    run_controller(loops, measured, reference, known, raw, later);
    send_torques(loops, raw, later, c, input);
    for (int lane = 0; lane < WIDTH; lane++) {
        for (int i = 0; i < HDA_TIP; i++) tip[lane * HDA_TIP + i] = at[i][lane];
        for (int j = 0; j < HDA_N; j++) sent[lane * HDA_N + j] = loops->sent[j][lane];
    }
    step_lanes(loops, input, push, c, s[0] / s[1], (long)s[1]);
    loops->ticks++;
}
