"""Elements of contiguous arrays, taken as C++ takes them.

Warp's own indexing multiplies by a stride and looks whether the number is negative each time: six instructions, a dozen
times for each spring. So the innermost loops read and write with these. Numbers must be in range, and arrays
contiguous, as all of a model's are. Where there are gradients it is Warp's indexing, of which Warp knows the adjoint.
"""

import warp as wp

from .precision import OPTIONS, mat33, real, vec3

if OPTIONS["enable_backward"]:

    @wp.func
    def vector_at(array: wp.array(dtype=vec3), i: int):
        return array[i]

    @wp.func
    def real_at(array: wp.array(dtype=real), i: int):
        return array[i]

    @wp.func
    def pair_at(array: wp.array(dtype=wp.vec2i), i: int):
        return array[i]

    @wp.func
    def int_at(array: wp.array(dtype=wp.int32), i: int):
        return array[i]

    @wp.func
    def triple_at(array: wp.array2d(dtype=wp.int32), i: int):
        return wp.vec3i(array[i, 0], array[i, 1], array[i, 2])

    @wp.func
    def matrix_at(array: wp.array(dtype=mat33), i: int):
        return array[i]

    @wp.func
    def put(array_out: wp.array(dtype=vec3), i: int, value: vec3):
        array_out[i] = value

else:

    @wp.func_native("return array.data[i];")
    def vector_at(array: wp.array(dtype=vec3), i: int) -> vec3: ...

    @wp.func_native("return array.data[i];")
    def real_at(array: wp.array(dtype=real), i: int) -> real: ...

    @wp.func_native("return array.data[i];")
    def pair_at(array: wp.array(dtype=wp.vec2i), i: int) -> wp.vec2i: ...

    @wp.func_native("return array.data[i];")
    def int_at(array: wp.array(dtype=wp.int32), i: int) -> int: ...

    @wp.func_native("const int* row = array.data + 3 * i; return {row[0], row[1], row[2]};")
    def triple_at(array: wp.array2d(dtype=wp.int32), i: int) -> wp.vec3i: ...

    @wp.func_native("return array.data[i];")
    def matrix_at(array: wp.array(dtype=mat33), i: int) -> mat33: ...

    @wp.func_native("array_out.data[i] = value;")
    def put(array_out: wp.array(dtype=vec3), i: int, value: vec3): ...
