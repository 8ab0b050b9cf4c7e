/* The guard around every control tick: whatever comes in, a legal torque goes out. See docs/project/safety.md.
 *
 *     status = hda_guard_begin(&guard, now, &measurement, reference, count);
 *     if (status >= 0) controller(..., raw, force_map);
 *     status = hda_guard_end(&guard, raw, force_map, torque);
 *
 * Units: s, rad, rad/s, N m at the motor, N; m, m/s and N in place of the angular ones at a prismatic joint.
 * Not a safety-rated function: use it behind a certified stop. */
#ifndef HDA_GUARD_H
#define HDA_GUARD_H

#include <stdint.h>

#include "hda_limit.h"
#include "hda_sizes.h" /* HDA_N, the number of joints */

#if !defined(HDA_N) || HDA_N < 1 || HDA_N > 12
#error "HDA_N, the number of joints, must be 1 to 12"
#endif

#ifndef HDA_TIP
#define HDA_TIP 2    /* coordinates of the tip; hda_sizes.h says 3 for an arm in space */
#define HDA_WRENCH 2 /* numbers of the force on the tip: then 6, the moment after the force */
#endif

#ifndef HDA_REFERENCE_MAX
#define HDA_REFERENCE_MAX 64 /* reference values a tick may carry; hda_sizes.h may say another number */
#endif

#define HDA_GUARD_VERSION 0x48440001u
#define HDA_UNLIMITED 1e100        /* for force_limit and the jumps: not checked; the largest number a limit may be */
#define HDA_SMALLEST_LIMIT 1e-100  /* the smallest, so that no step is lost to underflow */
#define HDA_NEVER INT32_MAX        /* for the stale counts: not checked */
#define HDA_SAFE_TICKS_MAX 1000000 /* a configuration that needs longer to be safe is refused */

