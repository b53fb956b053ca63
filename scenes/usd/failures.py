"""OpenUSD's errors as warpcloth's: one sentence, without the C++ source locations."""

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf

from ...errors import UsdError


@contextmanager
def as_usd_error(doing: str) -> Iterator[None]:
    """Turns errors of OpenUSD and of the file system within the block into ``doing: reason.``

    Raises:
        UsdError: in their place.
    """
    try:
        yield
    except Tf.ErrorException as error:
        raise UsdError(f"{doing}: {reason(error)}.") from error
    except OSError as error:
        raise UsdError(f"{doing}: {error.strerror or error}.") from error


def reason(error: Exception) -> str:
    """What an OpenUSD error says between its source locations, e.g. ``Usd crate bootstrap section corrupt``."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    quoted = [line.split(" : '", 1)[1].strip().rstrip("'") for line in lines if " : '" in line]
    return (quoted or lines or ["unknown error"])[0].strip().rstrip(".")
