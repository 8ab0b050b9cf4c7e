/* FMI 3.0 for co-simulation: Functional Mock-up Interface Specification, version 3.0 (2022). The types stand in
 * hda_fmi3.h; the functions of other kinds of units, which answer fmi3Error, in hda_fmi3_absent.c. */
#include "hda_fmi3.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

fmi3Status hda_fmi3_answer(hda_fmi3_unit *of, hda_fmi_outcome outcome) {
    if (outcome == HDA_FMI_FINE) return fmi3OK;
    if (of && of->logs && of->log) of->log(of->environment, fmi3Error, "logStatusError", hda_fmi_sentence(outcome));
    return fmi3Error;
}

FMI3(fmi3String, fmi3GetVersion(void)) {
    return "3.0";
}

FMI3(fmi3Instance, fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logs, fmi3Boolean events,
                                               fmi3Boolean early, const fmi3ValueReference intermediate[],
                                               size_t intermediates, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)) {
    (void)resources, (void)visible, (void)events, (void)early, (void)intermediate, (void)update;
    if (!name || !*name || !token || intermediates || strcmp(token, HDA_FMI_TOKEN)) {
        if (log)
            log(environment, fmi3Error, "logStatusError",
                "it takes a name, the token of its modelDescription.xml, and no intermediate variables.");
        return NULL;
    }
    hda_fmi3_unit *of = calloc(1, sizeof *of);
    if (!of) return NULL;
    of->environment = environment;
    of->log = log;
    of->logs = logs;
    hda_fmi_reset(&of->model);
    return of;
}

FMI3(void, fmi3FreeInstance(fmi3Instance c)) {
    free(c);
}

FMI3(fmi3Status, fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean logs, size_t count, const fmi3String categories[])) {
    (void)count, (void)categories;
    ((hda_fmi3_unit *)c)->logs = logs;
    return fmi3OK;
}

FMI3(fmi3Status, fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                             fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    hda_fmi3_unit *of = c;
    if (!isfinite(start)) return hda_fmi3_answer(of, HDA_FMI_NOT_FINITE);
    const hda_fmi_outcome outcome = hda_fmi_enter(&of->model, HDA_FMI_INITIALIZING);
    if (!outcome) of->model.time = start;
    return hda_fmi3_answer(of, outcome);
}

FMI3(fmi3Status, fmi3ExitInitializationMode(fmi3Instance c)) {
    return hda_fmi3_answer(c, hda_fmi_enter(&((hda_fmi3_unit *)c)->model, HDA_FMI_RUNNING));
}

FMI3(fmi3Status, fmi3Terminate(fmi3Instance c)) {
    return hda_fmi3_answer(c, hda_fmi_enter(&((hda_fmi3_unit *)c)->model, HDA_FMI_ENDED));
}

FMI3(fmi3Status, fmi3Reset(fmi3Instance c)) {
    hda_fmi_reset(&((hda_fmi3_unit *)c)->model);
    return fmi3OK;
}

FMI3(fmi3Status, fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                fmi3Float64 values[], size_t numbers)) {
    if (numbers != count) return hda_fmi3_answer(c, HDA_FMI_UNKNOWN);
    for (size_t k = 0; k < count; k++) {
        const hda_fmi_outcome outcome = hda_fmi_get(&((hda_fmi3_unit *)c)->model, references[k], &values[k]);
        if (outcome) return hda_fmi3_answer(c, outcome);
    }
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                const fmi3Float64 values[], size_t numbers)) {
    if (numbers != count) return hda_fmi3_answer(c, HDA_FMI_UNKNOWN);
    for (size_t k = 0; k < count; k++) {
        const hda_fmi_outcome outcome = hda_fmi_set(&((hda_fmi3_unit *)c)->model, references[k], values[k]);
        if (outcome) return hda_fmi3_answer(c, outcome);
    }
    return fmi3OK;
}

FMI3(fmi3Status,
     fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 step, fmi3Boolean no_return, fmi3Boolean *needs_events,
                fmi3Boolean *terminates, fmi3Boolean *returned_early, fmi3Float64 *last_time)) {
    (void)no_return;
    hda_fmi3_unit *of = c;
    const hda_fmi_outcome outcome = hda_fmi_step(&of->model, now, step);
    *needs_events = *terminates = *returned_early = false;
    *last_time = of->model.time;
    return hda_fmi3_answer(of, outcome);
}

/* ---- states ---- */

FMI3(fmi3Status, fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)) {
    if (!*state) *state = malloc(sizeof(hda_fmi_model));
    if (!*state) return fmi3Error;
    memcpy(*state, &((hda_fmi3_unit *)c)->model, sizeof(hda_fmi_model));
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)) {
    if (!state) return hda_fmi3_answer(c, HDA_FMI_FOREIGN_STATE);
    memcpy(&((hda_fmi3_unit *)c)->model, state, sizeof(hda_fmi_model));
    return fmi3OK;
}

FMI3(fmi3Status, fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)) {
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)) {
    (void)c, (void)state;
    *size = hda_fmi_state_size();
    return fmi3OK;
}

FMI3(fmi3Status, fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)) {
    if (!state || size < hda_fmi_state_size()) return hda_fmi3_answer(c, HDA_FMI_FOREIGN_STATE);
    hda_fmi_write_state(state, bytes);
    return fmi3OK;
}

FMI3(fmi3Status, fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)) {
    hda_fmi_model found;
    const hda_fmi_outcome outcome = hda_fmi_read_state(bytes, size, &found);
    if (outcome) return hda_fmi3_answer(c, outcome);
    if (!*state) *state = malloc(sizeof found);
    if (!*state) return fmi3Error;
    memcpy(*state, &found, sizeof found);
    return fmi3OK;
}
