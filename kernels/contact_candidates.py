"""Candidates: pairs of triangles that may come near each other, kept while every triangle stays on its known way.

Each triangle has a *known* way, with room to spare; all pairs of triangles whose known ways may meet are listed. As
long as a triangle stays within, nothing about it can be missing from the list. Of one that leaves it the pairs are
dropped, and looked up again. Cloth that lies still costs nothing but the check.
"""

import sys

import warp as wp

from .contact_ways import Way, highest, lowest, may_meet
from .counting import count_up
from .direct import int_at, pair_at, triple_at
from .precision import FORWARD_ONLY

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

CHUNK = wp.constant(64)  # entries of a list that are counted together
SPARSE = wp.constant(2)  # a list with fewer pairs than one in so many entries is made anew


@wp.struct
class TrianglePairs:
    """A list of pairs of triangles, with holes where pairs were dropped.

    ``count`` of entries goes on beyond the length when that is too short, and ``peak`` remembers the greatest. ``hole``
    has the numbers of the ``holes`` entries without a pair, which are the first to be filled by those ``added``; it
    need not be longer than half of the list, which is made anew where there are more.
    """

    count: wp.array(dtype=wp.int32)
    peak: wp.array(dtype=wp.int32)
    pair: wp.array(dtype=wp.vec2i)
    hole: wp.array(dtype=wp.int32)
    holes: wp.array(dtype=wp.int32)
    added: wp.array(dtype=wp.int32)


@wp.func
def length_of(pairs: TrianglePairs):
    """Entries that can be looked at."""
    return wp.min(pairs.count[0], pairs.pair.shape[0])


@wp.func
def has(t: wp.vec3i, i: int):
    return t[0] == i or t[1] == i or t[2] == i


@wp.func
def common_vertex(t: wp.vec3i, u: wp.vec3i):
    return has(t, u[0]) or has(t, u[1]) or has(t, u[2])


@wp.func
def outdated(pairs: TrianglePairs, k: int, moved: wp.array(dtype=wp.int32)):
    """Whether entry k has a pair of which a triangle has moved."""
    pair = pair_at(pairs.pair, k)
    if pair[0] < 0:
        return False
    return (int_at(moved, pair[0]) | int_at(moved, pair[1])) == 1


@wp.kernel
def drop_pairs(
    # Model
    thread_offset: int,
    stride: int,
    # State in
    moved: wp.array(dtype=wp.int32),
    # Out
    pairs_out: TrianglePairs,
):
    """Makes holes of the pairs of triangles that have moved."""
    length = length_of(pairs_out)
    for chunk in range(thread_offset + wp.tid(), (length + CHUNK - 1) / CHUNK, stride):
        first = chunk * CHUNK
        last = wp.min(first + CHUNK, length)
        dropped = int(0)
        for k in range(first, last):
            if outdated(pairs_out, k, moved):
                dropped += 1
        if dropped > 0:
            n = count_up(pairs_out.holes, 0, dropped)
            for k in range(first, last):
                if outdated(pairs_out, k, moved):
                    pairs_out.pair[k] = wp.vec2i(-1, -1)
                    if n < pairs_out.hole.shape[0]:
                        pairs_out.hole[n] = k
                    n += 1


@wp.kernel
def begin_adding(
    # Out
    pairs_out: TrianglePairs,
    anew_out: wp.array(dtype=wp.int32),
):
    """Before pairs are added; a list that is mostly holes is emptied, and all of it is to be looked up (``anew``)."""
    pairs_out.added[0] = 0
    anew_out[0] = 0
    if SPARSE * (length_of(pairs_out) - pairs_out.holes[0]) < length_of(pairs_out):
        anew_out[0] = 1
        pairs_out.count[0] = 0
        pairs_out.holes[0] = 0


@wp.kernel
def box_ways(
    # State in
    known: wp.array(dtype=Way),
    stray: float,
    # Out
    lower_out: wp.array(dtype=wp.vec3),
    upper_out: wp.array(dtype=wp.vec3),
):
    """Boxes of known ways, as trees of Warp take them, with the share ``stray`` of their motion."""
    t = wp.tid()
    lower_out[t] = lowest(known[t], stray)
    upper_out[t] = highest(known[t], stray)


