"""Newton and warpcloth together: a solver of Newton's with our integrators, and our cloth in Newton's builder.

>>> import newton
>>> import warpcloth as wc
>>> from warpcloth.interop.newton import SolverMassSpring, add_cloth
>>> builder = newton.ModelBuilder()
>>> add_cloth(builder, wc.Cloth.grid((0.5, 0.5), (9, 9), pins="left", transform=(0, 0, 1)))
range(0, 81)
>>> model = builder.finalize(device="cpu")
>>> solver = SolverMassSpring(model, integrator="xpbd")
>>> now, later = model.state(), model.state()
>>> for _ in range(100):
...     now.clear_forces()
...     solver.step(now, later, None, None, 1 / 600)
...     now, later = later, now
>>> bool(now.particle_q.numpy()[:, 2].min() < 0.98)
True
"""

from importlib.util import find_spec

from ...errors import MissingExtraError

if find_spec("newton") is None:
    raise MissingExtraError("Newton is not installed; install it with: pip install 'warpcloth[newton]'.")

from .cloth import add_cloth
from .solver import SolverMassSpring

__all__ = ["SolverMassSpring", "add_cloth"]
