"""Set up Warp once per test process: quiet, on the CPU.

Parallel workers (``pytest -n 2``) share the kernel cache: Warp builds a module in a folder of the process and moves it
into place in one step.
"""

import signal

import pytest
import warp as wp
from hypothesis import settings

wp.config.log_level = wp.LOG_WARNING
# No deadlines, as what shares its machine may be late without being wrong. The same examples in every run, so that what
# fails is what was changed; `pytest --hypothesis-profile=search` looks for new ones.
settings.register_profile("search", deadline=None)
settings.register_profile("repeat", deadline=None, derandomize=True)
settings.load_profile("repeat")


@pytest.fixture(scope="session", autouse=True)
def warp_on_the_cpu() -> None:
    """Here rather than on import, so that Warp's notice of a missing driver does not follow pytest's closing line."""
    wp.init()
    wp.set_device("cpu")


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """A shell starts background jobs with Ctrl-C ignored, and the programs that tests start would inherit that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
