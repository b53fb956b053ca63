"""The command line ``warpcloth``.

A command is one file with a function ``command`` that takes its options and returns a :class:`~.report.Report`, and one
line in :data:`~.app.COMMANDS`. Printing, ``--json``, errors and exit codes are the same for all of them.
"""

from .main import main, run

__all__ = ["main", "run"]
