"""A link that bends, as an oscillator that hangs on the joint. Legend: m share; J the link's inertia about its
joint; B inertia of the oscillator, m J in the plane; ω, ζ frequency and damping of the clamped link; a deflection, b
its absolute speed.

The oscillator turns about the joint's axis. In space a link bends about other axes, too: the joints whose axes these
are feel that, and each of them has an oscillator of its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals, State

LINK_FREQUENCY = Parameter(
    "link_frequency", "rad/s", 150.0, 20.0, 1200.0, "of the link with its joint held", starts=(150.0, 60.0, 350.0)
)
LINK_DAMPING = Parameter(
    "link_damping", "1", 0.02, 0.0, 1.0, "ratio of its damping to the critical one", starts=(0.02, 0.1)
)


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """B (ω² a + 2 ζ ω (b − q̇)) with ȧ = b − q̇, ḃ = −ω² a − 2 ζ ω (b − q̇)."""
    pull, rates = _move_oscillator(s, p)
    inertia = p["inertia"] + p["mass"] * p["center_of_mass"] ** 2
    return p["link_share"] * inertia * pull, rates


def compute_torque_in_space(s: Signals, p: Mapping[str, Any]) -> Any:
    """B (ω² a + 2 ζ ω (b − q̇)) with ȧ = b − q̇, ḃ = −ω² a − 2 ζ ω (b − q̇)."""
    pull, rates = _move_oscillator(s, p)
    return p["bending_inertia"] * pull, rates


def _move_oscillator(s: Signals, p: Mapping[str, Any]) -> tuple[Any, tuple[Any, Any]]:
    """Its pull by its inertia, and the rates of its states."""
    a, slip = s.states["bending"], s.states["bending_speed"] - s.joint_velocity
    omega = p["link_frequency"]
    pull = omega * omega * a + 2 * p["link_damping"] * omega * slip
    return pull, (slip, -pull)


PLANE_FORM = Effect(
    name="link_flexibility",
    port=Port.LINK,
    parameters=(
        Parameter("link_share", "1", 0.0, 0.0, 5.0, "inertia of the oscillator by that of the link", typical=0.2),
        LINK_FREQUENCY,
        LINK_DAMPING,
    ),
    amplitudes=("link_share",),
    equation=compute_torque,
    citation="Book, Int. J. Robot. Res. 3 (1984) 87, one mode; size: modal mass of a uniform beam's first mode, a "
    "quarter of it",
    states=(
        State("bending", "rad", 0.05, "deflection of the link"),
        State("bending_speed", "rad/s", 10.0, "speed of the oscillator"),
    ),
    suits_prismatic_joint=False,
    experiment=Experiment(
        "shake the arm up to 25 Hz with two payloads", "rings behind the encoder, slower with more payload"
    ),
    confusion_groups=(ConfusionGroup.SOFT_MODE,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ACCELERATION),
)
EFFECT = replace(
    PLANE_FORM,
    space_form=replace(
        PLANE_FORM,
        parameters=(
            Parameter(
                "bending_inertia",
                "kg m²",
                0.0,
                0.0,
                1000.0,
                "of the oscillator about the joint's axis",
                typical=0.2,
                scale="carried_inertia",
            ),
            LINK_FREQUENCY,
            LINK_DAMPING,
        ),
        amplitudes=("bending_inertia",),
        equation=compute_torque_in_space,
    ),
)
