"""warpcloth inside other programs: many worlds as one environment; Newton is in :mod:`warpcloth.interop.newton`."""

from .vector_env import VectorEnv

__all__ = ["VectorEnv"]
