"""Drape test (Cusick; BS 5058, ISO 9073-9): a round specimen hangs over a smaller disc and throws a shadow.

Cloth of 30 cm diameter lies between two discs of 18 cm; the drape coefficient is how much of the ring around the disc
stays dark in light from above, DC = (A − A_disc)/(A_specimen − A_disc), and folds are counted on the outline. Limp
cloth has a low coefficient and many folds. Which folds form depends on the start, so several starts are averaged, with
waves of random heights around the rim, up to eight of them and some 5 mm high.

The specimen is let down slowly, as on a plate that is lowered: its weight comes on over two seconds. Let go at once it
would swing far below where it comes to rest, and where friction then holds it would depend on how the swing is damped,
by the air, by the fabric or by the scheme: cotton comes to 55 % that way, and folds are as many as the damping makes.
For the same reason something damps its motion, 5/s of its velocity, as air does at some 1 m/s: left to themselves,
schemes that keep swings alive shake the cloth out of its friction.

All that goes in are properties of the fabric: its weight, and its resistance to bending, elastic and by friction, to
twist and to shear. Springs on triangles make an isotropic sheet, here one with the fabric's shear modulus: yarns are
stiffer still, but both moduli are far beyond what the weight of 6 cm of cloth could strain.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..cloth import Cloth, Pin
from ..fabric import STANDARD_GRAVITY, Fabric
from ..forces import MassDamping
from ..integrators import INTEGRATORS, option_names
from ..model import Model
from ..simulation import Simulation
from .result import AREA, Check, Curve, Panel, Result
from .settle import balanced
from .setup import Progress, Setup
from .shadow import Shadow, shadow_of
from .specimen import disc_ring

NAME = "cusick"
TITLE = "Cusick drape"
SPECIMEN, DISC = 0.15, 0.09  # radii [m]
CELLS = 8  # across the ring
STARTS = 5
ROUGHNESS, WAVES = 0.005, 8  # height of waves at the rim at the start [m], and most of them around it
DAMPING = 5.0  # [1/s]: ½ ρ c_D v of air over the areal density, at 1 m/s. Of 20/s waves of the start stay
STEP = 0.02  # [s]
RELEASE = 100  # steps over which the weight comes on
MAX_STEPS = 500
REST = 2e-4  # [m/s], root mean square, of a specimen at rest
REST_STEPS = 5
NEWTON = 1e-3  # [m/s] to which implicit steps are solved
# Matsudaira et al., J. Textile Engineering 61(6), 2015: drape coefficient [%] and folds
MEASURED = {"cotton": (82.9, 2), "polyester": (50.7, 5)}
POINTS_OFF, FOLDS_OFF = 10.0, 2.0


@dataclass(frozen=True, eq=False)
class Drape:
    """A specimen at rest: positions [m] and triangles, its shadow; whether it came to rest."""

    positions: np.ndarray
    triangles: np.ndarray
    shadow: Shadow
    settled: bool

    @property
    def coefficient(self) -> float:
        """DC [%]."""
        return 100.0 * (self.shadow.area - np.pi * DISC**2) / (np.pi * (SPECIMEN**2 - DISC**2))


def run(setup: Setup, progress: Progress) -> Result:
    """Several starts, and their means beside measured ones where there are any."""
    drapes = []
    for number in range(STARTS):
        progress(f"start {number + 1} of {STARTS}")
        drapes.append(draped(setup, setup.seed + number))
    coefficients, folds = [drape.coefficient for drape in drapes], [drape.shadow.folds for drape in drapes]
    means = float(np.mean(coefficients)), float(np.mean(folds))
    checks = []
    if setup.fabric.name in MEASURED:
        coefficient, number = MEASURED[setup.fabric.name]
        checks.append(Check("drape coefficient [%]", means[0], coefficient, POINTS_OFF, absolute=True))
        checks.append(Check("folds", means[1], number, FOLDS_OFF, absolute=True))
    rows = [(k, c, n, d.settled) for k, (c, n, d) in enumerate(zip(coefficients, folds, drapes, strict=True), 1)]
    return Result(
        test=NAME,
        title=TITLE,
        method="A specimen of 30 cm between discs of 18 cm, let down slowly, with random waves at the rim; drape "
        "coefficient and folds of its shadow (BS 5058).",
        setup=setup.summary(),
        columns=("start", "DC %", "folds", "settled"),
        rows=rows,
        values={
            "drape_coefficient": means[0],
            "drape_coefficient_deviation": float(np.std(coefficients)),
            "folds": means[1],
        },
        checks=checks,
        panels=_panels(drapes),
    )


def draped(setup: Setup, seed: int) -> Drape:
    """One specimen, let down from level but for waves around its rim."""
    cloth = disc_ring(DISC, SPECIMEN, setup.cells(CELLS), setup, _sheet(setup.fabric))
    held = np.linalg.norm(cloth.points, axis=1) < DISC + 0.6 * (SPECIMEN - DISC) / setup.cells(CELLS)
    model = Model.build(_waved(cloth, held, seed), precision="float64")
    options = balanced(model, setup.integrator, STEP)
    if "tolerance" in option_names(INTEGRATORS[setup.integrator]):
        options["integrator_options"] = {"tolerance": NEWTON}
    sim = Simulation(model, setup.integrator, contact="none", forces=[MassDamping(model, DAMPING)], **options)
    quiet = 0
    for step in range(1, MAX_STEPS + 1):
        share = min(step / RELEASE, 1.0)
        sim.forces.world_gravity.assign(np.array([[0.0, 0.0, -STANDARD_GRAVITY * share]]))
        sim.step(STEP)
        speed = float(np.sqrt(np.mean(sim.state.particle_qd.numpy() ** 2)))
        quiet = quiet + 1 if speed < REST and share == 1.0 else 0
        if quiet == REST_STEPS:
            break
    positions = sim.state.particle_q.numpy().astype(np.float64)
    return Drape(positions, cloth.triangles, shadow_of(positions, cloth.triangles, DISC), quiet == REST_STEPS)


def _sheet(fabric: Fabric) -> Fabric:
    """The isotropic sheet with the fabric's shear modulus: G = 3/8 Y of springs on triangles."""
    young = 8.0 / 3.0 * fabric.shear_stiffness if fabric.shear_stiffness > 0.0 else min(fabric.stretch)
    return replace(fabric, stretch_stiffness=young, stretch_stiffness_weft=None, strain_limit=None)


