"""Who waits for kernels to be compiled is told so, once; who does not wait hears nothing."""

import io

from numba import njit

from fleet.terminal.compilation import NOTICE, compilation_told


def test_the_first_compilation_is_told_and_no_other() -> None:
    double, triple = njit(lambda x: 2 * x), njit(lambda x: 3 * x)
    said = io.StringIO()
    with compilation_told(said):
        assert said.getvalue() == ""
        assert (double(1), triple(1)) == (2, 3)
    assert said.getvalue() == NOTICE + "\n"
    with compilation_told(said):
        assert (double(2), triple(2)) == (4, 6)  # compiled before
    assert said.getvalue() == NOTICE + "\n"
