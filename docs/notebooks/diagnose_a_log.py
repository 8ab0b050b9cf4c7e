# %% [markdown]
# # Diagnose a log
#
# A machine logs its motion, and the model of its robot file does not quite predict it. Which physical effect does
# the model lack? Here the machine is simulated, so that the answer is known; with a machine of your own, start at
# step 3. Everything is written into a temporary folder.

# %%
import tempfile
from pathlib import Path

import numpy as np

import hdagen

folder = tempfile.TemporaryDirectory()
here = Path(folder.name)

# %% [markdown]
# ## 1. A robot file
#
# One joint with a rigid drive swings a link in gravity. All numbers are in SI units.

# %%
robot_file = here / "robot.toml"
robot_file.write_text("""
name = "pendulum"
gravity = [0.0, -9.81]
force_noise = 0.0

[[joint]]
length = 0.3
mass = 1.2
center_of_mass = 0.15
inertia = 0.01
[joint.drive]
rigid = true
ratio = 50.0
motor_inertia = 2e-5
torque_constant = 0.05
max_current = 10.0
viscous_friction = 1e-4
coulomb_friction = 0.01
friction_smoothing = 1.0
[joint.limits]
motor_torque_rate = 1000.0
[joint.sensor]
motor_encoder_resolution = 0.0015
joint_encoder_resolution = 2e-5
current_noise = 0.01
""")
robot = hdagen.load_robot(robot_file)

# %% [markdown]
# ## 2. A machine with something else in it
#
# The machine is the same model with a torque ripple of 3 mN m, six times a turn of the motor, of which the robot
# file knows nothing. A controller drives it, and its sensors write the log.

# %%
machine = hdagen.load_robot(robot_file, effects=("torque_ripple",))
machine.parameters["ripple_sine_1"] = 0.003

period = 0.001
time = np.arange(4000) * period
frequencies, sizes = np.array([0.47, 1.31, 2.93]), np.array([0.5, 0.25, 0.06])  # Hz, rad
angle = 2 * np.pi * frequencies * time[:, None]
motion = hdagen.Reference(
    space="joint",
    period=period,
    position=-1.2 + ((1 - np.cos(angle)) @ sizes)[:, None],
    velocity=(np.sin(angle) @ (2 * np.pi * frequencies * sizes))[:, None],
    acceleration=(np.cos(angle) @ ((2 * np.pi * frequencies) ** 2 * sizes))[:, None],
)
guard = hdagen.Guard(safe=hdagen.Safe.DAMPING, safe_damping=(1e-3,))
controller = hdagen.Controller(robot, "position", guard)
log = hdagen.simulate(machine, controller, motion, seed=1)
log_file = here / "log.parquet"
hdagen.log.write(log, log_file)

# %% [markdown]
# ## 3. Is the log usable?
#
# `hdagen.check` says, before anything is fitted, which mistakes the log has, and which of them are repaired.

# %%
found = hdagen.check(robot, log_file)
print(found)
assert found.is_usable

# %% [markdown]
# ## 4. How far does the model miss it?
#
# A replay simulates the log again in windows of 0.25 s, from its commands. Its errors count in multiples of the
# noise.

# %%
before = hdagen.replay(robot, log_file)
print(f"gap before: {before.gap:.3g} times the noise")

# %% [markdown]
# ## 5. The diagnosis
#
# Every effect is tried on every joint, together with the base parameters within their tolerance. A fifth of the log
# is kept from the fit and measures the gap.

# %%
diagnosis = hdagen.diagnose(robot, log_file)
print(diagnosis.sentence)
print(diagnosis.table())

# %% [markdown]
# The parameters, of the named effects first:

# %%
print(diagnosis.parameters())

# %% [markdown]
# ## 6. Take the result home
#
# `save` writes diagnosis.json and report.html. `adopt` writes the robot file with the verdict in it. Replayed with
# the verdict, the model predicts the log.

# %%
diagnosis.save(here / "diagnosis")
adopted = hdagen.adopt(diagnosis, robot_file, here / "robot.new.toml")
print("\n".join(adopted.difference))
after = hdagen.replay(robot, log_file, diagnosis=diagnosis)
print(f"gap after: {after.gap:.3g} times the noise")
assert diagnosis.verdict == ("torque_ripple@1",)
assert after.gap < before.gap / 3

# %%
folder.cleanup()
