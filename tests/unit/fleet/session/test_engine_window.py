"""The display: what is drawn are the run's own lanes and paths, and the sliders set the pace and nothing else."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session import engine_window as display_module
from fleet.session.engine_window import Display
from fleet.simulation import Simulation
from fleet.terminal.pacing import Pace

CONFIG = RunConfig(site="cell", robots=2, tasks=2, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))


class FakeWindow:
    """Remembers what is drawn; sliders stand where a test puts them."""

    def __init__(self) -> None:
        self.drawn: dict[str, np.ndarray] = {}
        self.cars: Sequence[str] = ()
        self.places: Sequence[str] = ()
        self.sliders: list[float] = []
        self.reads = 0
        self.released_after: int | None = None

    @contextmanager
    def held(self) -> Iterator[None]:
        yield

    def frame(self, size_m: tuple[float, float]) -> None:
        assert min(size_m) > 0

    def name_cars(self, names: Sequence[str], height_m: float) -> None:
        self.cars = names

    def name_places(self, names: Sequence[str], points: np.ndarray) -> None:
        assert points.shape == (len(names), 3)
        self.places = names

    def dots(self, key: str, points: np.ndarray, rgb: np.ndarray, size: float) -> None:
        assert points.shape == rgb.shape
        assert ((rgb >= 0) & (rgb <= 1)).all()
        self.drawn[key] = points

    def slider(self, name: str, low: float, high: float, start: float) -> int:
        assert low <= start <= high
        self.sliders.append(start)
        return len(self.sliders) - 1

    def value(self, slider: int) -> float:
        self.reads += 1
        if self.released_after is not None and self.reads > self.released_after:
            self.sliders[1] = 0.0
        return self.sliders[slider]


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    """Return a run of two cars that have been driving for three seconds."""
    with Simulation(CONFIG) as run:
        while run.sim_s < 3.0:
            run.tick()
        yield run


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> FakeWindow:
    """Return a window that may be looked at as often as wanted."""
    monkeypatch.setattr(display_module, "LOOK_S", 0.0)
    monkeypatch.setattr(display_module, "REST", 0.0)
    return FakeWindow()


def test_lanes_paths_and_names_are_drawn(simulation: Simulation, window: FakeWindow) -> None:
    Display(simulation, window, Pace(0.0)).look([])
    assert list(window.cars) == ["car_0", "car_1"]
    assert list(window.places) == ["pick_1", "drop_1"]
    assert len(window.drawn["lanes"]) == 4 * len(simulation.site.lanes)
    granted = window.drawn["granted"][:, :2]
    driven = [simulation.driver.remaining(car) for car in range(2)]
    moving = next(line for line in driven if len(line) > 1)
    assert np.abs(granted - moving[0]).sum(axis=1).min() < 1e-9
    for point in granted:
        assert min(np.linalg.norm(line - point, axis=1).min() for line in driven if len(line)) < 0.3


def test_the_slider_sets_the_pace(simulation: Simulation, window: FakeWindow) -> None:
    pace = Pace(2.0)
    display = Display(simulation, window, pace)
    display.look([])
    assert pace.speed == 2.0
    window.sliders[0] = 5.0
    display.look([])
    assert pace.speed == 5.0


def test_a_pause_ends_when_it_is_ended(
    simulation: Simulation, window: FakeWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(display_module, "NAP_S", 0.0)
    display = Display(simulation, window, Pace(0.0))
    window.sliders[1] = 1.0
    window.released_after = 20
    display.look([])
    assert window.reads > 20
    assert simulation.sim_s == pytest.approx(3.0)


def test_an_interrupt_ends_a_pause(simulation: Simulation, window: FakeWindow) -> None:
    display = Display(simulation, window, Pace(0.0))
    window.sliders[1] = 1.0
    display.look([2])
    assert window.reads == 2


def test_a_window_is_looked_at_now_and_then_only(simulation: Simulation, window: FakeWindow) -> None:
    display = Display(simulation, window, Pace(0.0))
    display.look([])
    display_module.LOOK_S = 1e6  # put back by the fixture
    display.look([])
    before = window.reads
    for _ in range(100):
        display.look([])
    assert window.reads == before


def test_a_pace_holds_a_run_back_from_where_it_was_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    monkeypatch.setattr("fleet.terminal.pacing.time.perf_counter", lambda: now[0])
    monkeypatch.setattr("fleet.terminal.pacing.time.sleep", sleep)
    pace = Pace(2.0)
    pace.wait(1.0, [])
    assert sum(slept) == pytest.approx(0.5)
    pace.change(0.5, 1.0)
    pace.wait(1.5, [])
    assert sum(slept) == pytest.approx(1.5)
    pace.wait(99.0, [2])
    pace.change(0.0, 99.0)
    pace.wait(999.0, [])
    assert sum(slept) == pytest.approx(1.5)
