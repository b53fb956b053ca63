"""What presses layers together, as contact comes to know it: by what their pairs have lacked of their distance.

In each step a pair gives back a part of its depth, and what presses on it takes something. So pairs that are pressed
for long would rest at a depth, the deeper the more lies on them and the longer the steps: of five sheets of cotton at
rest the lowest two were 0.16 of their thickness apart with steps of 1.5 ms. Therefore each particle has a *load* [m],
which grows by what its pairs lack and fades when they lack nothing: the integral part of a controller or, as a length,
the multiplier of an augmented Lagrangian. It belongs to particles, not to pairs, so it goes along where cloth slides.

Load is carried in two ways. The world takes more passes, as pushes of all pairs at once go from layer to layer by one
in each; and pairs aim a little farther apart than their distance. Aiming by all of the load takes a third of the
passes, but then vertices tremble: of twelve sheets single gaps were half as wide, and velocities up to three times as
high.
"""

import sys

import warp as wp

from .closest import combine
from .contact_pairs import four_of
from .counting import add_whole
from .fixed_sums import MOVE_UNIT, SHARE_UNIT
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

# [s] in which what is lacking becomes load: a few frames, so that what merely falls on cloth leaves little behind.
SETTLING = wp.constant(wp.float64(0.05))
MOST = wp.constant(wp.float64(4.0))  # of a particle's radius
PADDING = wp.constant(wp.float64(0.25))  # of the contact distance, at most
# Of both radii: each time so much load earns a world one more pass, up to MOST / PER_PASS. With the two of
# all others alone gaps in a stack of five came to 0.4 with schemes of few steps.
PER_PASS = wp.constant(wp.float64(0.125))
# Of the contact distance: pairs farther apart than that when they were last looked at are no part of a further pass.
OUT_OF_REACH = wp.constant(real(0.5))


@wp.struct
class Load:
    """Load of cloth particles [m]; radius [m] and world of all."""

    length: wp.array(dtype=real)
    radius: wp.array(dtype=real)
    world: wp.array(dtype=wp.int32)


@wp.struct
class FurtherPasses:
    """The passes beyond those of all: the number of the present one, from 1 (0: one of those of all), whether there is
    another one for any world, and which worlds take part in the present and in the next one."""

    number: wp.array(dtype=wp.int32)
    another: wp.array(dtype=wp.int32)
    world_now: wp.array(dtype=wp.int32)
    world_next: wp.array(dtype=wp.int32)


@wp.kernel
def begin_pass(
    # Out
    further_out: FurtherPasses,
    crossed_out: wp.array(dtype=wp.int32),
):
    """Before a further pass, with one thread for each world; what its last pass noted of ``crossed`` pairs is over."""
    w = wp.tid()
    further_out.world_now[w] = further_out.world_next[w]
    if further_out.world_next[w] == 1:
        crossed_out[w] = 0
    further_out.world_next[w] = 0
    if w == 0:
        further_out.number[0] += 1
        further_out.another[0] = 0


@wp.func
def takes_part(further: FurtherPasses, world: int, depth: real, distance: real):
    """Whether a pair with this depth when it was last looked at [m] is part of the present pass."""
    if further.number[0] == 0:
        return True
    return further.world_now[world] == 1 and depth > -OUT_OF_REACH * distance


@wp.func
def earn_pass(further_out: FurtherPasses, load: Load, i: wp.vec4i, carried: wp.float64):
    """Asks for another pass for the world of a pair, if its load [m] earns it.

    Radii bound loads, so by them there is an end of passes; contact distances of neighbours in fine cloth may be nil.
    """
    thickness = wp.float64(load.radius[i[0]]) + wp.float64(load.radius[i[3]])
    if carried > PER_PASS * thickness * wp.float64(further_out.number[0] + 1):
        further_out.world_next[load.world[i[0]]] = 1
        further_out.another[0] = 1


@wp.func
def between_cloths(load: Load, i: wp.vec4i):
    """Whether both sides are cloth; what obstacles are apart from cloth is for the response of particles to them."""
    count = load.length.shape[0]
    return i[0] < count and i[3] < count


@wp.func
def load_between(load: Load, i: wp.vec4i, w: wp.vec4d):
    """Load of a pair [m]."""
    total = wp.float64(0.0)
    if between_cloths(load, i):
        for m in range(4):
            total += wp.abs(w[m]) * wp.float64(load.length[i[m]])
    return total


@wp.func
def add_lack(
    lack_out: wp.array(dtype=wp.int64), load: Load, start: wp.array(dtype=vec3), i: wp.vec4i, w: wp.vec4d,
    n: wp.vec3d, distance: wp.float64, alone: bool,
):  # fmt: skip
    """Adds what a pair of cloth lacks of its distance at ``start`` [m] to its particles' sums, if any."""
    if lack_out.shape[0] == 0 or not between_cloths(load, i):
        return
    lack = distance - wp.dot(combine(w, four_of(start, i)), n)
    for m in range(4):
        add_whole(lack_out, i[m], wp.int64(wp.round(MOVE_UNIT * wp.abs(w[m]) * lack)), alone)


@wp.func
def adapted(load: Load, i: int, lack: wp.float64, dt: wp.float64):
    """Load of particle i [m] after dt [s] in which its pairs lacked so much on average [m]."""
    rate = wp.min(dt / SETTLING, wp.float64(1.0))
    most = MOST * wp.float64(load.radius[i])
    return real(wp.clamp(wp.float64(load.length[i]) + rate * lack, wp.float64(0.0), most))


@wp.kernel
def adapt_load(
    # Model
    thread_offset: int,
    dt: wp.float64,
    # State in
    share: wp.array(dtype=wp.int64),
    # Out
    load_out: Load,
    lack_out: wp.array(dtype=wp.int64),
):
    """Load after a step of dt [s], by the mean of what a particle's pairs lack; what touches no cloth loses it."""
    i = thread_offset + wp.tid()
    if lack_out[i] != wp.int64(0):  # else it has no pairs, or with obstacles only
        weight = wp.float64(share[i]) / SHARE_UNIT
        load_out.length[i] = adapted(load_out, i, wp.float64(lack_out[i]) / (MOVE_UNIT * weight), dt)
        lack_out[i] = wp.int64(0)
    elif load_out.length[i] > real(0.0):
        load_out.length[i] = adapted(load_out, i, -wp.float64(load_out.length[i]), dt)
