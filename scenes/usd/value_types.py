"""Attributes of another type than they should have, whose values nobody could use."""

import numpy as np
from pxr import Sdf, Usd

from ...errors import UsdError
from .roles import REST_SHAPE

KINDS = Sdf.ValueTypeNames
READ = {  # what we take numbers from: of schemas, of the proposal for deformables, and our own notes
    "points": KINDS.Point3fArray,
    "faceVertexCounts": KINDS.IntArray,
    "faceVertexIndices": KINDS.IntArray,
    "holeIndices": KINDS.IntArray,
    "indices": KINDS.IntArray,
    "primvars:displayColor": KINDS.Color3fArray,
    "radius": KINDS.Double,
    "height": KINDS.Double,
    "size": KINDS.Double,
    "physics:dynamicFriction": KINDS.Float,
    "physics:restitution": KINDS.Float,
    "physics:gravityDirection": KINDS.Vector3f,
    "physics:gravityMagnitude": KINDS.Float,
    "physics:thicknesses": KINDS.FloatArray,
    REST_SHAPE: KINDS.Point3fArray,
    "warpcloth:motion:times": KINDS.DoubleArray,
    "warpcloth:motion:positions": KINDS.Double3Array,
    "warpcloth:motion:rotations": KINDS.Double3Array,
    "warpcloth:motion:pivot": KINDS.DoubleArray,
}


def refuse_other_types(prim: Usd.Prim) -> None:
    """Refuses a prim with an attribute to which some layer gives another type than it must have for us to read it.

    OpenUSD hands such values out as they are. Precision and role do not matter: points may be ``double3[]``.

    Raises:
        UsdError: naming the attribute and both types.
    """
    for attribute in prim.GetAuthoredAttributes():
        wanted = READ.get(attribute.GetName())
        if wanted is None:
            continue
        for said in (spec.typeName for spec in attribute.GetPropertyStack()):
            if _form(said) != _form(wanted):
                raise UsdError(f"Attribute {attribute.GetPath()} is of type {said}, but must be of type {wanted}.")


def _form(kind: Sdf.ValueTypeName) -> tuple[bool, tuple[int, ...], bool]:
    """Whether a type is an array, the shape of one value, and whether that is of numbers."""
    value = np.asarray(kind.scalarType.defaultValue)
    return kind.isArray, value.shape, value.dtype.kind in "biuf"
