"""Catches what a step must not do: look back to the host."""

import warp as wp

READS = ("numpy", "list", "__array__", "__dlpack__")
WAITS = ("synchronize", "synchronize_device", "synchronize_stream", "synchronize_event")


def no_host(monkeypatch) -> None:
    """Makes every way of reading from an array, and of waiting for the device, an error."""

    def refuse(*arguments, **options):
        raise AssertionError("a step read something back to the host")

    for method in READS:
        monkeypatch.setattr(wp.array, method, refuse)
    for function in WAITS:
        monkeypatch.setattr(wp, function, refuse)
