# %% [markdown]
# # Simulate and control
#
# A compiled arm is stepped, integrated and differentiated from numpy. Then a controller drives it along a circle
# while somebody pushes the tip.

# %%
import numpy as np

import hdagen

arm = hdagen.load_robot("paper")  # a preset, or the path of a robot.toml
print(arm)
print("states:", ", ".join(arm.state_names))
print("inputs:", ", ".join(arm.input_names))

# %% [markdown]
# ## Steps and trajectories
#
# All numbers are in SI units. `rest` finds the state in which springs hold the arm; `rollout` integrates rows of
# inputs, with dry friction that sticks exactly.

# %%
start = arm.rest([0.4, 0.9])  # joint positions, rad
inputs = np.zeros((500, arm.nu))
inputs[:, 0] = 3.0 * np.sin(2 * np.pi * 2.0 * np.arange(500) * arm.step_size)  # A, into motor 1
path = arm.rollout(start, inputs, exact=True)
tip = arm.outputs(path[:-1], inputs)["tip"]  # m, in the base frame
print(f"the tip moves by {1e3 * np.ptp(tip, axis=0).max():.3g} mm")

# %% [markdown]
# Derivatives of one step by state, input and parameters are exact:

# %%
slopes = arm.jacobians(start, inputs[0])
print("by state:", slopes.by_state.shape, "by parameter:", slopes.by_parameter.shape)

# %% [markdown]
# A parameter takes effect at the next call, without a build:

# %%
arm.parameters["mass_2"] = 1.5 * arm.parameters["mass_2"]
heavier = arm.rollout(start, inputs, exact=True)
ratio = np.ptp(heavier[:, 2]) / np.ptp(path[:, 2])
print(f"with half as much mass again joint 1 moves {ratio:.3g} times as far")

# %% [markdown]
# ## A closed loop
#
# A controller is a compiled law inside its guard. You choose the reaction to a fault: here the motors are damped.
# The tip follows a circle of 5 cm, and a force of 15 N pushes it for half a second.

# %%
arm = hdagen.load_robot("paper")
guard = hdagen.Guard(safe=hdagen.Safe.DAMPING, safe_damping=(1e-3, 1e-3))
controller = hdagen.Controller(arm, "impedance_cartesian", guard, {"stiffness_x": 800.0})
motion = hdagen.circle(radius=0.05, center=(0.2, 0.1), turn=2.0, seconds=3.0)
push = hdagen.Push(start=1.5, end=2.0, force=(15.0, 0.0))  # s and N
log = hdagen.simulate(arm, controller, motion, pushes=[push], seed=1)
print("fault:", controller.read_fault())

# %% [markdown]
# The log is what the machine's sensors would write: encoders with their steps and noise, currents, and the force at
# the tip. One seed gives one log, to the bit.

# %%
for name in ("motor_current_1", "joint_position_1", "tip_force_x"):
    print(f"{name}: {log[name].min():.3g} to {log[name].max():.3g}")

# %% [markdown]
# ## The way back
#
# A replay simulates the log again from its commands and forces. The model is the machine here. The noise of the
# force sensor drives the replay, so its error lies somewhat above the noise of the encoders.

# %%
replay = hdagen.replay(arm, log)
print(f"gap: {replay.gap:.3g} times the noise")
assert replay.gap < 30.0
