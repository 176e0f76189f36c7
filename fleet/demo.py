"""``python -m fleet.demo``: the same as ``python -m fleet demo``."""

import sys

from fleet.console import own_output

if __name__ == "__main__":
    own_output()
    from fleet.cli import main

    main(["demo", *sys.argv[1:]], prog="python -m fleet.demo")
