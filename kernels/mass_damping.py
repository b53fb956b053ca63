"""Damping in proportion to mass: a force −c m v, as of a still and thin medium."""

import sys

import warp as wp

from .precision import OPTIONS, mat33, real, vec3

wp.set_module_options(OPTIONS, module=sys.modules[__name__])


@wp.kernel
def add_product(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    rate: real,
    # State in
    x: wp.array(dtype=vec3),
    # Out
    total_out: wp.array(dtype=vec3),
):
    """Adds ``rate`` [1/s] m x: of velocities [m/s] and the rate −c it is the force [N]."""
    i = thread_offset + wp.tid()
    total_out[i] = total_out[i] + (rate * particle_mass[i]) * x[i]


@wp.kernel
def add_diagonal(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    rate: real,
    # Out
    diagonal_out: wp.array(dtype=mat33),
):
    """Adds the diagonal blocks of that product."""
    i = thread_offset + wp.tid()
    diagonal_out[i] = diagonal_out[i] + (rate * particle_mass[i]) * wp.identity(n=3, dtype=real)
