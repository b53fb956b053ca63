"""Newton's solvers on the two scenes, with the settings that were fastest among those that hold together."""

import time
from typing import Any

import numpy as np
import warp as wp

from .scenes import CENTRE, DENSITY, DRAPE, DT, FRICTION, HANG, RADIUS, Problem

SEMI_IMPLICIT, STYLE3D = "newton_semi_implicit", "newton_style3d"
CONTACT_DISTANCE = 2e-3  # [m], as our fabric's thickness
CONTACT = (50.0, 0.01, 0.05)  # stiffness, damping and friction [N/m, N s/m, N s/m] that explicit steps carry
STRETCH = {
    "tri_ke": 50.0, "tri_ka": 50.0, "tri_kd": 0.0, "tri_drag": 0.0, "tri_lift": 0.0, "edge_ke": 1e-4, "edge_kd": 0.0
}  # fmt: skip
STYLE = {
    "tri_aniso_ke": wp.vec3(100.0, 100.0, 10.0), "tri_ka": 0.0, "tri_kd": 0.0,
    "edge_aniso_ke": wp.vec3(2e-5, 2e-5, 2e-5),
}  # fmt: skip


def substeps(name: str, n: int) -> int:
    """Of a frame, for n² vertices."""
    return 40 * -(-n // 64) if name == SEMI_IMPLICIT else 2 * -(-n // 64)


def iterations(problem: Problem, n: int) -> int:
    """Of Style3D in a substep."""
    return 3 if problem is DRAPE and n <= 64 else 4


class NewtonRun:
    """A scene in Newton; see :class:`warpcloth.benchmarks.speed.tools.Run`."""

    def __init__(self, problem: Problem, n: int, name: str):
        import newton

        self.problem, self.name = problem, name
        self.steps = substeps(name, n)
        self.facts: dict[str, Any] = {"substeps": self.steps, "version": newton.__version__}
        self.model = self._model(newton, n)
        self.solver = self._solver(newton, n)
        self.now, self.later = self.model.state(), self.model.state()
        self.pipeline = newton.CollisionPipeline(self.model)
        self.contacts = self.pipeline.contacts()
        self.triangles = self.model.tri_indices.numpy().reshape(-1, 3)
        self.graph: wp.Graph | None = None
        self.ran = False

    def _model(self, newton: Any, n: int) -> Any:
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        cell = 1.0 / (n - 1)
        grid: dict[str, Any] = {
            "pos": wp.vec3(-0.5, -0.5, self.problem.height), "rot": wp.quat_identity(), "vel": wp.vec3(0.0, 0.0, 0.0),
            "dim_x": n - 1, "dim_y": n - 1, "cell_x": cell, "cell_y": cell, "mass": DENSITY / n**2,
            "fix_left": self.problem is HANG, "particle_radius": CONTACT_DISTANCE,
        }  # fmt: skip
        if self.name == STYLE3D:
            newton.solvers.SolverStyle3D.register_custom_attributes(builder)
            newton.solvers.style3d.add_cloth_grid(builder, **grid, **STYLE)
        else:
            builder.add_cloth_grid(**grid, **STRETCH)
        if self.problem is DRAPE:
            shape = newton.ModelBuilder.ShapeConfig(mu=FRICTION)
            if self.name == SEMI_IMPLICIT:
                shape.ke, shape.kd, shape.kf = CONTACT
            builder.add_shape_sphere(-1, xform=wp.transform(CENTRE, wp.quat_identity()), radius=RADIUS, cfg=shape)
            builder.add_ground_plane(cfg=shape)
        model = builder.finalize(device="cpu")
        model.particle_grid = None  # no contact among particles: that of triangles is what is compared
        model.soft_contact_mu = FRICTION
        if self.name == SEMI_IMPLICIT:
            model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_kf = CONTACT
        return model

    def _solver(self, newton: Any, n: int) -> Any:
        if self.name == SEMI_IMPLICIT:
            return newton.solvers.SolverSemiImplicit(self.model, enable_tri_contact=False)
        config = newton.solvers.SolverStyle3D.Config(iterations=iterations(self.problem, n))
        self.facts["iterations"] = config.iterations
        return newton.solvers.SolverStyle3D(self.model, config=config)

    def frame(self) -> None:
        """One frame, from a graph where Newton's solver can be recorded."""
        if self.graph is None and self.ran and self.name == SEMI_IMPLICIT:
            with wp.ScopedCapture(device=self.model.device) as capture:
                self._simulate()
            self.graph = capture.graph
        if self.graph is not None:
            wp.capture_launch(self.graph)
        else:
            self._simulate()
        self.ran = True

    def _simulate(self) -> None:
        if self.problem is DRAPE:
            self.pipeline.collide(self.now, self.contacts)
        for _ in range(self.steps):
            self.now.clear_forces()
            self.solver.step(self.now, self.later, None, self.contacts, DT / self.steps)
            self.now, self.later = self.later, self.now

    def points(self) -> np.ndarray:
        """Positions."""
        return self.now.particle_q.numpy().astype(np.float64)

    def processor_time(self) -> float:
        """Of this process."""
        return time.process_time()
