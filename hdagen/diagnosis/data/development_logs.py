"""The logs that settings of a diagnosis were chosen on, in words; none of the sealed checks has a log of these."""

from __future__ import annotations

KNOWN_EFFECTS = (
    "logs with known effects, among them sealed ones of seeds that no check uses, and so that EMPS and KUKA kept the "
    "effects that they named then"
)
UNKNOWN_TORQUES = (
    "development logs with torques that no effect describes, alone and beside a known effect, and with friction that "
    "the robot file leaves out"
)
EARLIER_LOGS = "not known: it is older than the statement of the error that remains"
JOINT_ARMS = (
    "twelve arms of `hdagen blind --family joint --kind single --cases 12 --seed check-61-a-joint-single`, a seed that "
    "no check uses any more"
)
