"""A base that yields, as a spring under joint 1. Legend: C compliance, rad/(N m); J the first link's inertia about
its joint; τ joint torque; ω, ζ frequency and damping of the base; m its deflection by C, N m; r rate of m.

In space the base is a body that turns about x, then y, then z of its frame, on a spring of 1/C and a damper about each
axis; without the arm it swings with ω. It turns the whole arm with it, in gravity too."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals, State

BASE_FREQUENCY = Parameter(
    "base_frequency", "rad/s", 200.0, 20.0, 1000.0, "of the base under the arm", starts=(200.0, 80.0, 400.0)
)
BASE_DAMPING = Parameter(
    "base_damping", "1", 0.05, 0.0, 1.0, "ratio of its damping to the critical one", starts=(0.05, 0.2)
)


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """−C J r′, the inertial torque of the turning base, with ṁ = r, r′ = −ω² (m + τ) − 2 ζ ω r. Links farther out
    are taken to turn with the first."""
    m, rate = s.states["base_moment"], s.states["base_moment_rate"]
    omega = p["base_frequency"]
    change = -omega * omega * (m + s.joint_torque) - 2 * p["base_damping"] * omega * rate
    inertia = p["inertia"] + p["mass"] * p["center_of_mass"] ** 2
    return -p["base_compliance"] * inertia * change, (rate, change)


def compute_stand(s: Signals, p: Mapping[str, Any]) -> Any:
    """(C, ω²), with ṁ = r, and without the arm ṙ = −ω² m − 2 ζ ω r about each axis."""
    omega = p["base_frequency"]
    rates = tuple(s.states[f"base_moment_rate_{axis}"] for axis in "xyz")
    changes = []
    for axis, rate in zip("xyz", rates, strict=True):
        changes.append(-omega * omega * s.states[f"base_moment_{axis}"] - 2 * p["base_damping"] * omega * rate)
    return (p["base_compliance"], omega * omega), (*rates, *changes)


PLANE_FORM = Effect(
    name="base_compliance",
    port=Port.LINK,
    parameters=(
        Parameter(
            "base_compliance", "rad/(N m)", 0.0, 0.0, 0.001, "turn of the base by the torque of joint 1", typical=2e-05
        ),
        BASE_FREQUENCY,
        BASE_DAMPING,
    ),
    amplitudes=("base_compliance",),
    equation=compute_torque,
    citation="Lew, Moon, IEEE/ASME Trans. Mechatronics 6 (2001) 123, a base as one mode; size: a bench of 5e4 N m/rad",
    states=(
        State("base_moment", "N m", 100.0, "deflection of the base by its compliance"),
        State("base_moment_rate", "N m/s", 2e4, "its rate"),
    ),
    joints="first",
    suits_prismatic_joint=False,
    experiment=Experiment(
        "shake the tip with the motors held", "gives way beneath the first joint, unseen by encoders"
    ),
    confusion_groups=(ConfusionGroup.SOFT_MODE,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ACCELERATION),
)
EFFECT = replace(
    PLANE_FORM,
    space_form=replace(
        PLANE_FORM,
        port=Port.STAND,
        parameters=(
            replace(PLANE_FORM.parameters[0], meaning="turn of the base by the arm's moment about each of its axes"),
            BASE_FREQUENCY,
            BASE_DAMPING,
        ),
        equation=compute_stand,
        states=(
            *(State(f"base_moment_{x}", "N m", 100.0, f"deflection about {x} by the compliance") for x in "xyz"),
            *(State(f"base_moment_rate_{x}", "N m/s", 2e4, "its rate") for x in "xyz"),
        ),
        suits_prismatic_joint=True,
    ),
)
