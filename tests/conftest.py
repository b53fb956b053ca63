"""Set up Warp once per test process: quiet, on the CPU, with a kernel cache that parallel workers do not share."""

import os
from pathlib import Path

import pytest
import warp as wp


def _give_worker_its_own_cache() -> None:
    """Compiling one kernel from two processes into one cache can fail, so each xdist worker keeps its own.

    Set through the environment, so that programs which a test starts use the same cache. It outlives the run.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker:
        base = os.environ.get("WARP_CACHE_PATH") or str(Path.home() / ".cache" / "warpcloth-tests")
        os.environ["WARP_CACHE_PATH"] = str(Path(base) / worker)


_give_worker_its_own_cache()
wp.config.log_level = wp.LOG_WARNING


@pytest.fixture(scope="session", autouse=True)
def warp_on_the_cpu() -> None:
    """Here rather than on import, so that Warp's notice of a missing driver does not follow pytest's closing line."""
    wp.init()
    wp.set_device("cpu")
