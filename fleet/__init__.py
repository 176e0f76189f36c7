"""Fleet: a warehouse in which cars and arms share one physical world; all state and all input and output."""

import sys

if sys.version_info < (3, 11):  # noqa: UP036 - who has the source can run it with any Python
    sys.stderr.write(
        "fleet: this is Python {}.{} ({}); valid: 3.11, such as .venv/bin/python after `make setup`\n".format(
            *sys.version_info[:2], sys.executable
        )
    )
    sys.exit(2)

import planners as planners  # finds a place for compiled kernels before anything imports numba
