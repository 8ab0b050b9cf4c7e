"""Which experiment tells causes apart that look alike in a log: groups of effects, each with what separates them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Group:
    """Effects that look alike, and the ``experiment`` that tells them apart, as an imperative with its reason."""

    effects: frozenset[str]
    experiment: str


def _group(effects: str, experiment: str) -> Group:
    return Group(frozenset(effects.split()), experiment)


GROUPS = (  # the narrowest first: the first that holds both is taken
    _group(
        "current_bias asymmetric_friction",
        "let the joint rest and creep in both directions with slowly rising current: a bias also shifts what holds it "
        "at rest, friction by direction shows only in motion.",
    ),
    _group(
        "encoder_eccentricity encoder_bias",
        "turn the joint slowly through as much of a turn as it can: a bias is the same at every angle, what an "
        "eccentric disc adds grows and comes back once a turn.",
    ),
    _group(
        "kinematic_error torque_ripple kinematic_torsion",
        "run at several constant speeds and log both encoders and the current: a kinematic error lives in the motor-to-"
        "joint angle and its torque grows with the square of speed, ripple lives in the current, at creep as well.",
    ),
    _group(
        "stiffness transmission_hysteresis joint_damping kinematic_torsion",
        "hold the link and load the gear to and fro with several torques, slowly and faster: a spring comes back on "
        "its own line, hysteresis encloses a loop that is as wide at any rate, a damper's widens with the rate.",
    ),
    _group(
        "missing_compliance stiffness link_flexibility base_compliance joint_damping",
        "command a multisine up to 25 Hz at two payloads, and push the tip with the motor held: a mode behind the "
        "encoder moves with the payload, the gear's own shows between its encoders.",
    ),
    _group(
        "sensor_delay stiffness joint_damping missing_compliance transmission_hysteresis backlash",
        "run several constant speeds under unequal loads with both encoders: a late reading is proportional to speed "
        "whatever the load, torsion follows the load whatever the speed.",
    ),
    _group(
        "command_delay current_loop_lag current_saturation voltage_sag missing_compliance",
        "command a multisine up to 25 Hz and log the measured current: a delay turns the phase alone, a lag the "
        "magnitude as well, a limit only large commands, and a soft joint leaves the current untouched.",
    ),
    _group(
        "torque_constant payload viscous_friction thermal_friction",
        "swap a known payload, and let the joint coast down without current, cold and warm: the mass shows in the "
        "first, friction alone in the second, and the torque constant only while current flows.",
    ),
    _group(
        "transmission_hysteresis coulomb_friction backlash stiffness presliding_friction stribeck_friction",
        "reverse slowly with several amplitudes about several preloads: hysteresis remembers its turning points, "
        "friction goes with the sign of speed, backlash jumps where the torque changes sign, a spring does none of it.",
    ),
    _group(
        "load_dependent_friction thermal_friction coulomb_friction asymmetric_friction position_dependent_friction",
        "repeat one speed at several loads and joint angles in shuffled order, cold and warm: what follows load, angle "
        "and time parts there.",
    ),
    _group(
        "stribeck_friction coulomb_friction viscous_friction quadratic_friction asymmetric_friction",
        "hold about ten constant speeds in both directions, from creep to the fastest: each has its own curve of "
        "friction over speed.",
    ),
    _group(
        "encoder_eccentricity encoder_bias gravity_tilt gravity payload cable_spring",
        "hold still at five or more poses across the range, reached from both sides: weight goes with the pose's "
        "lever, a cable with the angle itself, and an encoder's error needs no torque at all.",
    ),
    _group(
        "contact cable_spring gravity_tilt position_dependent_friction",
        "approach both ends of the range slowly and go back: a stop pushes only beyond an angle, a cable everywhere, "
        "friction changes its sign with the direction.",
    ),
    _group(
        "transmission_ratio torque_constant stiffness kinematic_error kinematic_torsion encoder_eccentricity "
        "encoder_bias",
        "turn the joint slowly through its whole range without load and log both encoders: a ratio errs in proportion "
        "to the angle, periodic errors come back, torque and springs play no part.",
    ),
)
SAME_KIND = "move one joint while the others are held still, each in turn: what belongs to a joint stays with it."
OTHERWISE = (
    "record a motion that reverses, sweeps the speed in both directions, changes the load and holds still at several "
    "poses."
)


def separate_by(name: str, confounded: Iterable[str]) -> str:
    """The experiments that would tell ``name`` (effect@joint) from each of what it is ``confounded`` with, "" where
    that is nothing; each experiment stands once."""
    effect, _, joint = name.partition("@")
    against: dict[str, list[str]] = {}
    for other in confounded:
        other_effect, _, other_joint = other.partition("@")
        against.setdefault(_experiment(effect, other_effect, joint, other_joint), []).append(other)
    return " ".join(f"Against {', '.join(others)}: {experiment}" for experiment, others in against.items())


def _experiment(effect: str, other: str, joint: str, other_joint: str) -> str:
    if effect == other and joint != other_joint:
        return SAME_KIND
    return next((g.experiment for g in GROUPS if {effect, other} <= g.effects), OTHERWISE)
