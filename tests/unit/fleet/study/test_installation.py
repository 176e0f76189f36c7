"""What has to be the same on every machine of a cluster."""

from fleet.study.installation import SOURCE, first_difference, installation


def test_an_installation_knows_its_source_and_its_packages() -> None:
    here = installation()
    assert len(here[SOURCE]) == 12
    assert int(here[SOURCE], 16) >= 0
    assert {"python", "numpy", "numba"} <= set(here)
    assert first_difference(here, dict(here)) == ""


def test_the_first_difference_is_named_with_both_versions() -> None:
    assert first_difference({"a": "1", "b": "2"}, {"a": "1", "b": "3"}) == "b 2 here, 3 there"
    assert first_difference({"a": "1"}, {}) == "a 1 here, none there"
    assert first_difference({}, {"a": "1"}) == "a none here, 1 there"
