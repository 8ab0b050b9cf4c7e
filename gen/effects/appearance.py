"""How effects show themselves: the experiments, plots and readings that their files choose from.

A build's manifest carries these choices, so that a diagnosis explains, draws and separates an effect without knowing
its name.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum


@dataclass(frozen=True)
class Experiment:
    """The experiment that shows one effect.

    Attributes:
        action: What to do, an imperative.
        observation: How the effect shows then, a phrase of which the effect is the subject.

    """

    action: str
    observation: str


class ConfusionGroup(Enum):
    """Groups of effects that look alike in a log; the value is the experiment that tells the members apart.

    An effect lists its groups in its file. The narrowest group stands first: of two effects the first group that has
    both is taken.
    """

    BIAS_OR_DIRECTION = (
        "let the joint rest and creep in both directions with slowly rising current: a bias also shifts what "
        "holds it at rest, friction by direction shows only in motion."
    )
    ENCODER_ERROR = (
        "turn the joint slowly through as much of a turn as it can: a bias is the same at every angle, what an "
        "eccentric disc adds grows and comes back once a turn."
    )
    PERIODIC = (
        "run at several constant speeds and log both encoders and the current: a kinematic error lives in the "
        "motor-to-joint angle and its torque grows with the square of speed, ripple lives in the current, at "
        "creep as well."
    )
    TORSION_LOOP = (
        "hold the link and load the gear to and fro with several torques, slowly and faster: a spring comes back "
        "on its own line, hysteresis encloses a loop that is as wide at any rate, a damper's widens with the "
        "rate."
    )
    SOFT_MODE = (
        "command a multisine up to 25 Hz at two payloads, and push the tip with the motor held: a mode behind the "
        "encoder moves with the payload, the gear's own shows between its encoders."
    )
    TORSION_OR_READING = (
        "run several constant speeds under unequal loads with both encoders: a late reading is proportional to "
        "speed whatever the load, torsion follows the load whatever the speed."
    )
    COMMAND_PATH = (
        "command a multisine up to 25 Hz and log the measured current: a delay turns the phase alone, a lag the "
        "magnitude as well, a limit only large commands, and a soft joint leaves the current untouched."
    )
    INERTIA_OR_WEIGHT = (
        "hold still at five or more poses, then accelerate hard with the arm folded and stretched: weight shows mass "
        "times its lever, a pose that changes the inertia shows the links, what stays alike in all is the rotor."
    )
    GAIN_OR_MASS = (
        "swap a known payload, and let the joint coast down without current, cold and warm: the mass shows in the "
        "first, friction alone in the second, and the torque constant only while current flows."
    )
    REVERSAL = (
        "reverse slowly with several amplitudes about several preloads: hysteresis remembers its turning points, "
        "friction goes with the sign of speed, backlash jumps where the torque changes sign, a spring does none "
        "of it."
    )
    FRICTION_BY_CONDITION = (
        "repeat one speed at several loads and joint angles in shuffled order, cold and warm: what follows load, "
        "angle and time parts there."
    )
    FRICTION_BY_SPEED = (
        "hold about ten constant speeds in both directions, from creep to the fastest: each has its own curve of "
        "friction over speed."
    )
    POSE = (
        "hold still at five or more poses across the range, reached from both sides: weight goes with the pose's "
        "lever, a cable with the angle itself, and an encoder's error needs no torque at all."
    )
    RANGE_END = (
        "approach both ends of the range slowly and go back: a stop pushes only beyond an angle, a cable "
        "everywhere, friction changes its sign with the direction."
    )
    ANGLE_ERROR = (
        "turn the joint slowly through its whole range without load and log both encoders: a ratio errs in "
        "proportion to the angle, periodic errors come back, torque and springs play no part."
    )


class PlotKind(StrEnum):
    """The picture that shows an effect."""

    RESIDUAL = "residual"  # missing torque, angle or reading over the abscissa
    INPUT = "input"  # the input that acts, over time and over its command
    FRICTION = "friction"  # all friction of a motor over the abscissa
    FRICTION_BEYOND_BASE = "friction_beyond_base"  # friction beyond Coulomb's and the viscous one, over the abscissa
    TORSION = "torsion"  # transmitted torque over torsion


class Abscissa(StrEnum):
    """The quantity over which an effect is drawn."""

    COMMAND = "command"
    COMMAND_RATE = "command_rate"
    FIRST_JOINT_ACCELERATION = "first_joint_acceleration"
    JOINT_ACCELERATION = "joint_acceleration"
    JOINT_ANGLE = "joint_angle"
    JOINT_SPEED = "joint_speed"
    LOAD = "load"
    MOTOR_ANGLE = "motor_angle"  # within a turn
    MOTOR_INPUT = "motor_input"
    MOTOR_SPEED = "motor_speed"
    MOTOR_TRAVEL = "motor_travel"  # since the last reversal
    TIME = "time"
    TORSION = "torsion"


KIND_OF_ABSCISSA = {  # abscissae that one kind of plot has alone; these kinds have no other
    Abscissa.COMMAND: PlotKind.INPUT,
    Abscissa.COMMAND_RATE: PlotKind.INPUT,
    Abscissa.TORSION: PlotKind.TORSION,
}


@dataclass(frozen=True)
class Plot:
    """The plot that fits an effect: its kind, and the quantity on its abscissa."""

    kind: PlotKind
    abscissa: Abscissa

    def __post_init__(self) -> None:
        """Refuse an abscissa that only another kind of plot has.

        Raises:
            ValueError: The abscissa does not go with the kind.

        """
        kind_alone = KIND_OF_ABSCISSA.get(self.abscissa)
        if kind_alone is not self.kind and (kind_alone or self.kind in KIND_OF_ABSCISSA.values()):
            raise ValueError(
                f"plot: found {self.kind} over {self.abscissa}, which do not go together; possible are input over "
                "command or command_rate, torsion over torsion, and any other kind over any other abscissa."
            )


class Residual(StrEnum):
    """The residual that shows an effect."""

    AT_PLACE = "at_place"  # that of the effect's place: an input, a torque, or an encoder's reading
    GEAR_ANGLE = "gear_angle"  # an angle in the transmission
    TORQUE_READING = "torque_reading"  # the reading of the torque sensor, where that is logged


class EncoderTerm(StrEnum):
    """How a parameter changes the motor's angle over the ratio less the reading of the joint's encoder."""

    CONSTANT = "constant"
    JOINT_SINE = "joint_sine"  # sine of the joint angle
    JOINT_COSINE = "joint_cosine"
    JOINT_SPEED = "joint_speed"
    TORQUE_SIGN = "torque_sign"  # half of it by the sign of the torque
    MOTOR_SINE_ONCE = "motor_sine_once"  # sine of the motor angle
    MOTOR_COSINE_ONCE = "motor_cosine_once"
    MOTOR_SINE_TWICE = "motor_sine_twice"
    MOTOR_COSINE_TWICE = "motor_cosine_twice"
    MOTOR_SINE_FOUR = "motor_sine_four"
    MOTOR_COSINE_FOUR = "motor_cosine_four"
    ZERO_OFFSET = "zero_offset"  # what the waves of the effect were where the encoder was set to zero


@dataclass(frozen=True)
class Wall:
    """An obstacle beyond an angle: the names of its stiffness and of its angle, and the side of the range (1 or −1)."""

    stiffness: str
    edge: str
    side: int


@dataclass(frozen=True)
class SeriesSpring:
    """A spring that a drive gets which the robot file calls rigid: names of its compliance and of its damping."""

    compliance: str
    damping: str
