"""Play the zoo, and write the table of its results: ``python -m tests.zoo [NAME ...] [--fidelity F] [--out FILE]``.

Every result is compared with what the table of scenarios says; the exit status is 1 if one differs. One scenario alone
is played to see what happens in it: its events are printed as an events file would have them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fleet.config import ScenarioEvent
from tests.zoo.judge import ending_words, faults
from tests.zoo.play import Outcome, play
from tests.zoo.scenario import ALL, Scenario
from tests.zoo.table import SCENARIOS

HEAD = """# Deadlock zoo

{n} small ways for a fleet to come to a stand. Each comes from a public thread or paper, and has to end in success, or
in a refusal or a failed order with a true reason, within a bounded simulated time, at every fidelity. An order is
impossible only if a search that knows nothing of the fleet says so: over all free cells, every lane driven both ways.
`make zoo` plays all of it and writes this page; the scenarios are in [table.py](../tests/zoo/table.py).

**Not yet** marks an end that is not as it has to be.

| scenario | what happens | {fidelities} |
|---|---|{dashes}|
"""


def main(words: Sequence[str] | None = None) -> int:
    """Play scenarios, print how they end, and write the page if a file for it is given."""
    parser = argparse.ArgumentParser(prog="python -m tests.zoo", description="Play the deadlock zoo.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenarios; default: all")
    parser.add_argument("--fidelity", action="append", choices=ALL, help="default: all; may be given several times")
    parser.add_argument("--out", type=Path, help="file for the table of results")
    options = parser.parse_args(words)
    names = [one.name for one in SCENARIOS]
    for name in options.names:
        if name not in names:
            parser.error(f"scenario is {name!r}; valid: {', '.join(names)}")
    chosen = [one for one in SCENARIOS if not options.names or one.name in options.names]
    fidelities = options.fidelity or list(ALL)
    rows, differs = [], 0
    for scenario in chosen:
        cells = []
        for fidelity in fidelities:
            began_s = time.process_time()
            outcome = play(scenario, fidelity)
            found = faults(scenario, outcome)
            known = scenario.fails_today.get(fidelity, "")
            differs += bool(found) != bool(known)
            verdict = ("fails as known" if known else "FAILS") if found else ("ENDS WELL NOW" if known else "ends well")
            took = f"{time.process_time() - began_s:.1f} s of CPU"
            say(f"{scenario.name}, {fidelity}: {verdict}: {ending_words(outcome)} ({took})")
            if options.names:
                say_details(outcome)
            for line in found:
                say(f"    {line}")
            cells.append(("**not yet:** " if found else "") + ending_words(outcome))
        rows.append(row(scenario, cells))
    if options.out is not None:
        head = HEAD.format(n=len(chosen), fidelities=" | ".join(fidelities), dashes="|".join("---" for _ in fidelities))
        options.out.write_text(head + "".join(rows), encoding="utf-8")
    return 1 if differs else 0


def say(line: str) -> None:
    """Write a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def row(scenario: Scenario, cells: Sequence[str]) -> str:
    """A line of the table of results."""
    return f"| [{scenario.name}]({scenario.source}) | {scenario.what} | {' | '.join(cells)} |\n"


def say_details(outcome: Outcome) -> None:
    """Tell what went wrong and when, and what became of orders that were not done."""
    for event in outcome.happened:
        say(event_text(event))
    if outcome.refusal:
        say(f"    {outcome.refusal}")
    for name, ending in outcome.not_done.items():
        word = "possible" if ending.possible else "impossible"
        say(f"    {name} is {ending.state}, and {word} for the referee: {ending.reason}")


def event_text(event: ScenarioEvent) -> str:
    """An event as in an events file."""
    lines = ["[[event]]", f"time_s = {event.time_s:.3f}", f'kind = "{event.kind}"', f'target = "{event.target}"']
    return "\n".join([*lines, *(f"{name} = {value:g}" for name, value in event.parameters.items())])


if __name__ == "__main__":
    sys.exit(main())
