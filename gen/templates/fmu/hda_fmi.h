/* The arm as a unit for co-simulation, apart from any version of the interface: variables by number, start, steps.
 *
 * hda_fmi_table.h is made with each unit: the values at which its parameters start, their bounds and names.
 * Variables by number: time; inputs (HDA_NU); parameters (HDA_NP); joint positions at the start (HDA_N); longest step
 * of the integration; motor inputs that act (HDA_N); readings of the sensors (HDA_FMI_READINGS). */
#ifndef HDA_FMI_H
#define HDA_FMI_H

#include "hda.h"
#include "hda_fmi_table.h"

#include <stddef.h>
#include <stdint.h>

enum {
    HDA_FMI_INPUT = 1,
    HDA_FMI_PARAMETER = HDA_FMI_INPUT + HDA_NU,
    HDA_FMI_START = HDA_FMI_PARAMETER + HDA_NP,
    HDA_FMI_LONGEST_STEP = HDA_FMI_START + HDA_N,
    HDA_FMI_ACTING,
    HDA_FMI_READING = HDA_FMI_ACTING + HDA_N,
    HDA_FMI_END = HDA_FMI_READING + HDA_FMI_READINGS
};

/* What became of a call; hda_fmi_sentence says it in words. */
typedef enum {
    HDA_FMI_FINE,
    HDA_FMI_UNKNOWN,
    HDA_FMI_READ_ONLY,
    HDA_FMI_FIXED_NOW,
    HDA_FMI_NOT_FINITE,
    HDA_FMI_OUT_OF_BOUNDS,
    HDA_FMI_PHASE,
    HDA_FMI_STEP_SIZE,
    HDA_FMI_DIVERGED,
    HDA_FMI_FOREIGN_STATE,
    HDA_FMI_ABSENT,
    HDA_FMI_OUTCOMES
} hda_fmi_outcome;

typedef enum { HDA_FMI_SETTING, HDA_FMI_INITIALIZING, HDA_FMI_RUNNING, HDA_FMI_ENDED } hda_fmi_phase;

/* Everything that changes; a copy of it is a state of the unit. */
typedef struct {
    double time, command[HDA_NU], p[HDA_NP], start[HDA_N], longest_step;
    double x[HDA_NX], c[HDA_NC], acting[HDA_N], reading[HDA_FMI_READINGS];
    hda_input_state input;
    int32_t phase; /* hda_fmi_phase */
    int32_t stale; /* readings, and before the run x, do not fit what was set since */
} hda_fmi_model;

/* The model as it is made. */
void hda_fmi_reset(hda_fmi_model *m);

hda_fmi_outcome hda_fmi_get(hda_fmi_model *m, uint32_t variable, double *value);
hda_fmi_outcome hda_fmi_set(hda_fmi_model *m, uint32_t variable, double value);

/* From one phase to the next; anything else is refused. */
hda_fmi_outcome hda_fmi_enter(hda_fmi_model *m, hda_fmi_phase phase);

/* From `now` on the inputs are held for h s. A model whose state has diverged is ended. */
hda_fmi_outcome hda_fmi_step(hda_fmi_model *m, double now, double h);

/* A state as bytes that another run, or another process with the same unit, reads. */
size_t hda_fmi_state_size(void);
void hda_fmi_write_state(const hda_fmi_model *m, uint8_t *bytes);
hda_fmi_outcome hda_fmi_read_state(const uint8_t *bytes, size_t count, hda_fmi_model *m);

/* Never null. */
const char *hda_fmi_sentence(hda_fmi_outcome outcome);

#endif