def _waved(cloth: Cloth, held: np.ndarray, seed: int) -> Cloth:
    """The specimen with waves at its start; springs and bending stay those of the level one."""
    points, rng = cloth.points.copy(), np.random.default_rng(seed)
    angle, radius = np.arctan2(points[:, 1], points[:, 0]), np.linalg.norm(points, axis=1)
    reach = np.maximum(radius - radius[held].max(), 0.0) / (SPECIMEN - DISC)
    waves = np.zeros(len(points))
    for number in range(WAVES + 1):
        a, b = rng.normal(size=2) / np.sqrt(WAVES + 1.0)
        waves += a * np.cos(number * angle) + b * np.sin(number * angle)
    points[:, 2] += ROUGHNESS * reach**2 * waves
    return replace(cloth, points=points, pins=(Pin(np.flatnonzero(held).astype(np.int32)),))


def _panels(drapes: list[Drape]) -> list[Panel]:
    """The shadow of the first start, and the outlines of all."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circles = [
        Curve(label, 100.0 * r * np.cos(angle), 100.0 * r * np.sin(angle))
        for label, r in (("specimen", SPECIMEN), ("disc", DISC))
    ]
    x, y = drapes[0].shadow.outline()
    shadow = Curve("shadow", 100.0 * x, 100.0 * y, AREA)
    found = [drape.shadow.outline() for drape in drapes]
    outlines = [Curve(f"start {k}", 100.0 * x, 100.0 * y) for k, (x, y) in enumerate(found, 1)]
    return [
        Panel("x [cm]", "y [cm]", [*circles, shadow], equal=True),
        Panel("x [cm]", "y [cm]", [*circles, *outlines], equal=True),
    ]
