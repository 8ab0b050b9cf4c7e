/* FMI 2.0 for co-simulation: Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0 (2014).
 * The declarations that are needed are written here. Functions of model exchange, derivatives and pending steps answer
 * fmi2Error, as modelDescription.xml says that there are none. */
#include "hda_fmi.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean, fmi2Type, fmi2StatusKind;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

enum { CO_SIMULATION = 1, LAST_SUCCESSFUL_TIME = 2, TERMINATED = 3 };

#ifdef FMI2_FUNCTION_PREFIX
#define JOIN_NAMES(prefix, name) prefix##name
#define JOIN_EXPANDED(prefix, name) JOIN_NAMES(prefix, name)
#define NAME(name) JOIN_EXPANDED(FMI2_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI2(type, name) \
    HDA_API type NAME(name); \
    type NAME(name)

typedef struct {
    hda_fmi_model model;
    fmi2CallbackFunctions callbacks;
    fmi2Boolean logs;
    char name[256];
} unit;

static fmi2Status answer(unit *of, hda_fmi_outcome outcome) {
    if (outcome == HDA_FMI_FINE) return fmi2OK;
    if (of->logs && of->callbacks.logger)
        of->callbacks.logger(of->callbacks.componentEnvironment, of->name, fmi2Error, "logStatusError", "%s",
                             hda_fmi_sentence(outcome));
    return fmi2Error;
}

FMI2(fmi2String, fmi2GetTypesPlatform(void)) {
    return "default";
}

FMI2(fmi2String, fmi2GetVersion(void)) {
    return "2.0";
}

FMI2(fmi2Component, fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logs)) {
    (void)resources;
    (void)visible;
    if (!name || !*name || !token || type != CO_SIMULATION || strcmp(token, HDA_FMI_TOKEN)) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->componentEnvironment, name ? name : "", fmi2Error, "logStatusError",
                              "it takes a name, the guid of its modelDescription.xml, and co-simulation.");
        return NULL;
    }
    unit *of = calloc(1, sizeof *of);
    if (!of) return NULL;
    if (callbacks) of->callbacks = *callbacks;
    of->logs = logs;
    strncpy(of->name, name, sizeof of->name - 1);
    hda_fmi_reset(&of->model);
    return of;
}

FMI2(void, fmi2FreeInstance(fmi2Component c)) {
    free(c);
}

FMI2(fmi2Status, fmi2SetDebugLogging(fmi2Component c, fmi2Boolean logs, size_t count, const fmi2String categories[])) {
    (void)count;
    (void)categories;
    ((unit *)c)->logs = logs;
    return fmi2OK;
}

FMI2(fmi2Status, fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                     fmi2Boolean has_stop, fmi2Real stop)) {
    (void)has_tolerance;
    (void)tolerance;
    (void)has_stop;
    (void)stop;
    unit *of = c;
    if (of->model.phase != HDA_FMI_SETTING) return answer(of, HDA_FMI_PHASE);
    if (!isfinite(start)) return answer(of, HDA_FMI_NOT_FINITE);
    of->model.time = start;
    return fmi2OK;
}

FMI2(fmi2Status, fmi2EnterInitializationMode(fmi2Component c)) {
    return answer(c, hda_fmi_enter(&((unit *)c)->model, HDA_FMI_INITIALIZING));
}

FMI2(fmi2Status, fmi2ExitInitializationMode(fmi2Component c)) {
    return answer(c, hda_fmi_enter(&((unit *)c)->model, HDA_FMI_RUNNING));
}

FMI2(fmi2Status, fmi2Terminate(fmi2Component c)) {
    return answer(c, hda_fmi_enter(&((unit *)c)->model, HDA_FMI_ENDED));
}

FMI2(fmi2Status, fmi2Reset(fmi2Component c)) {
    hda_fmi_reset(&((unit *)c)->model);
    return fmi2OK;
}

FMI2(fmi2Status, fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, fmi2Real values[])) {
    for (size_t k = 0; k < count; k++) {
        const hda_fmi_outcome outcome = hda_fmi_get(&((unit *)c)->model, references[k], &values[k]);
        if (outcome) return answer(c, outcome);
    }
    return fmi2OK;
}

