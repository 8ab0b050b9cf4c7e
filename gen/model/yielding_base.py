"""A base that turns: three joints before the chain, about x, y and z of the base frame, with springs and dampers.

Legend: C compliance, m moments of the springs, β = C m turns of the base; ω², ζ as in `gen.effects.base_compliance`;
a accelerations of the chain's joints; b = m̈; M mass matrix of base and chain together, with the blocks M_ββ, M_βq;
l, l_β loads without accelerations.

The base's own inertia about each axis is 1/(C ω²), so that it stands still where C is 0:

    (1 + C ω² M_ββ) b + ω² M_βq a = ω² l_β − ω² m − 2 ζ ω ṁ,    M a + C M_qβ b = l

These are solved for b first. Nothing is divided by C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from gen.model.chain_dynamics import ChainDynamics
from gen.model.kinematic_chain import ChainLink
from gen.model.spatial_vectors import NO_VECTOR, Matrix
from gen.model.symmetric_matrices import invert_symmetric

SX = ca.SX
BASE_JOINTS = 3
NEXT_AXIS: Matrix = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))  # turns z to x, x to y, y to z


def add_base_joints(chain: ChainDynamics) -> ChainDynamics:
    """Put three revolute joints without mass before a chain, about x, y and z of the base frame.

    Args:
        chain: The chain.

    Returns:
        The longer chain; at angles 0 of the new joints the frames of the old ones are where they were.

    """
    hinge = ChainLink("revolute", NEXT_AXIS, NO_VECTOR, 0, NO_VECTOR, (0, 0, 0, 0, 0, 0))
    return ChainDynamics((*(replace(hinge) for _ in range(BASE_JOINTS)), *chain.links), chain.tip, in_space=True)


@dataclass(frozen=True)
class YieldingBase:
    """The state and the numbers of a base that turns.

    Attributes:
        compliance: C, rad/(N m).
        squared_frequency: ω², 1/s².
        moments: m (3), N m.
        moment_rates: ṁ (3), N m/s.
        pulls: −ω² m − 2 ζ ω ṁ (3), N m/s².

    """

    compliance: Any
    squared_frequency: Any
    moments: Any
    moment_rates: Any
    pulls: Any

    def condense(self, mass: Any, load: Any) -> tuple[Any, Any]:
        """Eliminate the base from the equations of motion.

        Args:
            mass: Mass matrix of base and chain ((3 + n) × (3 + n)).
            load: Loads of base and chain without accelerations (3 + n).

        Returns:
            Mass matrix and load of the chain alone (n × n and n), where the base yields.

        """
        cross, inverse = self._split(mass)
        pushed = self.squared_frequency * load[:BASE_JOINTS] + self.pulls
        own = mass[BASE_JOINTS:, BASE_JOINTS:]
        yielded = self.compliance * self.squared_frequency * (cross @ inverse @ cross.T)
        return own - yielded, load[BASE_JOINTS:] - self.compliance * (cross @ (inverse @ pushed))

    def find_acceleration(self, mass: Any, load: Any, accelerations: Any) -> Any:
        """Find b at given accelerations of the chain.

        Args:
            mass: As in `condense`.
            load: As in `condense`.
            accelerations: a (n).

        Returns:
            b (3), N m/s².

        """
        cross, inverse = self._split(mass)
        free = load[:BASE_JOINTS] - cross.T @ accelerations
        return inverse @ (self.squared_frequency * free + self.pulls)

    def condense_slopes(self, mass: Any, by_load: Any, by_base: Any) -> Any:
        """Eliminate the base from derivatives of the residuals of both equations.

        Args:
            mass: As in `condense`.
            by_load: Derivatives of the chain's residual (n × k).
            by_base: Those of the base's (3 × k).

        Returns:
            The right-hand side of the chain's equation of derivatives (n × k).

        """
        cross, inverse = self._split(mass)
        return by_load - self.compliance * (cross @ (inverse @ by_base))

    def find_slopes(self, mass: Any, by_base: Any, slopes: Any) -> Any:
        """Find the derivatives of b.

        Args:
            mass: As in `condense`.
            by_base: As in `condense_slopes`.
            slopes: Derivatives of a (n × k).

        Returns:
            Those of b (3 × k).

        """
        cross, inverse = self._split(mass)
        return inverse @ (by_base - self.squared_frequency * (cross.T @ slopes))

    def _split(self, mass: Any) -> tuple[Any, Any]:
        """M_qβ, and the inverse of 1 + C ω² M_ββ."""
        own = SX.eye(BASE_JOINTS) + self.compliance * self.squared_frequency * mass[:BASE_JOINTS, :BASE_JOINTS]
        return mass[BASE_JOINTS:, :BASE_JOINTS], invert_symmetric(own)

    def find_energy(self) -> tuple[Any, Any]:
        """Find the energy of the base's own inertia and of its springs.

        Returns:
            Kinetic and potential energy, J.

        """
        kinetic = self.compliance / self.squared_frequency * ca.sumsqr(self.moment_rates) / 2
        return kinetic, self.compliance * ca.sumsqr(self.moments) / 2
