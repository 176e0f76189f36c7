"""Twenty questions of people who meet the project: README and pages answer them, in the words that stand here."""

import pytest

from tests.guide.pages import REPOSITORY

QUESTIONS = [
    ("Which Python do I need, and which system?", "README.md", ["Python 3.11", "developed on Linux"]),
    ("How much disk, and do I need a graphics card?", "docs/guide/install.md", ["2 GB", "No graphics card is needed"]),
    ("Can I install it without make and the source?", "docs/guide/install.md", ["pip install fleet-0.1.0"]),
    ("What may I do with it?", "README.md", ["MIT licence"]),
    ("What is it no good for; does it drive real robots?", "docs/index.md", ["no digital twin", "guide/limits.md"]),
    ("How do I draw my own floor, and see that it works?", "docs/guide/sites.md", ["site check bakery.toml"]),
    ("I have a layout of openTCS. Can I drive on it?", "docs/guide/layouts.md", ["site import theirs.xml"]),
    ("How many cars do I need?", "docs/guide/study.md", ["where more cars stop to pay", "knee"]),
    ("My orders have due dates. How do I write them?", "docs/guide/orders.md", ["`due_s`", "id,release_s,pick,drop"]),
    ("Why does a car stand still?", "docs/guide/waits.md", ["fleet why car_3 --at 18"]),
    (
        "What happens to its parcel when a car breaks down?",
        "docs/guide/disturbances.md",
        ["dies with a parcel", "car_repaired"],
    ),
    (
        "How fast and how large are the cars, what do they carry?",
        "docs/guide/limits.md",
        ["1 m/s", "0.50 m long", "wheelbase 0.325 m", "2 kg"],
    ),
    ("Where are my results, and what does a figure mean?", "docs/guide/demo.md", ["`result.json`", "results.md"]),
    ("I have no display. How do I see anything?", "docs/guide/troubleshooting.md", ["`fleet shot` paints", "tunnel"]),
    ("How do I change the reward?", "docs/guide/own_environment.md", ["RewardWeights(progress=0.5"]),
    ("How long does training take, and is it any good?", "docs/guide/training.md", ["| time |", "| script | chance |"]),
    ("Can I use Stable-Baselines3?", "docs/guide/training.md", ["For Stable-Baselines3", "`MaskablePPO`"]),
    (
        "How do I try my path planner, and who says that it is right?",
        "docs/guide/own_planner.md",
        ["--planner first_come.FirstCome", "referee"],
    ),
    (
        "How good are the planners on published instances?",
        "docs/guide/benchmarks.md",
        ["League of Robot Runners, 2024", "POGEMA"],
    ),
    (
        "Do I get the same figures again, and how do I cite them?",
        "docs/guide/limits.md",
        ["The same seed gives the same run"],
    ),
]


@pytest.mark.parametrize(("question", "page", "words"), QUESTIONS, ids=[question for question, _, _ in QUESTIONS])
def test_a_question_has_its_answer(question: str, page: str, words: list[str]) -> None:
    """A friction of the first hour: disk, limits and rewards of one's own were told nowhere, or on line 701."""
    text = " ".join((REPOSITORY / page).read_text(encoding="utf-8").split())
    assert [word for word in words if word not in text] == [], f"{question} {page} does not answer any more"


def test_every_answer_is_reached_from_the_first_pages() -> None:
    """A friction of the first hour: docs without an index, a quickstart or how-tos."""
    first = "".join((REPOSITORY / page).read_text(encoding="utf-8") for page in ("README.md", "docs/guide/README.md"))
    lost = {page for _, page, _ in QUESTIONS if page.rpartition("/")[2] not in first and page != "README.md"}
    assert lost == set()


def test_the_readme_is_read_in_ten_minutes() -> None:
    """A friction of the first hour: 716 lines, with tables of options before one had seen a picture move."""
    assert len((REPOSITORY / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
