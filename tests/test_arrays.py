"""The state in the hands of other libraries, and Warp as the caller left it."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.interop import VectorEnv

WARPCLOTH = Path(__file__).resolve().parents[1] / "warpcloth"


@pytest.fixture
def sim() -> wc.Simulation:
    cloth = wc.Cloth.grid((0.2, 0.2), (4, 4), pins="left", transform=(0, 0, 1))
    return wc.Simulation(wc.Model.build([cloth], device="cpu"), substeps=20)


def state_arrays(sim: wc.Simulation) -> list[wp.array]:
    return [sim.state.particle_q, sim.state.particle_qd, sim.state.particle_f]


def test_the_state_is_plain_warp_arrays_that_stay_the_same(sim):
    arrays = state_arrays(sim)
    assert all(type(array) is wp.array for array in arrays)
    pointers = [array.ptr for array in arrays]
    sim.run(3)
    sim.reset()
    sim.run(3)
    assert [array.ptr for array in state_arrays(sim)] == pointers


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_numpy_shares_the_states_memory(precision):
    cloth = wc.Cloth.grid((0.2, 0.2), (4, 4), pins="left", transform=(0, 0, 1))
    sim = wc.Simulation(wc.Model.build([cloth], device="cpu", precision=precision), substeps=20)
    for array in state_arrays(sim):
        seen = np.from_dlpack(array)
        assert seen.ctypes.data == array.ptr
        assert seen.shape == (16, 3)
        assert seen.dtype == precision
    seen = np.from_dlpack(sim.state.particle_q)
    before = seen.copy()
    sim.run(2)
    assert np.abs(seen - before).max() > 1e-3  # it shows the present
    velocity = sim.state.particle_qd.numpy()  # on the CPU the same memory, and not read-only as by DLPack
    assert velocity.ctypes.data == sim.state.particle_qd.ptr
    free = np.setdiff1d(np.arange(16), [0, 4, 8, 12])
    velocity[free] = (0.0, 2.0, 0.0)  # and what is written there is where the next frame begins
    sim.step(1e-3)
    assert seen[free, 1].mean() - before[free, 1].mean() == pytest.approx(2e-3, rel=0.1)


def test_jax_shares_the_states_memory(sim):
    jax = pytest.importorskip("jax")
    for array in state_arrays(sim):
        seen = jax.dlpack.from_dlpack(array)
        assert seen.unsafe_buffer_pointer() == array.ptr
        assert seen.shape == (16, 3)
        del seen  # before the simulation, whose memory it is


def test_jax_gives_actions():
    jax = pytest.importorskip("jax")
    towel = wc.Cloth.grid((0.2, 0.2), (4, 4), pins="left", transform=(0, 0, 1))
    env = VectorEnv([towel], worlds=2, substeps=20, device="cpu")
    actions = jax.numpy.full(env.action_shape, 0.6)
    env.step(actions)
    np.testing.assert_allclose(env.positions.numpy()[:, 0], [[-0.09, -0.09, 1.01]] * 2, atol=1e-6)


def test_torch_shares_the_states_memory(sim):
    torch = pytest.importorskip("torch")
    for array in state_arrays(sim):
        seen = torch.from_dlpack(array)
        assert seen.data_ptr() == array.ptr
        assert tuple(seen.shape) == (16, 3)


SETTINGS = """
import sys
import warp as wp

@wp.func
def nothing():
    return 0

def settings():
    config = {name: getattr(wp.config, name) for name in dir(wp.config) if not name.startswith("_")}
    return {name: value for name, value in config.items() if not callable(value)}, wp.get_module_options()

untouched = settings()
import warpcloth as wc
import warpcloth.interop
assert not [name for name in sys.modules if name.split(".")[0] in ("newton", "jax", "torch", "pxr.Usd")]
assert settings() == untouched, "importing changed settings"
wp.init()  # which Warp does at the first launch anyway
before = settings()
cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), pins=[0], transform=(0, 0, 1))
env = warpcloth.interop.VectorEnv([cloth], [wc.Plane()], worlds=2, device="cpu", contact="all")
device = wp.get_device()
env.step()
env.reset()
assert settings() == before, "using it changed settings"
assert wp.get_device() == device
"""


def test_importing_and_using_it_changes_no_settings(tmp_path):
    """In a process of its own; nor are heavy libraries imported for those who do not ask for them."""
    script = tmp_path / "settings.py"
    script.write_text(SETTINGS)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


MAKERS = ("zeros", "full", "empty", "ones", "array", "launch", "from_numpy")
TAKES_OVER = ("wp.set_", "wp.synchronize", "wp.init", "wp.ScopedDevice", "wp.ScopedStream", "wp.config")
PROGRAMS = ("batch", "cli", "lab", "render", "view")  # these have a process, or a thread, of their own


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(WARPCLOTH.rglob("*.py")) if path.relative_to(WARPCLOTH).parts[0] not in PROGRAMS],
    ids=lambda path: path.relative_to(WARPCLOTH).as_posix(),
)
def test_the_callers_device_and_stream_are_respected(path):
    """Arrays and launches name the model's device, whatever the caller's default is; launches go to its stream."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            keywords = {keyword.arg for keyword in node.keywords}  # None for options in a dictionary
            if name.startswith("wp.") and name[3:] in MAKERS:
                assert keywords & {"device", None}, f"line {node.lineno}: {name} on the caller's default device"
            assert "stream" not in keywords, f"line {node.lineno}"
            profiled = path.name == "stopwatch.py" and name == "wp.synchronize_device"
            assert profiled or not name.startswith(TAKES_OVER), f"line {node.lineno}: {name}"
        if isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            assert not [t for t in targets if ast.unparse(t).startswith("wp.config")], f"line {node.lineno}"
