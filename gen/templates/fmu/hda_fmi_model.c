/* The arm as a unit for co-simulation: what a simulation of hdagen does with a command that is held for a row. */
#include "hda_fmi.h"
#include "hda_parts.h"

#include <math.h>
#include <string.h>

static const double start_parameters[HDA_NP] = HDA_FMI_PARAMETERS, low[HDA_NP] = HDA_FMI_LOW,
                    high[HDA_NP] = HDA_FMI_HIGH, start_positions[HDA_N] = HDA_FMI_POSITIONS;
static const int is_fixed[HDA_NP] = HDA_FMI_FIXED;
static const struct {
    int joint, ratio, motor;   /* number of the joint from 0; where its ratio stands in p, its motor's angle in x */
} springs[] = HDA_FMI_SPRINGS; /* ends with joint -1 */

static const double most_parts = 1e6; /* of a step: more would be no simulation */

void hda_fmi_reset(hda_fmi_model *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->p, start_parameters, sizeof m->p);
    memcpy(m->start, start_positions, sizeof m->start);
    m->longest_step = HDA_FMI_STEP;
    m->stale = 1;
}

/* Angles of the motors at which each spring bears what gravity asks; again for angles that effects add to the
 * torsion. */
static void wind_springs(hda_fmi_model *m) {
    const double none[HDA_NU] = {0};
    double load[HDA_N], twist[HDA_N];
    hda_gravity_torque(m->start, m->c, load);
    hda_torsion(load, m->c, twist);
    for (int round = 0; round < 4; round++) {
        for (int k = 0; springs[k].joint >= 0; k++) {
            double *y = m->reading;
            hda_outputs(m->x, none, m->c, HDA_FMI_OUTPUTS(y));
            const double off = y[HDA_FMI_TORSION + springs[k].joint] - twist[springs[k].joint];
            if (fabs(off) > 1e-12) m->x[springs[k].motor] -= off * m->p[springs[k].ratio];
        }
    }
}

/* At rest in the joints' start positions, no input commanded before. */
static void begin_at_rest(hda_fmi_model *m) {
    const double none[HDA_N] = {0};
    memset(m->x, 0, sizeof m->x);
    memcpy(m->x + HDA_POSITION, m->start, sizeof m->start);
    wind_springs(m);
    hda_input_reset(&m->input, none, m->c);
    memcpy(m->acting, m->input.acting, sizeof m->acting);
}

static void refresh(hda_fmi_model *m) {
    double u[HDA_NU];
    if (!m->stale) return;
    hda_prepare(m->p, m->c);
    if (m->phase <= HDA_FMI_INITIALIZING) begin_at_rest(m);
    memcpy(u, m->command, sizeof u);
    memcpy(u, m->acting, sizeof m->acting);
    double *y = m->reading;
    hda_outputs(m->x, u, m->c, HDA_FMI_OUTPUTS(y));
    m->stale = 0;
}

hda_fmi_outcome hda_fmi_get(hda_fmi_model *m, uint32_t variable, double *value) {
    if (variable >= HDA_FMI_END) return HDA_FMI_UNKNOWN;
    if (variable >= HDA_FMI_ACTING) refresh(m);
    *value = variable >= HDA_FMI_READING        ? m->reading[variable - HDA_FMI_READING]
             : variable >= HDA_FMI_ACTING       ? m->acting[variable - HDA_FMI_ACTING]
             : variable == HDA_FMI_LONGEST_STEP ? m->longest_step
             : variable >= HDA_FMI_START        ? m->start[variable - HDA_FMI_START]
             : variable >= HDA_FMI_PARAMETER    ? m->p[variable - HDA_FMI_PARAMETER]
             : variable >= HDA_FMI_INPUT        ? m->command[variable - HDA_FMI_INPUT]
                                                : m->time;
    return HDA_FMI_FINE;
}

static hda_fmi_outcome set_parameter(hda_fmi_model *m, uint32_t k, double value) {
    if (is_fixed[k] && m->phase > HDA_FMI_INITIALIZING) return HDA_FMI_FIXED_NOW;
    if (value < low[k] || value > high[k]) return HDA_FMI_OUT_OF_BOUNDS;
    m->p[k] = value;
    m->stale = 1;
    return HDA_FMI_FINE;
}

