"""``python -m fleet.train``: the same as ``python -m fleet train``."""

import sys

from fleet.terminal.console import own_output

if __name__ == "__main__":
    own_output()
    from fleet.cli.main import main

    main(["train", *sys.argv[1:]], prog="python -m fleet.train")
