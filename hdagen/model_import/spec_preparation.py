"""A model's document made ready for MuJoCo's compiler: no part that needs a file, no inertia that stops it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen.model_import.model_file import ModelError, ModelFile
from hdagen.model_import.possible_inertia import is_possible_inertia

NO_MECHANICS = (
    "keys", "sensors", "actuators", "equalities", "tendons", "pairs", "excludes", "skins", "flexes",
    "meshes", "hfields", "materials", "textures", "cameras", "lights", "tuples", "numerics", "texts",
)  # fmt: skip
USER_SIZES = tuple(f"nuser_{kind}" for kind in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor"))
NO_SIZE = {"nuserdata": 0, "nkey": 0}  # which a file may state, and a chain does not need; of others MuJoCo chooses
TRIANGLE_ERROR = 1e-6  # share by which a rounded moment may be above the sum of the others
PLACEHOLDER = 1e-6  # kg and kg m² of a moving body without mass, which MuJoCo refuses; taken off again


def strip_geometry(spec: Any, file: ModelFile) -> set[str]:
    """Take out what needs files or is not mechanics of the tree.

    Args:
        spec: The document as MuJoCo read it; changed in place.
        file: The model file.

    Returns:
        Names of the bodies without mass, some of which get a placeholder.

    Raises:
        ModelError: A mass is negative, or an inertia would come from a mesh.

    """
    weightless = set()
    automatic = spec.compiler.inertiafromgeom.name.endswith("AUTO")
    always = spec.compiler.inertiafromgeom.name.endswith("TRUE")
    for number, body in enumerate(spec.bodies):
        body.name = body.name or f"body_{number}"
        states = bool(body.explicitinertial) and not always
        if states:
            _check_inertial(body, file, bool(spec.compiler.balanceinertia))
        uses_geometry = not states and (always or automatic) and not file.is_urdf and _moves(body, spec.worldbody)
        shapes = [geom for geom in body.geoms if uses_geometry and _has_weight(geom)]
        if any(geom.type.name in ("mjGEOM_MESH", "mjGEOM_SDF", "mjGEOM_HFIELD") for geom in shapes):
            raise ModelError(
                f"{file.label}, body {body.name}: found no inertia but that of a mesh, which is"
                " not read, as a mesh is the hull of a body and not its mass; write <inertial> into the body."
            )
        for geom in list(body.geoms):
            if geom not in shapes:
                _empty_shape(spec, geom)
        if states and body.mass > 0:
            continue
        if body is not spec.worldbody and not shapes and body.name != "world":
            weightless.add(body.name)
            if body.joints:
                body.explicitinertial, body.mass = True, PLACEHOLDER
                body.inertia = [PLACEHOLDER] * 3
                body.fullinertia = [float("nan")] * 6
    for kind in NO_MECHANICS:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    for size in ("memory", "nuserdata", "nkey", "nconmax", "njmax", "nstack", *USER_SIZES):
        setattr(spec, size, NO_SIZE.get(size, -1))
    spec.compiler.fusestatic = False
    spec.compiler.inertiafromgeom = type(spec.compiler.inertiafromgeom).mjINERTIAFROMGEOM_AUTO
    return weightless


def replace_impossible_inertias(spec: Any, tensors: dict[str, NDArray[np.float64] | None]) -> set[str]:
    """Put a possible inertia in place of each that no body has.

    MuJoCo refuses a whole model for the frame of one sensor. The inertia of a link is judged later, with all that is
    welded to it and only where the chain needs it.

    Args:
        spec: The document as MuJoCo read it; changed in place.
        tensors: The inertia that each body states, (3 × 3), kg m²; six zeros, which MuJoCo reads as none, are added.

    Returns:
        Names of these bodies.

    """
    found = set()
    for body in spec.bodies:
        tensor = tensors.get(body.name)
        if tensor is None and body.explicitinertial and body.mass > 0 and not np.any(body.inertia):
            tensor = tensors[body.name] = np.zeros((3, 3))  # MuJoCo reads six zeros as none stated
        if tensor is None or not np.isfinite(tensor).all():
            continue
        if is_possible_inertia(tensor):
            continue
        found.add(body.name)
        body.inertia = [PLACEHOLDER] * 3
        body.fullinertia = [float("nan")] * 6
    return found


def _check_inertial(body: Any, file: ModelFile, is_balanced: bool) -> None:
    """Refuse a negative mass, and principal moments of an MJCF's body that no body has; MuJoCo mends balanced ones."""
    if body.mass < 0:
        raise ModelError(
            f"{file.label}, body {body.name}: found the mass {body.mass:g} kg, possible are numbers from 0;"
            " correct <inertial>."
        )
    moments = np.asarray(body.inertia, float)
    by_six = not np.isnan(np.asarray(body.fullinertia)[0])  # of which MuJoCo finds the moments later
    if file.is_urdf or is_balanced or by_six or not np.isfinite(moments).all():
        return
    if moments.min() < 0 or 2 * moments.max() > moments.sum() * (1 + TRIANGLE_ERROR):
        found = ", ".join(f"{moment:g}" for moment in moments)
        raise ModelError(
            f"{file.label}, body {body.name}: found the principal moments {found} kg m², possible are numbers from 0 of"
            " which none is above the sum of the others; correct <inertial>."
        )


def _empty_shape(spec: Any, geom: Any) -> None:
    """Make a shape a ball without mass or assets; MuJoCo takes milliseconds to delete one of a thousand."""
    if geom.plugin.active:
        spec.delete(geom)
        return
    geom.type, geom.size, geom.mass = type(geom.type).mjGEOM_SPHERE, [1.0, 0.0, 0.0], 0.0
    geom.fromto = [float("nan")] * 6
    geom.meshname = geom.hfieldname = geom.material = ""


def _moves(body: Any, world: Any) -> bool:
    """Whether a joint moves the body."""
    while body is not None and body.name != world.name:
        if body.joints:
            return True
        body = body.parent
    return False


def _has_weight(geom: Any) -> bool:
    """Whether MuJoCo would count a shape into its body's mass."""
    return not (geom.mass == 0 or (np.isnan(geom.mass) and geom.density == 0))
