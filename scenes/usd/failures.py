"""OpenUSD's errors as warpcloth's: one sentence, without the C++ source locations."""

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf, UsdUtils

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
    except UnicodeDecodeError as error:
        raise UsdError(f"{doing}: the file is damaged, a name in it is not UTF-8 text.") from error
    except OSError as error:
        raise UsdError(f"{doing}: {error.strerror or error}.") from error


@contextmanager
def quietly() -> Iterator[None]:
    """Keeps OpenUSD's warnings within the block off stderr, where what they are about is reported anyway."""
    collected = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        del collected


def reason(error: Exception) -> str:
    """What an OpenUSD error says between its source locations, e.g. ``Usd crate bootstrap section corrupt``."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    quoted = [line.split(" : '", 1)[1].strip().rstrip("'") for line in lines if " : '" in line]
    return (quoted or lines or ["unknown error"])[0].strip().rstrip(".")
