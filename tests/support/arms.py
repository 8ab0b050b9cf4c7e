"""Robot files that tests build, as text: chains of any kinds of joints and drives, and one that is built in no time."""

from __future__ import annotations

from gen.effects import ALL

SPRINGS = """torsional_damping = 6.0
flexspline_stiffness = 9743.94
flexspline_stiffening = 0.0831
wave_generator_stiffness = 2.5517
wave_generator_stiffening = 27.027
"""
WHOLE = tuple(sorted(effect.name for effect in ALL if effect.series_spring is None))  # as `load(…, effects=("all",))`
ALL_EFFECTS = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")


def arm(kinds: str, name: str = "test arm", rigid: str = "", step: float = 5e-4, drive: str = "") -> str:
    """A robot.toml: a letter a joint in ``kinds`` ("R" or "P"), base first, under gravity.

    ``rigid`` has a letter a joint, "r" for a rigid drive, the others have springs; ``drive`` is a line in every drive.
    """
    text = f'name = "{name}"\ngravity = [0.0, -9.81]\nstep = {step}\n'
    for k, kind in enumerate(kinds):
        share = 2.0**-k
        stiff = rigid[k : k + 1] == "r"
        length = f"length = {0.3 - 0.02 * k}\n" if kind == "R" else 'type = "prismatic"\n'
        text += f"[[joint]]\n{length}mass = {0.5 + 4 * share}\ncenter_of_mass = {0.12 - 0.01 * k}\n"
        text += f"inertia = {0.02 + 0.06 * share}\n[joint.drive]\n"
        text += f"ratio = {(20.0 if stiff else 100.0) * (1 if kind == 'R' else 4)}\n"
        text += f"motor_inertia = {1.3e-4 * (1 + k)}\nviscous_friction = {1e-4 * (1 + k)}\ncoulomb_friction = 0.03\n"
        text += f"{'rigid = true' if stiff else SPRINGS}\n{drive}\n"
    return text


SMALL = arm("R", rigid="r", drive="friction_smoothing = 1.0")
MIXED = arm("RP", rigid="r").replace(  # a rigid drive and one with springs, a turning joint and a sliding one
    "= 27.027", "= 90.0"
)  # springs whose inverse needs corrections, which take other operations than those of the presets
CHAINS = {"R": arm("R"), "RR": arm("RR"), "RPR": arm("RPR", rigid="r"), "6R": arm("RRRRRR", rigid="fffrrr")}