hda_fmi_outcome hda_fmi_set(hda_fmi_model *m, uint32_t variable, double value) {
    if (variable >= HDA_FMI_END) return HDA_FMI_UNKNOWN;
    if (variable < HDA_FMI_INPUT || variable >= HDA_FMI_ACTING) return HDA_FMI_READ_ONLY;
    if (!isfinite(value)) return HDA_FMI_NOT_FINITE;
    if (variable >= HDA_FMI_PARAMETER && variable < HDA_FMI_START)
        return set_parameter(m, variable - HDA_FMI_PARAMETER, value);
    if (variable == HDA_FMI_LONGEST_STEP && !(value > 0.0)) return HDA_FMI_OUT_OF_BOUNDS;
    if (variable >= HDA_FMI_START && variable < HDA_FMI_LONGEST_STEP && m->phase > HDA_FMI_INITIALIZING)
        return HDA_FMI_FIXED_NOW;
    if (variable == HDA_FMI_LONGEST_STEP)
        m->longest_step = value;
    else if (variable >= HDA_FMI_START)
        m->start[variable - HDA_FMI_START] = value;
    else
        m->command[variable - HDA_FMI_INPUT] = value;
    m->stale = 1;
    return HDA_FMI_FINE;
}

hda_fmi_outcome hda_fmi_enter(hda_fmi_model *m, hda_fmi_phase phase) {
    if (phase != HDA_FMI_ENDED && (int32_t)phase != m->phase + 1) return HDA_FMI_PHASE;
    if (phase == HDA_FMI_RUNNING) refresh(m);
    m->phase = (int32_t)phase;
    return HDA_FMI_FINE;
}

hda_fmi_outcome hda_fmi_step(hda_fmi_model *m, double now, double h) {
    if (m->phase != HDA_FMI_RUNNING) return HDA_FMI_PHASE;
    if (!(h > 0.0) || !(h < most_parts * m->longest_step)) return HDA_FMI_STEP_SIZE;
    const long parts = hda_parts(h, m->longest_step);
    const double part = h / (double)parts;
    double u[HDA_NU], x[HDA_NX];
    refresh(m); /* the constants, where a parameter was tuned */
    memcpy(u, m->command, sizeof u);
    memcpy(x, m->x, sizeof x);
    hda_input_step(&m->input, m->command, m->c, h, u, m->acting);
    for (long k = 0; k < parts; k++) hda_step_exact(x, u, m->c, &part, x);
    for (int i = 0; i < HDA_NX; i++) {
        if (!isfinite(x[i])) m->phase = HDA_FMI_ENDED;
    }
    if (m->phase == HDA_FMI_ENDED) return HDA_FMI_DIVERGED;
    memcpy(m->x, x, sizeof x);
    m->time = now + h;
    m->stale = 1;
    return HDA_FMI_FINE;
}

static const char mark[] = HDA_FMI_TOKEN; /* begins the bytes of a state */

size_t hda_fmi_state_size(void) {
    return sizeof mark + sizeof(hda_fmi_model);
}

void hda_fmi_write_state(const hda_fmi_model *m, uint8_t *bytes) {
    memcpy(bytes, mark, sizeof mark);
    memcpy(bytes + sizeof mark, m, sizeof *m);
}

/* Whether the numbers by which a state is addressed are within what they address. */
static int is_whole(const hda_fmi_model *m) {
    return m->phase >= HDA_FMI_SETTING && m->phase <= HDA_FMI_ENDED && m->longest_step > 0.0 && m->input.newest >= 0 &&
           m->input.newest < HDA_INPUT_ROWS && m->input.count >= 0 && m->input.count <= HDA_INPUT_ROWS;
}

hda_fmi_outcome hda_fmi_read_state(const uint8_t *bytes, size_t count, hda_fmi_model *m) {
    hda_fmi_model found;
    if (count != hda_fmi_state_size() || memcmp(bytes, mark, sizeof mark)) return HDA_FMI_FOREIGN_STATE;
    memcpy(&found, bytes + sizeof mark, sizeof found);
    if (!is_whole(&found)) return HDA_FMI_FOREIGN_STATE;
    *m = found;
    return HDA_FMI_FINE;
}

const char *hda_fmi_sentence(hda_fmi_outcome outcome) {
    static const char *const sentences[HDA_FMI_OUTCOMES] = {
        "done.",
        "no variable has this value reference; modelDescription.xml lists them.",
        "time and outputs cannot be set.",
        "a fixed parameter can be set only before the initialization ends; reset the unit first.",
        "the value is NaN or infinite; give a finite one.",
        "the value is out of the bounds that modelDescription.xml states.",
        "the call does not belong to this phase; initialize, step, then terminate.",
        "the communication step must be positive, and no longer than a million steps of the integration.",
        "the state has become NaN or infinite; give smaller inputs, or a smaller longest_step.",
        "the bytes are no state of this unit; serialize one of the same file.",
        "the unit does not have what this function is for, as its modelDescription.xml says."};
    return outcome >= 0 && outcome < HDA_FMI_OUTCOMES ? sentences[outcome] : "unknown.";
}
