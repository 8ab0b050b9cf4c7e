/* The types of FMI 3.0 that are needed, written here. Source: Functional Mock-up Interface Specification, version 3.0
 * (2022). */
#ifndef HDA_FMI3_H
#define HDA_FMI3_H

#include "hda_fmi.h"

#include <stdbool.h>

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef int fmi3DependencyKind, fmi3IntervalQualifier;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3PreemptionCallback)(void);

/* The prefix of every function where a unit is compiled into a program of others. */
#ifdef FMI3_OVERRIDE_FUNCTION_PREFIX
#define HDA_FMI3_PREFIX FMI3_OVERRIDE_FUNCTION_PREFIX
#elif defined(FMI3_FUNCTION_PREFIX)
#define HDA_FMI3_PREFIX FMI3_FUNCTION_PREFIX
#endif
#ifdef HDA_FMI3_PREFIX
#define HDA_FMI3_JOIN_NAMES(prefix, name) prefix##name
#define HDA_FMI3_JOIN(prefix, name) HDA_FMI3_JOIN_NAMES(prefix, name)
#define HDA_FMI3_NAME(name) HDA_FMI3_JOIN(HDA_FMI3_PREFIX, name)
#else
#define HDA_FMI3_NAME(name) name
#endif
#define FMI3(type, name) \
    HDA_API type HDA_FMI3_NAME(name); \
    type HDA_FMI3_NAME(name)

typedef struct {
    hda_fmi_model model;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3Boolean logs;
} hda_fmi3_unit;

/* The status of an outcome, which is logged where it is an error. */
fmi3Status hda_fmi3_answer(hda_fmi3_unit *of, hda_fmi_outcome outcome);

#endif
