"""Contact with what the caller knows and warpcloth does not: planes found by kernels of their own."""

from typing import Any

import warp as wp

from .. import validate
from ..kernels import KernelSet
from ..launching import fill, launch
from ..model import PRECISIONS, Model
from ..state import State


class ContactPlanes:
    """Contacts of particles with planes, with non-penetration and Coulomb friction that holds what should stick.

    For an obstacle of your own, launch a kernel in :meth:`warpcloth.Hook.after_integration` that lists which particles
    it may touch on their way from ``start`` to ``end``, then call :meth:`resolve`. A particle may have several planes.

    Args:
        model: the model.
        capacity: most contacts at once; None: one for each particle. What is listed beyond it must be left out.

    Raises:
        InputError: the capacity is not a whole number above 0.

    Attributes:
        planes: the struct for kernels (``Planes`` in ``kernels/contact_planes.py``), with the arrays below.
        count: how many rows are in use, int32, shape [1].
        particle: particle of each row, −1 for none, int32, shape [capacity].
        point: a point of the plane at the start of the step [m]; cloth touches it a thickness off, with its particles
            ``model.particle_radius`` away. normal: unit normal to the particle's side. velocity: of the plane [m/s].
        friction: Coulomb's coefficient [-], scalar type of the model's precision.
    """

    def __init__(self, model: Model, capacity: int | None = None):
        self.model = validate.instance(model, Model, "Model")
        size = model.particle_count if capacity is None else capacity
        self.capacity = validate.integer(size, "capacity", minimum=1, maximum=2**31 - 1)
        self.count = wp.zeros(1, dtype=wp.int32, device=model.device)
        self.particle = wp.full(self.capacity, -1, dtype=wp.int32, device=model.device)
        self.point, self.normal, self.velocity = (
            wp.zeros(self.capacity, dtype=model.vec3, device=model.device) for _ in range(3)
        )
        self.friction = wp.zeros(self.capacity, dtype=model.real, device=model.device)
        self._first = wp.full(model.particle_count, -1, dtype=wp.int32, device=model.device)
        self._next = wp.full(self.capacity, -1, dtype=wp.int32, device=model.device)
        self.planes = model.kernels.contact_planes.Planes()
        for name in ("count", "particle", "point", "normal", "velocity", "friction"):
            setattr(self.planes, name, getattr(self, name))
        self.planes.first, self.planes.next = self._first, self._next

    @staticmethod
    def struct(precision: str = "float32") -> Any:
        """The type of ``planes``, for the arguments of kernels, of models of that precision ("float32", "float64").

        Raises:
            InputError: another precision.
        """
        return KernelSet(validate.choice(precision, tuple(PRECISIONS), "precision")).contact_planes.Planes

    def list_all(self) -> None:
        """Takes note of the rows as they are now; :meth:`respond` uses them until the next call."""
        fill(self._first, -1)
        launch(
            self.model.kernels.contact_planes.chain,
            dim=self.capacity,
            inputs=[self.planes],
            outputs=[self._first, self._next],
            device=self.model.device,
        )

    def respond(self, start: State, end: State, dt: float, elapsed: float = 0.0) -> None:
        """Corrects ``end``, dt [s] after ``start``, which is ``elapsed`` [s] after the planes were where they are."""
        model = self.model
        launch(
            model.kernels.contact_planes.respond,
            dim=model.particle_count,
            inputs=[
                model.particle_inv_mass, model.particle_radius, self.planes, start.particle_q, start.particle_qd,
                elapsed, dt,
            ],
            outputs=[end.particle_q, end.particle_qd],
            device=model.device,
        )  # fmt: skip

    def resolve(self, start: State, end: State, dt: float) -> None:
        """Corrects ``end``, dt [s] after ``start``, against all planes listed."""
        self.list_all()
        self.respond(start, end, dt)
