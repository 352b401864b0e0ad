"""``python -m fpsboost``."""

from fpsboost.cli import main

if __name__ == "__main__":
    main()
