"""Experiments that separate effects which look alike in a log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class ConfusedGroup:
    """Effects that look alike, and the ``experiment`` that tells them apart, as an imperative with its reason."""

    effects: frozenset[str]
    experiment: str


def _make_group(effects: str, experiment: str) -> ConfusedGroup:
    """A group of the ``effects`` that are listed with spaces."""
    return ConfusedGroup(frozenset(effects.split()), experiment)


CONFUSED_GROUPS = (  # the narrowest first: of two effects the first group that has both is taken
    _make_group(
        "current_bias asymmetric_friction",
        "let the joint rest and creep in both directions with slowly rising current: a bias also shifts what holds it "
        "at rest, friction by direction shows only in motion.",
    ),
    _make_group(
        "encoder_eccentricity encoder_bias",
        "turn the joint slowly through as much of a turn as it can: a bias is the same at every angle, what an "
        "eccentric disc adds grows and comes back once a turn.",
    ),
    _make_group(
        "kinematic_error torque_ripple kinematic_torsion",
        "run at several constant speeds and log both encoders and the current: a kinematic error lives in the motor-to-"
        "joint angle and its torque grows with the square of speed, ripple lives in the current, at creep as well.",
    ),
    _make_group(
        "stiffness transmission_hysteresis joint_damping kinematic_torsion",
        "hold the link and load the gear to and fro with several torques, slowly and faster: a spring comes back on "
        "its own line, hysteresis encloses a loop that is as wide at any rate, a damper's widens with the rate.",
    ),
    _make_group(
        "missing_compliance stiffness link_flexibility base_compliance joint_damping",
        "command a multisine up to 25 Hz at two payloads, and push the tip with the motor held: a mode behind the "
        "encoder moves with the payload, the gear's own shows between its encoders.",
    ),
    _make_group(
        "sensor_delay stiffness joint_damping missing_compliance transmission_hysteresis backlash",
        "run several constant speeds under unequal loads with both encoders: a late reading is proportional to speed "
        "whatever the load, torsion follows the load whatever the speed.",
    ),
    _make_group(
        "command_delay current_loop_lag current_saturation voltage_sag missing_compliance",
        "command a multisine up to 25 Hz and log the measured current: a delay turns the phase alone, a lag the "
        "magnitude as well, a limit only large commands, and a soft joint leaves the current untouched.",
    ),
    _make_group(
        "torque_constant payload viscous_friction thermal_friction",
        "swap a known payload, and let the joint coast down without current, cold and warm: the mass shows in the "
        "first, friction alone in the second, and the torque constant only while current flows.",
    ),
    _make_group(
        "transmission_hysteresis coulomb_friction backlash stiffness presliding_friction stribeck_friction",
        "reverse slowly with several amplitudes about several preloads: hysteresis remembers its turning points, "
        "friction goes with the sign of speed, backlash jumps where the torque changes sign, a spring does none of it.",
    ),
    _make_group(
        "load_dependent_friction thermal_friction coulomb_friction asymmetric_friction position_dependent_friction",
        "repeat one speed at several loads and joint angles in shuffled order, cold and warm: what follows load, angle "
        "and time parts there.",
    ),
    _make_group(
        "stribeck_friction coulomb_friction viscous_friction quadratic_friction asymmetric_friction",
        "hold about ten constant speeds in both directions, from creep to the fastest: each has its own curve of "
        "friction over speed.",
    ),
    _make_group(
        "encoder_eccentricity encoder_bias gravity_tilt gravity payload cable_spring",
        "hold still at five or more poses across the range, reached from both sides: weight goes with the pose's "
        "lever, a cable with the angle itself, and an encoder's error needs no torque at all.",
    ),
    _make_group(
        "contact cable_spring gravity_tilt position_dependent_friction",
        "approach both ends of the range slowly and go back: a stop pushes only beyond an angle, a cable everywhere, "
        "friction changes its sign with the direction.",
    ),
    _make_group(
        "transmission_ratio torque_constant stiffness kinematic_error kinematic_torsion encoder_eccentricity "
        "encoder_bias",
        "turn the joint slowly through its whole range without load and log both encoders: a ratio errs in proportion "
        "to the angle, periodic errors come back, torque and springs play no part.",
    ),
)
SAME_EFFECT_EXPERIMENT = (
    "move one joint while the others are held still, each in turn: what belongs to a joint stays with it."
)
EFFECT_EXPERIMENTS = {  # of each effect, the experiment that shows it, and how it shows then
    "asymmetric_friction": ("repeat one motion in both directions", "differs between them and is nothing at rest"),
    "backlash": ("let the load pass zero slowly, with both encoders", "jumps where the torque changes its sign"),
    "base_compliance": ("shake the tip with the motors held", "gives way beneath the first joint, unseen by encoders"),
    "cable_spring": ("creep through the whole range both ways", "pulls the same at an angle from either side"),
    "command_delay": ("command steps and log the current", "shifts it in time, however large it is"),
    "contact": ("approach both ends of the range slowly", "pushes beyond one angle only"),
    "coulomb_friction": ("reverse slowly about one pose", "changes its sign with the direction and keeps its size"),
    "current_bias": ("hold still in one pose, reached from both sides", "adds the same at rest as in motion"),
    "current_loop_lag": ("command steps and log the current", "rounds its corners"),
    "current_saturation": ("repeat one motion faster and faster", "cuts off large currents alone"),
    "encoder_bias": (
        "hold still at several poses across the range",
        "is the same angle everywhere and needs no torque",
    ),
    "encoder_eccentricity": ("turn the joint as far as it can", "grows and comes back once a turn of the joint"),
    "gravity": ("hold still at several poses across the range", "follows the lever of the pose"),
    "gravity_tilt": (
        "hold still at several poses across the range",
        "follows the pose's lever about an upright axis, too",
    ),
    "joint_damping": ("load the gear to and fro, slowly and fast", "resists with the rate of the twist"),
    "kinematic_error": (
        "run at several constant speeds with both encoders",
        "comes back with the motor's turn at any speed",
    ),
    "kinematic_torsion": (
        "turn the motor slowly without load, with both encoders",
        "comes back with the output's turn",
    ),
    "link_flexibility": (
        "shake the arm up to 25 Hz with two payloads",
        "rings behind the encoder, slower with more payload",
    ),
    "load_dependent_friction": ("repeat one speed at several loads", "grows with the load, whichever way that acts"),
    "missing_compliance": ("hold the motor and push the tip", "lets the joint give way where the model is rigid"),
    "payload": ("swap a known payload", "changes weight and inertia together"),
    "position_dependent_friction": (
        "creep through the whole range both ways",
        "varies with the angle and changes its sign with the direction",
    ),
    "presliding_friction": ("reverse within a few encoder steps", "is a spring before the joint breaks away"),
    "quadratic_friction": ("run at constant speeds up to the fastest", "grows with the square of speed"),
    "rotor_coupling": ("move the joints before this one hard while it is held", "follows their acceleration"),
    "sensor_delay": ("run at several constant speeds with both encoders", "shifts a reading in proportion to speed"),
    "stiffness": ("load the held gear with several torques", "twists it in proportion and comes back on its line"),
    "stribeck_friction": ("run at constant speeds from creep on", "falls with speed at first"),
    "thermal_friction": ("repeat one motion from cold to warm", "falls over minutes"),
    "torque_constant": ("hold several known payloads still", "errs in proportion to the current, at rest as well"),
    "torque_ripple": ("creep over several turns of the motor", "comes back with them in the current"),
    "torque_sensor_gain": ("hang a known weight on the arm at rest", "is wrong in the sensor's reading alone"),
    "transmission_hysteresis": ("load the gear to and fro about several preloads", "remembers where the load turned"),
    "transmission_ratio": ("turn the joint as far as it can", "errs in proportion to the angle, without any load"),
    "viscous_friction": ("run at several constant speeds both ways", "grows in proportion to speed"),
    "voltage_sag": ("repeat one motion faster and faster", "takes torque where speed and current are both large"),
}


def suggest_experiments(name: str, confounded: Iterable[str]) -> str:
    """Suggest the experiments that separate an effect from those it is confounded with.

    Args:
        name: the effect, effect@joint.
        confounded: the other effects, effect@joint.

    Returns:
        Sentences in which each experiment stands once; "" where ``confounded`` is empty.

    """
    effect, _, joint = name.partition("@")
    against: dict[str, list[str]] = {}
    others: list[str] = []
    for other in confounded:
        if (experiment := _find_experiment(effect, joint, *other.partition("@")[::2])) is None:
            others.append(other)
        else:
            against.setdefault(experiment, []).append(other)
    if others:
        shown = [effect, *dict.fromkeys(other.partition("@")[0] for other in others)]
        against["; ".join(map(_describe_experiment, shown)) + "."] = others
    return " ".join(f"Against {', '.join(others)}: {experiment}" for experiment, others in against.items())


def _find_experiment(effect: str, joint: str, other: str, other_joint: str) -> str | None:
    """The experiment that separates two effects which look alike; None where no group has both."""
    if effect == other and joint != other_joint:
        return SAME_EFFECT_EXPERIMENT
    return next((g.experiment for g in CONFUSED_GROUPS if {effect, other} <= g.effects), None)


def _describe_experiment(effect: str) -> str:
    """The experiment that shows an effect, with its reason."""
    does, shows = EFFECT_EXPERIMENTS[effect]
    return f"{does} ({effect.replace('_', ' ')} {shows})"