FMI2(fmi2Status,
     fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, const fmi2Real values[])) {
    for (size_t k = 0; k < count; k++) {
        const hda_fmi_outcome outcome = hda_fmi_set(&((unit *)c)->model, references[k], values[k]);
        if (outcome) return answer(c, outcome);
    }
    return fmi2OK;
}

FMI2(fmi2Status, fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean no_return)) {
    (void)no_return;
    return answer(c, hda_fmi_step(&((unit *)c)->model, now, step));
}

FMI2(fmi2Status, fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)) {
    if (!*state) *state = malloc(sizeof(hda_fmi_model));
    if (!*state) return fmi2Error;
    memcpy(*state, &((unit *)c)->model, sizeof(hda_fmi_model));
    return fmi2OK;
}

FMI2(fmi2Status, fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)) {
    if (!state) return answer(c, HDA_FMI_FOREIGN_STATE);
    memcpy(&((unit *)c)->model, state, sizeof(hda_fmi_model));
    return fmi2OK;
}

FMI2(fmi2Status, fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)) {
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

FMI2(fmi2Status, fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)) {
    (void)c;
    (void)state;
    *size = hda_fmi_state_size();
    return fmi2OK;
}

FMI2(fmi2Status, fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)) {
    if (!state || size < hda_fmi_state_size()) return answer(c, HDA_FMI_FOREIGN_STATE);
    hda_fmi_write_state(state, (uint8_t *)bytes);
    return fmi2OK;
}

FMI2(fmi2Status, fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)) {
    hda_fmi_model found;
    const hda_fmi_outcome outcome = hda_fmi_read_state((const uint8_t *)bytes, size, &found);
    if (outcome) return answer(c, outcome);
    if (!*state) *state = malloc(sizeof found);
    if (!*state) return fmi2Error;
    memcpy(*state, &found, sizeof found);
    return fmi2OK;
}

FMI2(fmi2Status, fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value)) {
    if (kind != LAST_SUCCESSFUL_TIME) return fmi2Discard;
    *value = ((unit *)c)->model.time;
    return fmi2OK;
}

FMI2(fmi2Status, fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value)) {
    if (kind != TERMINATED) return fmi2Discard;
    *value = ((unit *)c)->model.phase == HDA_FMI_ENDED;
    return fmi2OK;
}

/* ---- what this unit has none of ---- */

#define VARIABLES(set, type) \
    FMI2(fmi2Status, fmi2##set(fmi2Component c, const fmi2ValueReference references[], size_t count, type values[])) { \
        (void)references; \
        (void)values; \
        return count ? answer(c, HDA_FMI_UNKNOWN) : fmi2OK; \
    }
VARIABLES(GetInteger, fmi2Integer)
VARIABLES(GetBoolean, fmi2Boolean)
VARIABLES(GetString, fmi2String)
VARIABLES(SetInteger, const fmi2Integer)
VARIABLES(SetBoolean, const fmi2Boolean)
VARIABLES(SetString, const fmi2String)

#define NONE_4(name, A, B, C, D) \
    FMI2(fmi2Status, fmi2##name(fmi2Component c, A a, B b, C third, D d)) { \
        (void)a, (void)b, (void)third, (void)d; \
        return answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_STATUS(name, type) \
    FMI2(fmi2Status, fmi2##name(fmi2Component c, fmi2StatusKind kind, type *value)) { \
        (void)c, (void)kind, (void)value; \
        return fmi2Discard; \
    }
NONE_4(SetRealInputDerivatives, const fmi2ValueReference *, size_t, const fmi2Integer *, const fmi2Real *)
NONE_4(GetRealOutputDerivatives, const fmi2ValueReference *, size_t, const fmi2Integer *, fmi2Real *)
NONE_STATUS(GetStatus, fmi2Status)
NONE_STATUS(GetIntegerStatus, fmi2Integer)
NONE_STATUS(GetStringStatus, fmi2String)

FMI2(fmi2Status, fmi2CancelStep(fmi2Component c)) {
    return answer(c, HDA_FMI_ABSENT);
}

FMI2(fmi2Status, fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                              const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                              fmi2Real sensitivity[])) {
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)sensitivity;
    return answer(c, HDA_FMI_ABSENT);
}
