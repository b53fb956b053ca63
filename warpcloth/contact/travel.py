"""Steps in which cloth does not move through several of its own cells: for schemes to which stability sets no limit.

Contact acts at the ends of steps: what has got deep into something is pushed out at once, and stretched, and the next
step pulls it back. The more cells it moved through, the more. With steps of 8 ms single edges of `drape_bunny` were
twice their length and a step took 35 Newton iterations, with 2 ms an edge is 7 % too long; of sheets thrown at 9 m/s
Newton's method failed in most steps. Shorter ones cost next to nothing, as each is the easier to solve: the products
with matrices in 30 frames of `two_cloths` were 111,000 with 5, 112,000 with 10, 108,000 with 20 and 111,000 with 40
steps a frame, and the longest edge 51, 9, 4 and 4 % too long.
"""

import math

import numpy as np

from ..model import Model
from ..surface import world_edges

TRAVEL = 1.0 / 3.0  # edges of cloth
GRAVITY = 9.81  # [m/s²]


def travel_step(model: Model) -> float:
    """Time [s] in which no particle moves by more than a third of an edge: at √(v² + 2 g L), its speed at the start and
    what a fall by the cloth's own extent adds. Obstacles do not count. Infinite for models without triangles."""
    x, v = model.particle_q.numpy().astype(np.float64), model.particle_qd.numpy().astype(np.float64)
    free, edges = model.particle_inv_mass.numpy() > 0.0, world_edges(model)
    step = math.inf
    for cloth in model.cloths:
        own = slice(cloth.start, cloth.stop)
        if cloth.world in edges and free[own].any():
            fall = 2.0 * GRAVITY * float(np.ptp(x[own], axis=0).max())
            fastest = float(np.sum(v[own][free[own]] ** 2, axis=1).max())
            step = min(step, TRAVEL * edges[cloth.world] / math.sqrt(fastest + fall))
    return step


def travels(step: float, dt: float) -> int:
    """Fewest equal steps in dt [s] that are no longer than ``step`` [s]."""
    return max(1, math.ceil(dt / step - 1e-9))
