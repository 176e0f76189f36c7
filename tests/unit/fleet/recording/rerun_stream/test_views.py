"""The eye before the arm at work stays while that arm works, and goes on when only others do."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.recording import Header, RerunRecorder
from fleet.recording.rerun_stream.views import EYE, close_up
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene
from tests.unit.fleet.recording.test_rerun_recorder import rows


@pytest.mark.parametrize(
    ("said", "watched"),
    [
        ((("idle", "idle"), ("idle", "moving"), ("planning", "moving")), {0: 0, 2: 1}),
        ((("moving", "moving"), ("idle", "moving"), ("moving", "idle")), {0: 0, 2: 1, 4: 0}),
        ((("idle", "holding"), ("idle", "idle"), ("idle", "moving")), {0: 1}),
    ],
)
def test_the_eye_is_before_an_arm_that_works(
    said: Sequence[tuple[str, ...]], watched: dict[int, int], tmp_path: Path
) -> None:
    """A friction of the first hour: the close-up showed the arm of pick_1 for ever."""
    scene, floor = made_up_scene(2, 2, (16.0, 12.0))
    with RerunRecorder(tmp_path / "a.rrd", Header(scene=scene, floor=floor, about={}), tick_s=1 / 60) as recorder:
        for words, frame in zip(said, made_up_frames(scene, len(said)), strict=True):
            recorder.record(replace(frame, arm_state=words))
    recorded = rows(tmp_path / "a.rrd", f"/{EYE}", "Transform3D:translation")
    assert list(recorded) == list(watched)
    for tick, arm in watched.items():
        np.testing.assert_allclose(np.ravel(recorded[tick]), close_up(scene.arm_base[arm])[0], atol=1e-5)
