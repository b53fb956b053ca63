"""A web page on which cloth moves in real time and is taken with the mouse (extra ``view``).

:mod:`session` simulates in its own thread and knows nothing of pages; :mod:`page` shows a session and passes on what
people do.
"""
