"""The scalar and vector types of the variant that this copy of the file belongs to (see the package docstring)."""

import warp as wp

_variant = __name__.split(".")[-2]

real = wp.float64 if _variant.startswith("float64") else wp.float32
vec2 = wp.types.vector(2, real)
vec3 = wp.types.vector(3, real)
vec4 = wp.types.vector(4, real)
mat33 = wp.types.matrix((3, 3), real)

OPTIONS = {"enable_backward": _variant.endswith("_grad")}
FORWARD_ONLY = {"enable_backward": False}  # for what no gradient goes through
