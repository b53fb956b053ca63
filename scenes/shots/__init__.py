"""USD stages as scenes: cloth, pins, fabrics and colliders out of a stage, and the result back beside it.

The stage itself is never written to. This package imports ``pxr``; import it only to work with a stage.
"""

from ..usd.loading import load_openusd

load_openusd()
