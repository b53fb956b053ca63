"""A tree of boxes for the CPU: nodes have eight children, which are tested at once.

Leaves hold eight triangles each, their ways and corners in rows, so that what a triangle meets is known for eight at a
time. Nodes are numbered level by level, leaves first; lane k of node i has the slot 8 i + k. Warp's own trees have two
children a node, and test one box after the other.
"""

import sys

import warp as wp

from .contact_candidates import TrianglePairs, groups_of, list_pair
from .contact_ways import Way, highest, lowest
from .direct import triple_at
from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

WIDTH = 8
BOX = wp.constant(6 * WIDTH)  # numbers of a node: three rows of lower corners, three of upper ones
WAY = wp.constant(12 * WIDTH)  # numbers of a leaf: the same at the start of ways, and at their end
EMPTY = wp.constant(1.0e30)
FARTHEST = wp.constant(1.0e29)  # [m] that is looked for; what has diverged would find lanes that are empty
DEEPEST = 9  # levels: 8⁹ triangles
Stack = wp.types.vector(DEEPEST * (WIDTH - 1) + 1, wp.int32)


@wp.struct
class WideTree:
    """The shape of a tree; −1 stands for none. ``child`` is the first child of a node, none of a leaf; ``parent`` the
    slot of a node in its parent; ``triangle`` and ``corner`` what a leaf has; ``root`` that of a group."""

    child: wp.array(dtype=wp.int32)
    parent: wp.array(dtype=wp.int32)
    triangle: wp.array(dtype=wp.int32)
    corner: wp.array(dtype=wp.int32)
    root: wp.array(dtype=wp.int32)


@wp.struct
class Contents:
    """What is in a tree: boxes of the children of nodes that are no leaves, ways of a leaf's triangles, and whether
    these have moved."""

    box: wp.array(dtype=wp.float32)
    way: wp.array(dtype=wp.float32)
    moved: wp.array(dtype=wp.int32)


@wp.func
def put_box(box_out: wp.array(dtype=wp.float32), at: int, low: wp.vec3, high: wp.vec3):
    """A box into a lane of rows."""
    for k in range(3):
        box_out[at + WIDTH * k] = low[k]
        box_out[at + WIDTH * (3 + k)] = high[k]


@wp.func
def put_in_parent(tree: WideTree, node: int, low: wp.vec3, high: wp.vec3, box_out: wp.array(dtype=wp.float32)):
    """The box of a node into its parent, if it has one."""
    slot = tree.parent[node]
    if slot >= 0:
        leaves = tree.triangle.shape[0] / WIDTH
        put_box(box_out, BOX * (slot / WIDTH - leaves) + slot % WIDTH, low, high)


@wp.kernel
def fit_leaves(
    # Model
    thread_offset: int,
    tree: WideTree,
    # State in
    known: wp.array(dtype=Way),
    moved: wp.array(dtype=wp.int32),
    stray: float,
    # Out
    contents_out: Contents,
):
    """Ways of the triangles of each leaf, and the box of all of them in its parent."""
    node = thread_offset + wp.tid()
    low = wp.vec3(EMPTY)
    high = wp.vec3(-EMPTY)
    for lane in range(WIDTH):
        t = tree.triangle[WIDTH * node + lane]
        if t >= 0:
            way = known[t]
            low = wp.min(low, lowest(way, stray))
            high = wp.max(high, highest(way, stray))
            put_box(contents_out.way, WAY * node + lane, way.low, way.high)
            put_box(contents_out.way, WAY * node + BOX + lane, way.end_low, way.end_high)
            contents_out.moved[WIDTH * node + lane] = moved[t]
    put_in_parent(tree, node, low, high, contents_out.box)


@wp.kernel
def fit_nodes(
    # Model
    thread_offset: int,
    first: int,
    tree: WideTree,
    # Out
    contents_out: Contents,
):
    """The box of all children of each node of a level, the first of which is ``first``, in its parent."""
    node = first + thread_offset + wp.tid()
    low = wp.vec3(EMPTY)
    high = wp.vec3(-EMPTY)
    for lane in range(WIDTH):
        box = contents_out.box
        at = BOX * (node - tree.triangle.shape[0] / WIDTH) + lane
        low = wp.min(low, wp.vec3(box[at], box[at + WIDTH], box[at + 2 * WIDTH]))
        at += 3 * WIDTH
        high = wp.max(high, wp.vec3(box[at], box[at + WIDTH], box[at + 2 * WIDTH]))
    put_in_parent(tree, node, low, high, contents_out.box)


_BITS = ", ".join(str(1 << lane) for lane in range(WIDTH))


def _for_cpu(code: str) -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    typedef float F __attribute__((ext_vector_type({WIDTH})));
    typedef int I __attribute__((ext_vector_type({WIDTH})));
    auto bits = [](I mask) {{ return __builtin_reduce_or(mask & I{{{_BITS}}}); }};
    auto row = [](const float* from, int k) {{ F f; __builtin_memcpy(&f, from + {WIDTH} * k, sizeof(F)); return f; }};
    auto whole = [](const int* from, int k) {{ I i; __builtin_memcpy(&i, from + {WIDTH} * k, sizeof(I)); return i; }};
    {code}
