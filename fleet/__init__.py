"""Fleet: a warehouse in which cars and arms share one physical world; all state and all input and output."""

import os
import sys

if sys.version_info < (3, 11):  # noqa: UP036 - who has the source can run it with any Python
    sys.stderr.write(
        "fleet: this is Python {}.{} ({}); valid: 3.11, such as .venv/bin/python after `make setup`\n".format(
            *sys.version_info[:2], sys.executable
        )
    )
    sys.exit(2)

import maps as maps
import planners as planners  # finds a place for compiled kernels before anything imports numba

# General names: a file of the user's, or another project, may be found first.
for _other in (maps, planners):
    _found = os.path.realpath(_other.__file__ or next(iter(_other.__path__)))
    _ours = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), _other.__name__)
    if os.path.dirname(_found) != _ours:
        sys.stderr.write(
            f"fleet: the package {_other.__name__!r} is somebody else's: {_found}; valid: that of {_ours}, so give "
            "the other one another name, or work in another directory or environment\n"
        )
        sys.exit(2)
