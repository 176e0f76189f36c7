"""Tables as a notebook shows them."""

import xml.etree.ElementTree as ET

from fleet.report.table import table


def test_a_notebook_shows_rows_and_leaves_out_what_is_not_known() -> None:
    made = table("t", ("name", "value <s>", "n"), [("a & b", 1.23456, 2), ("c", None, 3), ("d", 12345.6, 4)])
    root = ET.fromstring(made._repr_html_())
    assert [one.text for one in root.iter("th")] == ["name", "value <s>", "n"]
    rows = [[cell.text or "" for cell in row.iter("td")] for row in root.iter("tr")]
    assert rows == [[], ["a & b", "1.235", "2"], ["c", "", "3"], ["d", "12346", "4"]]
