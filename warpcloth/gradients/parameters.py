"""What gradients are taken with respect to, and whether a simulation has any."""

import warp as wp

from .. import validate
from ..errors import InputError, NotDifferentiableError
from ..forces import Differentiable
from ..integrators.xpbd import Xpbd
from ..launching import launch
from ..obstacles import MeshObstacle
from ..simulation import Simulation
from .steps import recorded_step

OF_START = ("particle_q", "particle_qd")


def check_differentiable(simulation: Simulation) -> None:
    """Does nothing if there are gradients through every part of the simulation.

    Raises:
        NotDifferentiableError: the first part without any.
        InputError: it is no simulation.
    """
    model = validate.instance(simulation, Simulation, "Simulation").model
    if not model.differentiable:
        raise NotDifferentiableError("Gradients need adjoint kernels: build the model with differentiable=True.")
    recorded_step(simulation.integrator)
    if simulation.hooks:
        raise NotDifferentiableError("Hooks have no gradients; build the simulation without them.")
    for term in simulation.forces.terms:
        if not isinstance(term, Differentiable):
            raise NotDifferentiableError(
                f"Force '{term.name}' has no gradients, as it has no parameters(); build the simulation without it."
            )
    if model.limits_strain and simulation.integrator.solves_springs_only:
        raise NotDifferentiableError(
            f"Strain limits have no gradients in '{simulation.integrator.name}', which corrects the ends of its steps; "
            "take another integrator, or fabrics without them."
        )
    if simulation.contact.cloths is not None:
        raise NotDifferentiableError(
            'Contact among cloths has no gradients; build the simulation with contact="obstacles" or "none".'
        )
    for _, obstacle, _ in model.shapes.obstacles if simulation.contact.acts else ():
        if isinstance(obstacle, MeshObstacle):
            raise NotDifferentiableError(
                "Contact with a MeshObstacle has no gradients; planes, spheres, capsules and boxes have them."
            )


def find_parameters(simulation: Simulation) -> dict[str, wp.array]:
    """The arrays with respect to which there are gradients, by name; from here on they have them.

    Raises:
        InputError: two of them have one name.
    """
    model = simulation.model
    found = {"particle_mass": model.particle_mass, "gravity": simulation.forces.world_gravity}
    if simulation.contact.acts:
        shapes = model.shapes.shapes
        found["particle_friction"] = model.particle_friction
        found |= {"obstacle_friction": shapes.friction, "obstacle_restitution": shapes.restitution}
    for term in simulation.forces.terms:
        for name, array in term.parameters().items() if isinstance(term, Differentiable) else ():
            if name in OF_START or found.setdefault(name, array) is not array:
                raise InputError(
                    f"Force '{term.name}' must not call a parameter '{name}', as another array is called so; give it "
                    "another name in parameters()."
                )
    for array in (*found.values(), model.particle_inv_mass):
        array.requires_grad = True
    return found


def record_derived(simulation: Simulation) -> wp.Tape:
    """Brings up to date what the simulation derives from its parameters: inverse masses, the springs of XPBD."""
    model = simulation.model
    tape = wp.Tape()
    with tape:
        launch(
            model.kernels.particles.invert_masses,
            dim=model.particle_count,
            inputs=[model.particle_mass],
            outputs=[model.particle_inv_mass],
            device=model.device,
        )
        if isinstance(simulation.integrator, Xpbd):
            simulation.integrator.prepare()
    return tape
