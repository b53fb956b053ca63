"""Sweeps: one scene with parameters becomes a data set of drapes, on one machine or on a cluster."""

from .sweep import Sample, Sweep, load_sweep

__all__ = ["Sample", "Sweep", "load_sweep"]