@wp.kernel
def find_roots(
    # Model
    group_size: wp.array(dtype=wp.int32),
    # State in
    bvh: wp.uint64,
    # Out
    group_root_out: wp.array(dtype=wp.int32),
):
    """Where the part of each group begins in a tree, −1 for an empty one; it takes a search, so not in each query."""
    g = wp.tid()
    group_root_out[g] = -1
    if group_size[g] > 0:
        group_root_out[g] = wp.bvh_get_group_root(bvh, g)


@wp.func
def groups_of(t: int, cloth_tris: int):
    """How many of its world's two groups of a tree triangle t searches: obstacles only the first, cloth."""
    groups = int(2)
    if t >= cloth_tris:
        groups = 1
    return groups


@wp.func
def list_pair(t: int, u: int, pairs_out: TrianglePairs):
    """Adds a pair."""
    n = count_up(pairs_out.added, 0, 1)
    place = pairs_out.count[0] + n - pairs_out.holes[0]
    if n < pairs_out.holes[0]:
        place = pairs_out.hole[pairs_out.holes[0] - 1 - n]
    if place < pairs_out.pair.shape[0]:
        pairs_out.pair[place] = wp.vec2i(wp.min(t, u), wp.max(t, u))  # an order that does not tell what moved


@wp.func
def add_pair(
    t: int,
    u: int,
    mine: wp.vec3i,
    tri_indices: wp.array2d(dtype=wp.int32),
    moved: wp.array(dtype=wp.int32),
    all: int,
    known: wp.array(dtype=Way),
    stray: float,
    pairs_out: TrianglePairs,
):
    """Adds triangles t, which has moved, and u, if they may meet, have no common vertices, and u does not find t."""
    if u == t or (u < t and (int_at(moved, u) | all) == 1):
        return
    if common_vertex(mine, triple_at(tri_indices, u)):
        return
    if may_meet(known[t], known[u], stray):
        list_pair(t, u, pairs_out)


@wp.kernel
def find_triangle_pairs(
    # Model
    thread_offset: int,
    tri_indices: wp.array2d(dtype=wp.int32),
    particle_world: wp.array(dtype=wp.int32),
    group_root: wp.array(dtype=wp.int32),
    cloth_tris: int,
    # State in
    moved: wp.array(dtype=wp.int32),
    anew: wp.array(dtype=wp.int32),
    known: wp.array(dtype=Way),
    stray: float,
    bvh: wp.uint64,
    # Out
    pairs_out: TrianglePairs,
):
    """Adds all pairs of the triangles that have moved, once each: of one world, not of two obstacles, without
    common vertices. ``anew``: as if all had moved.

    World w has the groups 2 w, its cloth, and 2 w + 1, its obstacles, among which these do not search.
    """
    t = thread_offset + wp.tid()
    if (moved[t] | anew[0]) == 0:
        return
    mine = triple_at(tri_indices, t)
    for group in range(groups_of(t, cloth_tris)):
        root = group_root[2 * particle_world[mine[0]] + group]
        if root < 0:
            continue
        query = wp.bvh_query_aabb(bvh, lowest(known[t], stray), highest(known[t], stray), root)
        u = int(0)
        while wp.bvh_query_next(query, u):
            add_pair(t, u, mine, tri_indices, moved, anew[0], known, stray, pairs_out)


@wp.kernel
def end_adding(
    # Out
    pairs_out: TrianglePairs,
):
    """After pairs were added: counts them."""
    filled = wp.min(pairs_out.added[0], pairs_out.holes[0])
    pairs_out.holes[0] -= filled
    pairs_out.count[0] += pairs_out.added[0] - filled
    pairs_out.peak[0] = wp.max(pairs_out.peak[0], pairs_out.count[0])


@wp.kernel
def note_peak(
    # State in
    count: wp.array(dtype=wp.int32),
    # Out
    peak_out: wp.array(dtype=wp.int32),
):
    """Remembers the greatest count."""
    peak_out[0] = wp.max(peak_out[0], count[0])
