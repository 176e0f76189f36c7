"""``python -m fleet.evaluate``: the same as ``python -m fleet evaluate``."""

import sys

from fleet.terminal.console import own_output

if __name__ == "__main__":
    own_output()
    from fleet.cli.main import main

    main(["evaluate", *sys.argv[1:]], prog="python -m fleet.evaluate")
