"""The links of arms in the plane, by their type."""

from __future__ import annotations

from gen.robot.description import Joint, PlanarLink


def get_planar_link(joint: Joint) -> PlanarLink:
    """The link of a joint of the short form."""
    assert isinstance(joint.link, PlanarLink)
    return joint.link