/* name, code, sentence: 0 fine, positive degraded, negative refused. One entry a line, read by other languages too. */
/* clang-format off */
#define HDA_STATUS_LIST(HDA_STATUS) \
  HDA_STATUS(HDA_FINE, 0, "The torque is the controller's own.") \
  HDA_STATUS(HDA_RATE_LIMITED, 1, "The controller's torque was limited in its rate.") \
  HDA_STATUS(HDA_TORQUE_LIMITED, 2, "The controller's torque was limited in its size.") \
  HDA_STATUS(HDA_FORCE_LIMITED, 3, "The controller's torque was scaled down to the limit of the tip force.") \
  HDA_STATUS(HDA_MEASUREMENT_REPEATED, 4, "The measurement is the last one again; the torque rests on old data.") \
  HDA_STATUS(HDA_LATCHED, -1, "The safe state holds after a fault that was read; hda_guard_recover leaves it.") \
  HDA_STATUS(HDA_FAULT_CONTEXT, -2, "The context is not this library's guard; configure one that began as zeros.") \
  HDA_STATUS(HDA_FAULT_UNCONFIGURED, -3, "The guard has no configuration; call hda_guard_configure first.") \
  HDA_STATUS(HDA_FAULT_CALL, -4, "A pointer is null or the reference's count is out of range; mend the caller.") \
  HDA_STATUS(HDA_FAULT_SEQUENCE, -5, "Begin and end did not alternate; call each once a tick, a refused one too.") \
  HDA_STATUS(HDA_FAULT_TIME_FINITE, -10, "A time stamp is NaN or infinite; check the clock.") \
  HDA_STATUS(HDA_FAULT_TIME_BACKWARD, -11, "The tick's time is not later than the last one's; use a monotonic clock.") \
  HDA_STATUS(HDA_FAULT_PERIOD_SHORT, -12, "The tick came sooner than period_min; check the scheduler.") \
  HDA_STATUS(HDA_FAULT_PERIOD_LONG, -13, "The tick came later than period_max; look for what delayed it.") \
  HDA_STATUS(HDA_FAULT_STAMP_BACKWARD, -14, "The measurement is older than the last one; check the packets' order.") \
  HDA_STATUS(HDA_FAULT_INPUT_FINITE, -20, "An input is NaN or infinite; the fault's index says which.") \
  HDA_STATUS(HDA_FAULT_MOTOR_JUMP, -30, "A motor position moved more than motor_jump in a tick; check the encoder.") \
  HDA_STATUS(HDA_FAULT_JOINT_JUMP, -31, "A joint position moved more than joint_jump in a tick; check the encoder.") \
  HDA_STATUS(HDA_FAULT_STALE_STAMP, -32, "The measurement's stamp stood still for stale_stamp_ticks; check the bus.") \
  HDA_STATUS(HDA_FAULT_STALE_BITS, -33, "No bit of the measurement changed for stale_bits_ticks; check the sensors.") \
  HDA_STATUS(HDA_FAULT_RESULT_FINITE, -40, "The controller's torque, or the tip force it makes, is NaN or infinite.") \
  HDA_STATUS(HDA_FAULT_FORCE, -41, "The torque cannot fall fast enough to keep the force limit; mind singular poses.") \
  HDA_STATUS(HDA_FAULT_ASSERTION, -42, "The last check failed: the guard's memory was overwritten; zero was sent.") \
  HDA_STATUS(HDA_FAULT_WATCHDOG, -50, "No tick came within the watchdog's time; look for what stopped the loop.") \
  HDA_STATUS(HDA_CONFIG_CONTEXT, -100, "The context is neither zeros nor this library's guard; nothing was changed.") \
  HDA_STATUS(HDA_CONFIG_CALL, -101, "The context or the configuration is a null pointer; nothing was changed.") \
  HDA_STATUS(HDA_CONFIG_VERSION, -102, "The configuration's version is not this library's; compile with its header.") \
  HDA_STATUS(HDA_CONFIG_SIZE, -103, "The configuration's size or joints are not this library's; use the same HDA_N.") \
  HDA_STATUS(HDA_CONFIG_SAFE, -104, "What safe means is not chosen; set safe to HDA_SAFE_ZERO, _DAMPING or _HOLD.") \
  HDA_STATUS(HDA_CONFIG_PERIOD, -105, "The periods must be positive, period_min <= period <= period_max.") \
  HDA_STATUS(HDA_CONFIG_WATCHDOG, -106, "The watchdog's time must be finite and at least period_max.") \
  HDA_STATUS(HDA_CONFIG_STALE, -107, "The stale counts must be 1 or more ticks; HDA_NEVER switches one off.") \
  HDA_STATUS(HDA_CONFIG_FORCE_LIMIT, -108, "force_limit must be finite and positive; HDA_UNLIMITED switches it off.") \
  HDA_STATUS(HDA_CONFIG_TORQUE_LIMIT, -109, "Every torque_limit must be finite and positive.") \
  HDA_STATUS(HDA_CONFIG_TORQUE_RATE, -110, "Every torque_rate must be finite and positive.") \
  HDA_STATUS(HDA_CONFIG_JUMP, -111, "Every jump must be finite and positive; HDA_UNLIMITED switches one off.") \
  HDA_STATUS(HDA_CONFIG_DAMPING, -112, "Damping and hold need a finite, positive safe_damping at every joint.") \
  HDA_STATUS(HDA_CONFIG_STIFFNESS, -113, "Hold needs a finite, positive safe_stiffness at every joint.") \
  HDA_STATUS(HDA_CONFIG_SLOW, -114, "Safe would take over a million ticks; raise torque_rate or period_min.") \
  HDA_STATUS(HDA_CONFIG_SENT, -115, "The torque now sent breaks the new limits; lower it first. Nothing was changed.") \
  HDA_STATUS(HDA_CONFIG_BUSY, -116, "The guard is latched or in a tick; recover or end it; nothing was changed.") \
  HDA_STATUS(HDA_RECOVER_CALL, -200, "The measurement is a null pointer; the safe state holds.") \
  HDA_STATUS(HDA_RECOVER_NOTHING, -201, "The guard is not latched; there is nothing to recover from.") \
  HDA_STATUS(HDA_RECOVER_UNREAD, -202, "A fault is unread; call hda_guard_read first. The safe state holds.") \
  HDA_STATUS(HDA_RECOVER_EARLY, -203, "Safe is not reached yet; wait hda_guard_safe_ticks. The safe state holds.") \
  HDA_STATUS(HDA_RECOVER_TIME, -204, "No tick came within period_max; keep them running. The safe state holds.") \
  HDA_STATUS(HDA_RECOVER_FINITE, -205, "The measurement is NaN or infinite; the safe state holds.") \
  HDA_STATUS(HDA_RECOVER_STALE, -206, "The measurement is not newer than the last tick's; the safe state holds.") \
  HDA_STATUS(HDA_RECOVER_JUMP, -207, "The position jumps against the last tick's measurement; the safe state holds.") \
  HDA_STATUS(HDA_RECOVER_OPEN, -208, "A tick is open; end it first. The safe state holds.")
