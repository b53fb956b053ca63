"""Motions on the device: key tracks, and the particles that they drive."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from .kernels import KernelSet
from .launching import launch
from .motion import Motion

if TYPE_CHECKING:
    from .model import Model


def make_tracks(kernels: KernelSet, motions: Sequence[Motion], device: wp.Device) -> Any:
    """All motions as one ``Tracks`` struct (see ``kernels/motion.py``)."""
    tracks = kernels.motion.Tracks()
    counts = [len(m.times) for m in motions]
    tracks.start = wp.array(np.concatenate([[0], np.cumsum(counts)]), dtype=wp.int32, device=device)
    tracks.smooth = wp.array([int(m.interpolation == "smooth") for m in motions], dtype=wp.int32, device=device)
    tracks.loop = wp.array([int(m.loop) for m in motions], dtype=wp.int32, device=device)
    tracks.times = wp.array(_joined([m.times for m in motions], ()), dtype=wp.float64, device=device)
    tracks.positions = wp.array(_joined([m.positions for m in motions], (3,)), dtype=wp.vec3d, device=device)
    tracks.rotations = wp.array(_joined([m.rotations for m in motions], (3,)), dtype=wp.vec3d, device=device)
    return tracks


def _joined(parts: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros((0, *shape))


@dataclass(eq=False)
class MovingPins:
    """Pinned particles with a prescribed motion. Pins without one just stay, as their inverse mass is zero.

    Attributes:
        particle: particle of each moving pin, int32, shape [pin_count].
        track: motion of each, int32, shape [pin_count].
        rest: position from which it moves [m], vec3d, shape [pin_count].
        pivot: centre of its rotation [m], vec3d, shape [pin_count].
    """

    particle: wp.array
    track: wp.array
    rest: wp.array
    pivot: wp.array

    @staticmethod
    def of(rows: Sequence[tuple[np.ndarray, int, np.ndarray, np.ndarray]], device: wp.Device) -> "MovingPins":
        """From rows of (particles, track, their rest positions, pivot)."""
        particle = _joined([r[0] for r in rows], ())
        track = _joined([np.full(len(r[0]), r[1]) for r in rows], ())
        rest = _joined([r[2] for r in rows], (3,))
        pivot = _joined([np.broadcast_to(r[3], r[2].shape) for r in rows], (3,))
        return MovingPins(
            wp.array(particle.astype(np.int32), dtype=wp.int32, device=device),
            wp.array(track.astype(np.int32), dtype=wp.int32, device=device),
            wp.array(np.ascontiguousarray(rest), dtype=wp.vec3d, device=device),
            wp.array(np.ascontiguousarray(pivot), dtype=wp.vec3d, device=device),
        )


@dataclass(eq=False)
class LedPins:
    """Pinned particles that somebody leads: in each step they go on from a place at a velocity, both written before it.

    Attributes:
        particle: their numbers, int32, shape [pin_count]; those that are not held are left alone.
        place: positions at the start of the step [m], vec3d: in steps of a millisecond slow pins would not move at all
            in float32.
        velocity: during the step [m/s], vec3.
    """

    particle: wp.array
    place: wp.array
    velocity: wp.array

    @staticmethod
    def of(particles: np.ndarray, positions: wp.array) -> "LedPins":
        """Pins at rest at the ``positions`` [m] of particles of these numbers."""
        numbers, device = np.asarray(particles, np.int32), positions.device
        return LedPins(
            wp.array(numbers, dtype=wp.int32, device=device),
            wp.array(positions.numpy()[numbers].astype(np.float64), dtype=wp.vec3d, device=device),
            wp.zeros(len(numbers), dtype=positions.dtype, device=device),
        )


def drive_pins(
    model: "Model", world_time: wp.array, time_offset: float, particle_q: wp.array, particle_qd: wp.array
) -> None:
    """Positions and velocities of moving pins, ``time_offset`` [s] after the start of a step at the worlds' time."""
    pins, led, kernels = model.moving_pins, model.led_pins, model.kernels.motion
    outputs = [particle_q, particle_qd]
    if len(pins.particle) > 0:
        inputs = [model.particle_world, pins.particle, pins.track, pins.rest, pins.pivot, model.tracks]
        launch(kernels.drive_pins, len(pins.particle), [*inputs, world_time, time_offset], outputs, model.device)
    if len(led.particle) > 0:
        inputs = [model.particle_inv_mass, led.particle, led.place, led.velocity, time_offset]
        launch(kernels.lead_pins, len(led.particle), inputs, outputs, model.device)
