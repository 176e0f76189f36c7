"""``python -m fleet.demo``: the same as ``python -m fleet demo``."""

import sys

from fleet.terminal.console import own_output

if __name__ == "__main__":
    own_output()
    from fleet.cli.main import main

    main(["demo", *sys.argv[1:]], prog="python -m fleet.demo")