/* clang-format on */

#define HDA_STATUS_NAME(name, code, sentence) name = (code),
enum hda_status { HDA_STATUS_LIST(HDA_STATUS_NAME) HDA_STATUS_END = 1000 };
#undef HDA_STATUS_NAME

/* What safe means, the weakest first; each falls to the one before it where it lacks a measurement to stand on. */
enum hda_safe {
    HDA_SAFE_UNSET = 0,   /* refused: there is no default */
    HDA_SAFE_ZERO = 1,    /* no torque */
    HDA_SAFE_DAMPING = 2, /* -safe_damping * motor velocity */
    HDA_SAFE_HOLD = 3     /* safe_stiffness * (latched - motor position) - safe_damping * motor velocity */
};

/* What the sensors said. A channel that is not measured stays 0. Doubles only, so that it has no padding. */
typedef struct hda_measurement {
    double stamp; /* when it was sampled, s, on any clock that does not run backwards */
    double motor_position[HDA_N];
    double motor_velocity[HDA_N];
    double joint_position[HDA_N];
    double joint_velocity[HDA_N];
    double motor_torque[HDA_N];   /* measured or estimated */
    double tip_force[HDA_WRENCH]; /* measured or estimated, base frame; in space with the moment, N m */
} hda_measurement;

typedef struct hda_guard_config {
    uint32_t version;             /* HDA_GUARD_VERSION */
    uint32_t size;                /* sizeof(hda_guard_config) */
    int32_t safe;                 /* enum hda_safe */
    int32_t stale_stamp_ticks;    /* ticks in a row with the same stamp that are a fault */
    int32_t stale_bits_ticks;     /* ticks in a row with every measured bit the same that are a fault */
    int32_t joints;               /* HDA_N */
    double period;                /* nominal, s */
    double period_min;            /* s; a tick counts as no less */
    double period_max;            /* s */
    double watchdog;              /* s without a tick */
    double force_limit;           /* N, the static tip force |force_map torque| */
    double torque_limit[HDA_N];   /* N m */
    double torque_rate[HDA_N];    /* N m/s */
    double motor_jump[HDA_N];     /* rad in one tick */
    double joint_jump[HDA_N];     /* rad in one tick */
    double safe_damping[HDA_N];   /* N m s/rad; read for damping and hold */
    double safe_stiffness[HDA_N]; /* N m/rad; read for hold */
} hda_guard_config;

