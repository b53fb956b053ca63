"""Libraries that batches need besides the core's."""

from importlib import import_module
from typing import Any

from ..errors import MissingExtraError


def needed(module: str, extra: str = "batch") -> Any:
    """An optional library.

    Raises:
        MissingExtraError: it is not installed; the message names the extra that brings it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise MissingExtraError(f"Batches need {name}; install it with: pip install 'warpcloth[{extra}]'.") from error
