"""A Newton model's particles and springs as a model of ours, over Newton's own arrays."""

import newton
import numpy as np
import warp as wp

from ...errors import InputError
from ...kinematics import LedPins
from ...model import Model
from ...model_parts import parts_of_network


class Network(Model):
    """The mass-spring network of a Newton model.

    ``particle_q``, ``particle_qd``, ``particle_mass``, ``particle_radius``, ``spring_rest_length`` and
    ``spring_indices`` are Newton's own memory, and so is ``particle_world``, unless particles belong to no world
    (Newton's −1). Our own are the stiffness and damping of springs, as Newton's have other units, and the inverse
    masses, as Newton's flags count in them. Worlds are those that Newton has gravity for; what belongs to none is in
    the last one.

    Args:
        source: the Newton model.

    Raises:
        InputError: it has no particles, or springs that cannot be.
    """

    def __init__(self, source: newton.Model):
        self.source = source
        if source.particle_count == 0:
            raise InputError("The Newton model must have particles, got none.")
        gravity_count = len(source.gravity)
        inverse, mass = source.particle_inv_mass.numpy(), source.particle_mass.numpy()
        springs = source.spring_count > 0
        length = source.spring_rest_length.numpy() if springs else np.zeros(0)
        parts = parts_of_network(
            positions=source.particle_q.numpy(),
            masses=np.where(mass > 0.0, mass, 1.0),
            springs=source.spring_indices.numpy().reshape(-1, 2) if springs else np.zeros((0, 2), np.int32),
            rest_lengths=length,
            k_s=source.spring_stiffness.numpy() * length if springs else length,
            k_d=source.spring_damping.numpy() * length if springs else length,
            pinned=np.flatnonzero(inverse == 0.0),
            velocities=None,
        )
        world = source.particle_world.numpy()
        parts.world = np.where(world < 0, gravity_count - 1, world).astype(np.int32)
        super().__init__(parts, world_count=gravity_count, device=source.device)
        for name in ("particle_q", "particle_qd", "particle_mass", "particle_radius"):
            setattr(self, name, getattr(source, name))
        if not (world < 0).any():
            self.particle_world = source.particle_world
        if springs:
            self.spring_rest_length = source.spring_rest_length
            self.spring_indices = source.spring_indices.reshape((-1, 2)).view(wp.vec2i)
        self.led_pins = LedPins.of(np.arange(self.particle_count), self.particle_q)  # whichever are held at the time
        self.refresh()

    def refresh(self) -> None:
        """Brings up to date what is derived from Newton's arrays."""
        source, kernels = self.source, self.kernels.newton_particles
        if self.spring_count > 0:
            wp.launch(
                kernels.convert_springs,
                dim=self.spring_count,
                inputs=[source.spring_rest_length, source.spring_stiffness, source.spring_damping],
                outputs=[self.spring_stiffness, self.spring_damping],
                device=self.device,
            )
        self.refresh_flags()

    def refresh_flags(self) -> None:
        """Inverse masses by Newton's flags as they are now; a launch."""
        wp.launch(
            self.kernels.newton_particles.free_particles,
            dim=self.particle_count,
            inputs=[self.source.particle_flags, self.source.particle_inv_mass],
            outputs=[self.particle_inv_mass],
            device=self.device,
        )

    def local_mask(self, mask: wp.array) -> wp.array:
        """Newton's mask of worlds, whose last entry is for what belongs to none, for the worlds of this model."""
        return mask[len(mask) - self.world_count :]