/* The first fault since the last hda_guard_read, with what came in. */
typedef struct hda_fault {
    int32_t code;    /* enum hda_status; 0 none */
    int32_t index;   /* joint from 1; an input's number from 1, hda_measurement's, then the reference's; or 0 */
    int32_t further; /* faults after it */
    int32_t reference_count;
    double now;         /* s, as given */
    double raw[HDA_N];  /* the controller's torque where the fault was found in it, else 0 */
    double sent[HDA_N]; /* the torque sent before */
    hda_measurement measurement;
    double reference[HDA_REFERENCE_MAX];
} hda_fault;

/* The context: begins as zeros, belongs to one thread at a time. Only the guard writes its fields. */
typedef struct hda_guard {
    uint32_t version, size;
    hda_guard_config config;
    int32_t safe_bound; /* hda_guard_safe_ticks(config) */
    int32_t open;       /* between begin and end */
    int32_t latched;
    int32_t trust;     /* the strongest safe state that the measurements allow until recover, enum hda_safe */
    int32_t level;     /* ... that this tick's measurement allows */
    int32_t started;   /* tick_time is known */
    int32_t known;     /* measured is known */
    int32_t map_known; /* force_map is known */
    int32_t repeated_stamps, repeated_bits;
    int32_t safe_ticks; /* ticks since the latch */
    int32_t reference_count;
    double now;       /* of the last call, as given */
    double tick_time; /* the last finite one */
    double sent_time;
    double elapsed;         /* what this tick counts for in the rate limit, s; 0 once it is spent */
    double sent[HDA_N];     /* the torque sent last */
    double target[HDA_N];   /* the safe law's torque, slewed at half the rate */
    double hold[HDA_N];     /* motor positions at the latch */
    double velocity[HDA_N]; /* motor velocities of this tick, for the safe law */
    double force_map[HDA_TIP * HDA_N];
    double reference[HDA_REFERENCE_MAX];
    hda_measurement measured; /* the last finite one */
    hda_fault fault;
} hda_guard;

#ifdef __cplusplus
extern "C" {
#endif

/* Sets or replaces the configuration; the state stays. Returns 0, or HDA_CONFIG_* and changes nothing. */
HDA_API int hda_guard_configure(hda_guard *guard, const hda_guard_config *config);

/* Ticks within which safe is reached from any torque; or the HDA_CONFIG_* for which the configuration is refused. */
HDA_API int hda_guard_safe_ticks(const hda_guard_config *config);

/* Static force at the tip, N, that the torque would exert were the tip blocked: |force_map torque|. */
HDA_API double hda_guard_force(const double *force_map, const double *torque);

/* Opens a tick: checks what came in. now in s on a monotonic clock; reference: count values, 0 to HDA_REFERENCE_MAX.
 * Negative: do not run the controller, but call hda_guard_end all the same. */
HDA_API int hda_guard_begin(hda_guard *guard, double now, const hda_measurement *measurement, const double *reference,
                            int count);

/* Closes the tick: writes HDA_N torques, always. raw: the controller's, not read in a refused tick; may be torque.
 * force_map: HDA_TIP x HDA_N by rows, N at the tip per N m at the motor; not read where force_limit is HDA_UNLIMITED.
 */
HDA_API int hda_guard_end(hda_guard *guard, const double *raw, const double *force_map, double *torque);

/* Writes the torque last sent while ticks come; latches and ramps to zero torque, a step a call, where they do not. */
HDA_API int hda_guard_watchdog(hda_guard *guard, double now, double *torque);

/* Copies the fault record out and clears it; the latch stays. Returns its code, 0 where there is none. With a null
 * fault: only the code, and nothing is cleared. */
HDA_API int hda_guard_read(hda_guard *guard, hda_fault *fault);

/* Ends the safe state, between ticks, with a measurement newer than the last tick's. Returns 0, or says why not. */
HDA_API int hda_guard_recover(hda_guard *guard, double now, const hda_measurement *measurement);

/* The sentence of a status, never null. */
HDA_API const char *hda_status_sentence(int status);

#ifdef __cplusplus
}
#endif

#endif
