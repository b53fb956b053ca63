"""Contact: the stage at the end of each step that keeps cloth out of everything."""

from .obstacle_response import ObstacleResponse

__all__ = ["ObstacleResponse"]
