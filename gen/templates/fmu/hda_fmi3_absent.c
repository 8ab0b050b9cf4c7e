/* The functions of FMI 3.0 for which this unit has nothing: other types than Float64, events, clocks, derivatives,
 * model exchange, scheduled execution. Each answers fmi3Error, or does nothing where nothing is asked for. */
#include "hda_fmi3.h"

#define NONE_0(name) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c)) { \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_1(name, A) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a)) { \
        (void)a; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_2(name, A, B) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b)) { \
        (void)a, (void)b; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_3(name, A, B, C) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b, C third)) { \
        (void)a, (void)b, (void)third; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_4(name, A, B, C, D) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b, C third, D d)) { \
        (void)a, (void)b, (void)third, (void)d; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_5(name, A, B, C, D, E) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b, C third, D d, E e)) { \
        (void)a, (void)b, (void)third, (void)d, (void)e; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_6(name, A, B, C, D, E, F) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b, C third, D d, E e, F f)) { \
        (void)a, (void)b, (void)third, (void)d, (void)e, (void)f; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }
#define NONE_8(name, A, B, C, D, E, F, G, H) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, A a, B b, C third, D d, E e, F f, G g, H h)) { \
        (void)a, (void)b, (void)third, (void)d, (void)e, (void)f, (void)g, (void)h; \
        return hda_fmi3_answer(c, HDA_FMI_ABSENT); \
    }

/* ---- variables of other types; none of them is asked for by a count of 0 ---- */

#define VARIABLES(name, type) \
    FMI3(fmi3Status, fmi3##name(fmi3Instance c, const fmi3ValueReference references[], size_t count, type values[], \
                                size_t numbers)) { \
        (void)references, (void)values, (void)numbers; \
        return hda_fmi3_answer(c, count ? HDA_FMI_UNKNOWN : HDA_FMI_FINE); \
    }
#define VARIABLES_OF(type) VARIABLES(Get##type, fmi3##type) VARIABLES(Set##type, const fmi3##type)
VARIABLES_OF(Float32)
VARIABLES_OF(Int8)
VARIABLES_OF(UInt8)
VARIABLES_OF(Int16)
VARIABLES_OF(UInt16)
VARIABLES_OF(Int32)
VARIABLES_OF(UInt32)
VARIABLES_OF(Int64)
VARIABLES_OF(UInt64)
VARIABLES_OF(Boolean)
VARIABLES_OF(String)
NONE_5(GetBinary, const fmi3ValueReference *, size_t, size_t *, fmi3Binary *, size_t)
NONE_5(SetBinary, const fmi3ValueReference *, size_t, const size_t *, const fmi3Binary *, size_t)
NONE_3(GetClock, const fmi3ValueReference *, size_t, fmi3Clock *)
NONE_3(SetClock, const fmi3ValueReference *, size_t, const fmi3Clock *)

/* ---- dependencies and derivatives ---- */

NONE_2(GetNumberOfVariableDependencies, fmi3ValueReference, size_t *)
NONE_6(GetVariableDependencies, fmi3ValueReference, size_t *, fmi3ValueReference *, size_t *, fmi3DependencyKind *,
       size_t)
NONE_8(GetDirectionalDerivative, const fmi3ValueReference *, size_t, const fmi3ValueReference *, size_t,
       const fmi3Float64 *, size_t, fmi3Float64 *, size_t)
NONE_8(GetAdjointDerivative, const fmi3ValueReference *, size_t, const fmi3ValueReference *, size_t,
       const fmi3Float64 *, size_t, fmi3Float64 *, size_t)
NONE_5(GetOutputDerivatives, const fmi3ValueReference *, size_t, const fmi3Int32 *, fmi3Float64 *, size_t)

/* ---- events and clocks ---- */

NONE_0(EnterEventMode)
NONE_0(EnterStepMode)
NONE_0(EnterConfigurationMode)
NONE_0(ExitConfigurationMode)
NONE_0(EvaluateDiscreteStates)
NONE_6(UpdateDiscreteStates, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Float64 *)
NONE_4(GetIntervalDecimal, const fmi3ValueReference *, size_t, fmi3Float64 *, fmi3IntervalQualifier *)
NONE_5(GetIntervalFraction, const fmi3ValueReference *, size_t, fmi3UInt64 *, fmi3UInt64 *, fmi3IntervalQualifier *)
NONE_3(GetShiftDecimal, const fmi3ValueReference *, size_t, fmi3Float64 *)
NONE_4(GetShiftFraction, const fmi3ValueReference *, size_t, fmi3UInt64 *, fmi3UInt64 *)
NONE_3(SetIntervalDecimal, const fmi3ValueReference *, size_t, const fmi3Float64 *)
NONE_4(SetIntervalFraction, const fmi3ValueReference *, size_t, const fmi3UInt64 *, const fmi3UInt64 *)
NONE_3(SetShiftDecimal, const fmi3ValueReference *, size_t, const fmi3Float64 *)
NONE_4(SetShiftFraction, const fmi3ValueReference *, size_t, const fmi3UInt64 *, const fmi3UInt64 *)

/* ---- model exchange and scheduled execution ---- */

FMI3(fmi3Instance,
     fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                  fmi3Boolean logs, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logs;
    if (log) log(environment, fmi3Error, "logStatusError", hda_fmi_sentence(HDA_FMI_ABSENT));
    return NULL;
}

FMI3(fmi3Instance,
     fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                       fmi3Boolean logs, fmi3InstanceEnvironment environment,
                                       fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                       fmi3PreemptionCallback lock, fmi3PreemptionCallback unlock)) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logs, (void)update, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", hda_fmi_sentence(HDA_FMI_ABSENT));
    return NULL;
}

NONE_0(EnterContinuousTimeMode)
NONE_3(CompletedIntegratorStep, fmi3Boolean, fmi3Boolean *, fmi3Boolean *)
NONE_1(SetTime, fmi3Float64)
NONE_2(SetContinuousStates, const fmi3Float64 *, size_t)
NONE_2(GetContinuousStateDerivatives, fmi3Float64 *, size_t)
NONE_2(GetEventIndicators, fmi3Float64 *, size_t)
NONE_2(GetContinuousStates, fmi3Float64 *, size_t)
NONE_2(GetNominalsOfContinuousStates, fmi3Float64 *, size_t)
NONE_1(GetNumberOfEventIndicators, size_t *)
NONE_1(GetNumberOfContinuousStates, size_t *)
NONE_2(ActivateModelPartition, fmi3ValueReference, fmi3Float64)
