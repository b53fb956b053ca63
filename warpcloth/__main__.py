"""``python -m warpcloth`` is the command ``warpcloth``."""

from .cli import main

if __name__ == "__main__":
    main()
