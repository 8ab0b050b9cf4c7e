"""Base parameters: the combinations of the links' inertial parameters that a motion with measured torques can tell.

The torques of a chain are linear in the mass M, the first moments MX, MY, MZ and the inertia XX, YY, ZZ, XY, XZ, YZ
about the joint's origin of each link, in the joint's frame. Columns of that regressor at random states are taken from
the base outward; one that earlier columns combine to shows nothing new and adds to their parameters.

Source: Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic Systems 8 (1991) 485; the
names are those of Khalil, Dombre, Modeling, Identification and Control of Robots (2002), ch. 9.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gen.model.chain_dynamics import ChainDynamics
from gen.model.kinematic_chain import Body
from gen.model.spatial_vectors import multiply_matrix, rotate_inertia

LINK_PARAMETERS = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")
STATES_PER_JOINT = 12  # random ones: several times as many torques as parameters
SPEED, ACCELERATION = 3.0, 10.0  # of the random states, rad/s and rad/s²
INDEPENDENCE = 1e-8  # of a column, from which its part across the others is more than rounding
RANK_ROUNDING = 1e-7  # of a coefficient


@dataclass(frozen=True)
class BaseParameter:
    """A combination of inertial parameters that a motion shows.

    Attributes:
        name: The first of them, such as "ZZ1".
        others: Those that it cannot be told from, each with its coefficient in SI units.

    """

    name: str
    others: tuple[tuple[str, float], ...]


class _FreeBodies(ChainDynamics):
    """A chain whose links have the ten parameters of ``bodies`` (10 n) in the joints' stated frames."""

    bodies: Any

    def rigid_bodies(self, p: Mapping[str, Any]) -> list[Body]:
        found = []
        for j, link in enumerate(self.links):
            mass, x, y, z, *inertia = ca.vertsplit(self.bodies[10 * j : 10 * j + 10])
            moment = multiply_matrix(link.turn, (x, y, z))
            found.append(Body(mass, moment, rotate_inertia(link.turn, tuple(inertia))))
        return found


def find_base_parameters(chain: ChainDynamics, values: Mapping[str, float]) -> tuple[list[BaseParameter], list[str]]:
    """Find the base parameters of a chain in space.

    Args:
        chain: The chain.
        values: Gravity by the names of its components, and all else that the chain's geometry names.

    Returns:
        The base parameters from the base outward, and the inertial parameters that no motion shows.

    """
    regressor = evaluate_regressor(chain, values)
    names = [f"{name}{j}" for j in range(1, chain.n + 1) for name in LINK_PARAMETERS]
    sizes = np.linalg.norm(regressor, axis=0)
    unseen = sizes <= INDEPENDENCE * sizes.max()
    kept: list[int] = []
    basis = np.zeros((regressor.shape[0], 0))
    for k in map(int, np.flatnonzero(~unseen)):
        rest = regressor[:, k] / sizes[k]
        for _ in range(2):  # once more for what rounding leaves
            rest = rest - basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > INDEPENDENCE:
            kept.append(k)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    added = [int(k) for k in np.flatnonzero(~unseen) if k not in kept]
    shares = np.linalg.lstsq(regressor[:, kept], regressor[:, added], rcond=None)[0]
    found = []
    for row, first in enumerate(kept):
        others = [(names[other], _clean(shares[row, column])) for column, other in enumerate(added)]
        found.append(BaseParameter(names[first], tuple((name, share) for name, share in others if share)))
    return found, [names[k] for k in np.flatnonzero(unseen)]


def _clean(value: float) -> float:
    """A coefficient without what only rounding keeps from a whole number."""
    near = float(round(value))
    return near if abs(value - near) < RANK_ROUNDING else float(value)


def evaluate_regressor(chain: ChainDynamics, values: Mapping[str, float]) -> np.ndarray:
    """Evaluate the torques by each inertial parameter at random states.

    Args:
        chain: The chain.
        values: As for `find_base_parameters`.

    Returns:
        (torques × 10 n): a column is the torques of all states with one parameter 1 and the others 0.

    """
    n, many = chain.n, chain.n * STATES_PER_JOINT
    free = _FreeBodies(chain.links, chain.tip, chain.in_space)
    free.bodies = ca.SX.sym("bodies", 10 * n)
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    field = [values[f"gravity_{axis}"] for axis in chain.axes]
    torque = free.newton_euler(q, ca.vertsplit(v), ca.vertsplit(a), values, field)
    f = ca.Function("torque", [q, v, a, free.bodies], [torque])
    rng = np.random.default_rng(0)
    states = [rng.uniform(-size, size, (n, many)) for size in (np.pi, SPEED, ACCELERATION)]
    each = f.map(many)
    columns = [np.array(each(*states, np.tile(unit[:, None], many))).T.ravel() for unit in np.eye(10 * n)]
    return np.column_stack(columns)
