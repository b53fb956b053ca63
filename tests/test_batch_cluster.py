"""A batch on a Ray cluster of two nodes on this machine, one of which is killed in mid-run."""

import re
import signal

import psutil
import pytest
from batch_sweeps import SCENE, SWEEP, contents, simulated, written

from warpcloth.batch import load_sweep
from warpcloth.batch.run import run_batch
from warpcloth.errors import InputError

ray = pytest.importorskip("ray", reason="the extra 'cluster' is not installed")


@pytest.fixture
def cluster():
    """Two nodes of one processor each, and a head without any."""
    from ray.cluster_utils import Cluster

    at_term = signal.getsignal(signal.SIGTERM)
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes.doomed = nodes.add_node(num_cpus=1)
    nodes.add_node(num_cpus=1)
    signal.signal(signal.SIGTERM, at_term)  # the head takes it
    try:
        yield nodes
    finally:
        ray.shutdown()
        nodes.shutdown()


@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_a_dead_node_loses_nothing(tmp_path, cluster):
    """Nor does a limit that is beyond all nodes."""
    path = written(tmp_path, SWEEP.replace("count = 6", "count = 12") + "[limits]\nmemory_mib = 1e8\n", SCENE)
    undisturbed, _ = simulated(path, tmp_path / "undisturbed", worlds=5)
    seen = []

    def on_progress(plan, outcome):
        assert plan.workers == 2
        if outcome is not None:
            seen.append(outcome.index)
        elif seen and cluster.doomed is not None:  # both nodes have been given work again
            cluster.remove_node(cluster.doomed, allow_graceful=False)
            cluster.doomed = None

    status = run_batch(load_sweep(path), tmp_path / "batch", worlds=2, ray=cluster.address, on_progress=on_progress)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    assert (status.done, status.failed) == (12, 0)
    assert cluster.doomed is None
    assert sorted(seen) == list(range(12))
    folder = type(undisturbed)(tmp_path / "batch")
    assert contents(folder) == contents(undisturbed)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("auto", "There is no Ray cluster at 'auto': "),
        ("127.0.0.1:1", "There is no Ray cluster at '127.0.0.1:1': Connection refused."),
        ("ray://127.0.0.1:10001", "A Ray cluster's address is auto, local, or one such as host:6379, not "),
        ("127.0.0.1:99999", "A Ray cluster's address is "),
        ("http://127.0.0.1:80", "A Ray cluster's address is "),
        ("", "A Ray cluster's address is "),
    ],
)
def test_no_cluster_is_said_in_a_sentence_and_nothing_has_begun(tmp_path, address, sentence):
    sweep = load_sweep(written(tmp_path))
    with pytest.raises(InputError, match="^" + re.escape(sentence)):
        run_batch(sweep, tmp_path / "batch", ray=address)
    assert not (tmp_path / "batch").exists()
    assert not [child for child in psutil.Process().children() if "raylet" in child.name()]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
