"""Gradients through whole simulations: how motion depends on its start, the material, gravity, wind, friction."""

from .rollout import Rollout

__all__ = ["Rollout"]
