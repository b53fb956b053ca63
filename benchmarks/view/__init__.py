"""The page of a simulation under load: how often it changes, and how soon it does what it is told."""

from .suite import run_view

__all__ = ["run_view"]
