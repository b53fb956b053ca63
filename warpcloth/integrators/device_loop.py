"""Loops whose end is decided on the device, so that a captured graph runs as many iterations as are needed."""

from collections.abc import Callable

import warp as wp


def repeat_while(condition: wp.array, body: Callable[[], None], limit: int) -> None:
    """Runs ``body``, which launches kernels, while ``condition[0]`` (int32) is not 0.

    ``body`` must bring it to 0 within ``limit`` runs and do nothing harmful after that: where a graph is being captured
    for a GPU whose driver knows no conditional nodes (CUDA below 12.4), all ``limit`` runs are recorded.
    """
    device = wp.get_device(condition.device)
    if device.is_cuda and device.is_capturing and not wp.is_conditional_graph_supported():
        for _ in range(limit):
            body()
    else:
        wp.capture_while(condition, body)
