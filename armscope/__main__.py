"""``python -m armscope``."""

from armscope.cli import main

if __name__ == "__main__":
    main()
