"""Files of layouts that are broken: one line each that says where, what stands there, and what is valid."""

import builtins

import pytest

from benchmarks.interop.broken import BROKEN, refusal, well_said
from maps.layouts.formats import LAYOUT_FORMATS, format_of
from maps.layouts.layout import LayoutError
from maps.site import load_site


@pytest.mark.parametrize("case", range(len(BROKEN)), ids=lambda k: f"{BROKEN[k][0]}-{k}")
def test_a_broken_file_is_refused_in_one_line(case):
    name, change, expected = BROKEN[case]
    if not LAYOUT_FORMATS[name].headings:
        pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    said = refusal(name, change)
    assert well_said(said, expected), said


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("a.lif.json", "lif"),
        ("A.XML", "opentcs"),
        ("m.building.yaml", "building"),
        ("0.yaml", "rmf"),
        ("g.geojson", "nav2"),
    ],
)
def test_a_format_is_told_by_the_name_of_the_file(file, name):
    assert format_of(file) == name


def test_a_name_that_says_nothing_is_refused():
    with pytest.raises(LayoutError, match=r"floor.dwg: the name says no format; valid: --format lif\|opentcs"):
        format_of("floor.dwg")


def test_an_encoding_that_there_is_not_does_not_matter_to_a_text():
    text = LAYOUT_FORMATS["opentcs"].write(load_site("cell"))
    assert LAYOUT_FORMATS["opentcs"].read(text.replace("utf-8", "utf-8nan", 1), "file").name == "cell"


def test_without_yaml_one_line_names_the_cure(monkeypatch):
    import_module = builtins.__import__

    def without_yaml(name, *args, **kwargs):
        if name == "yaml":
            raise ImportError(name)
        return import_module(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_yaml)
    with pytest.raises(LayoutError, match=r"need PyYAML, which is not installed; valid: pip install '.\[rmf\]'$"):
        LAYOUT_FORMATS["rmf"].write(load_site("cell"))
