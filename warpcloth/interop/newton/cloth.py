"""Our cloth as particles, springs, triangles and bending edges of a Newton builder."""

import warnings

import newton
import numpy as np
import warp as wp

from ...cloth import Cloth
from ...errors import FabricWarning, InputError


def add_cloth(builder: newton.ModelBuilder, cloth: Cloth) -> range:
    """Adds a cloth to a Newton builder, in its present world.

    Particles have the cloth's masses, 0 where it is pinned, and half its thickness as radius. Springs are the cloth's,
    in Newton's units: k_s/r [N/m] and k_d/r [N s/m]. Triangles have no stiffness of their own; they are there for
    contact and drawing. Edges have the stiffness k = B l/(A₁ + A₂) [N] of the bending rigidity B, for solvers with
    E = ½ k l θ² (VBD): on a grid that is B for bending along either axis, and 1.6 B between them.

    Args:
        builder: the builder.
        cloth: the cloth; its pins must stand still, and it must not be inflated.

    Returns:
        The numbers of its particles.

    Raises:
        InputError: no builder, no cloth, or one that Newton cannot have.

    Warns:
        FabricWarning: the fabric has properties that Newton has not; the sentence names them.
    """
    if not isinstance(builder, newton.ModelBuilder):
        raise InputError(f"Builder must be a newton.ModelBuilder, got {type(builder).__name__}.")
    if not isinstance(cloth, Cloth):
        raise InputError(f"Cloth must be a warpcloth.Cloth, got {type(cloth).__name__}.")
    _check_supported(cloth)
    first, first_edge = len(builder.particle_q), len(builder.edge_indices)
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=wp.vec3(*map(float, cloth.velocity)),
        vertices=cloth.points.tolist(),
        indices=cloth.triangles.ravel().tolist(),
        density=0.0,
        **dict.fromkeys(("tri_ke", "tri_ka", "tri_kd", "tri_drag", "tri_lift", "edge_ke", "edge_kd"), 0.0),
        particle_radius=0.5 * cloth.fabric.thickness,
        label=cloth.name,
    )
    particles = range(first, len(builder.particle_q))
    _set_masses(builder, cloth, first)
    _set_bending(builder, cloth, first, first_edge)
    net = cloth.springs
    for (i, j), r, k_s, k_d in zip(net.indices.tolist(), net.rest_lengths, net.stiffness, net.damping, strict=True):
        builder.add_spring(first + i, first + j, float(k_s / r), float(k_d / r), control=0.0)
        builder.spring_rest_length[-1] = float(r)
    return particles


def _check_supported(cloth: Cloth) -> None:
    if any(pin.motion is not None for pin in cloth.pins):
        raise InputError(
            f"Cloth '{cloth.name}' must have pins without motion for Newton, got a moving one; pin it without, and "
            "give its particles velocities in Newton's state."
        )
    if cloth.inflation is not None:
        raise InputError(f"Cloth '{cloth.name}' must not be inflated for Newton, which has no pressure in cloth.")
    if len(cloth.woven) > 0:
        raise InputError(
            f"Cloth '{cloth.name}' must have springs between its vertices for Newton, got woven triangles; build it "
            "with other springs."
        )
    fabric, lost = cloth.fabric, []
    if fabric.bending_hysteresis > 0.0:
        lost.append("bending_hysteresis")
    if fabric.strain_limit is not None and fabric.limit_stiffness > 0.0:
        lost.append("strain_limit")
    if fabric.bending[0] != fabric.bending[1]:
        lost.append("bending_rigidity_weft (both axes have the geometric mean)")
    if lost:
        warnings.warn(f"Cloth '{cloth.name}' has no {', '.join(lost)} in Newton.", FabricWarning, stacklevel=3)


def _set_masses(builder: newton.ModelBuilder, cloth: Cloth, first: int) -> None:
    masses = cloth.masses.copy()
    masses[cloth.pinned] = 0.0
    builder.particle_mass[first : first + len(masses)] = masses.tolist()
    for i in cloth.pinned:
        builder.particle_qd[first + i] = wp.vec3(0.0, 0.0, 0.0)


def _set_bending(builder: newton.ModelBuilder, cloth: Cloth, first: int, first_edge: int) -> None:
    """Stiffness of the edges since ``first_edge`` that have a triangle on either side."""
    warp, weft = cloth.fabric.bending
    rows = np.array(builder.edge_indices[first_edge:], dtype=np.int64).reshape(-1, 4)
    inner = np.flatnonzero((rows >= 0).all(axis=1))
    opposite, other, start, end = (cloth.points[rows[inner, k] - first] for k in range(4))
    edge = end - start
    twice_area = sum(np.linalg.norm(np.cross(edge, tip - start), axis=1) for tip in (opposite, other))
    stiffness = np.sqrt(warp * weft) * np.linalg.norm(edge, axis=1) / (0.5 * twice_area)
    for number, ke in zip((first_edge + inner).tolist(), stiffness.tolist(), strict=True):
        builder.edge_bending_properties[number] = (ke, cloth.fabric.damping_time * ke)