#endif
"""


_OVERLAP = _for_cpu(f"""
    const float* box = contents.box.data + {6 * WIDTH} * (long long)node;
    return bits((row(box, 0) <= high[0]) & (row(box, 1) <= high[1]) & (row(box, 2) <= high[2])
        & (row(box, 3) >= low[0]) & (row(box, 4) >= low[1]) & (row(box, 5) >= low[2]));
""")

# may_meet of contact_ways.py, and what add_pair of contact_candidates.py asks besides, for eight triangles.
_MEET = _for_cpu(f"""
    const int* corner = tree.corner.data + {3 * WIDTH} * (long long)leaf;
    const I u = whole(tree.triangle.data + {WIDTH} * (long long)leaf, 0);
    I apart = (u < t) & ((whole(contents.moved.data + {WIDTH} * (long long)leaf, 0) | all) != 0);
    apart |= u < 0;
    for (int k = 0; k < 3; ++k)
        apart |= (whole(corner, k) == mine[0]) | (whole(corner, k) == mine[1]) | (whole(corner, k) == mine[2]);
    const float* other = contents.way.data + {12 * WIDTH} * (long long)leaf;
    F along[3], gap[6], end_gap[6];
    for (int k = 0; k < 3; ++k) {{
        const F low = row(other, k), high = row(other, 3 + k);
        const F end_low = row(other, 6 + k), end_high = row(other, 9 + k);
        along[k] = way.end_low[k] - way.low[k] + way.end_high[k] - way.high[k] - (end_low - low + end_high - high);
        gap[k] = way.low[k] - high;
        gap[3 + k] = low - way.high[k];
        end_gap[k] = way.end_low[k] - end_high;
        end_gap[3 + k] = end_low - way.end_high[k];
    }}
    const F squared = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
    const F nearer = 0.5f * stray * __builtin_elementwise_sqrt(squared);
    for (int k = 0; k < 6; ++k) {{
        end_gap[k] -= nearer;
        apart |= (gap[k] > 0) & (end_gap[k] > 0);
    }}
    if (__builtin_reduce_and(apart)) return 0;
    F first = 0, last = 1;
    for (int k = 0; k < 6; ++k) {{
        const F meets = gap[k] / (gap[k] - end_gap[k]);
        first = ((gap[k] > 0) & (meets > first)) ? meets : first;
        last = ((gap[k] <= 0) & (end_gap[k] > 0) & (meets < last)) ? meets : last;
    }}
    return bits(~apart & ~(first > last));
""")

_LOWEST = """
#if defined(__CUDA_ARCH__)
    return __ffs(set) - 1;
#else
    return __builtin_ctz(set);
#endif
"""


@wp.func_native(_OVERLAP)
def overlapping(contents: Contents, node: int, low: wp.vec3, high: wp.vec3) -> int:
    """Which children's boxes overlap with one, a bit for each; ``node`` is counted from the first that is no leaf."""


@wp.func_native(_MEET)
def meeting(
    tree: WideTree, contents: Contents, leaf: int, t: int, mine: wp.vec3i, way: Way, stray: float, all: int
) -> int:
    """Which triangles of a leaf triangle t has to be listed with, a bit for each."""


@wp.func_native(_LOWEST)
def first_of(set: int) -> int:
    """The number of the lowest bit that is set, of at least one."""


@wp.kernel
def search_tree(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    tree: WideTree,
    cloth_tris: int,
    # State in
    moved: wp.array(dtype=wp.int32),
    anew: wp.array(dtype=wp.int32),
    known: wp.array(dtype=Way),
    stray: float,
    contents: Contents,
    # Out
    pairs_out: TrianglePairs,
):
    """The same as ``find_triangle_pairs`` of ``contact_candidates.py``."""
    t = thread_offset + wp.tid()
    if (moved[t] | anew[0]) == 0:
        return
    mine = triple_at(tri_indices, t)
    way = known[t]
    low = wp.max(lowest(way, stray), wp.vec3(-FARTHEST))
    high = wp.min(highest(way, stray), wp.vec3(FARTHEST))
    leaves = tree.triangle.shape[0] / WIDTH
    for group in range(groups_of(t, cloth_tris)):
        stack = Stack()
        stack[0] = tree.root[2 * particle_world[mine[0]] + group]
        height = int(1)
        if stack[0] < 0:
            height = 0
        while height > 0:
            height -= 1
            node = stack[height]
            if node < leaves:
                hits = meeting(tree, contents, node, t, mine, way, stray, anew[0])
                while hits != 0:
                    list_pair(t, tree.triangle[WIDTH * node + first_of(hits)], pairs_out)
                    hits = hits & (hits - 1)
            else:
                child = tree.child[node]
                hits = overlapping(contents, node - leaves, low, high)
                while hits != 0:
                    stack[height] = child + first_of(hits)
                    height += 1
                    hits = hits & (hits - 1)
