"""The viewer in a browser: headless Chromium, painting in software, comes to show a run that is served."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image

from fleet.recording import Header, RerunRecorder
from fleet.recording.rerun_cli import quiet_environment, rerun_program
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene
from tests.unit.fleet.recording.test_rerun_recorder import free_port

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
MOST_S = 400.0
"""Wall time that painting in software may take on a busy machine [s]."""
LEAST = 0.0002
"""Share of the page with the colour of an arm's joints when there are arms: of the demo's it was 0.0005."""
ORANGE = ((200, 60, 0), (255, 120, 40))
"""Of the arms' joints: least and greatest red, green and blue."""


class Browser:
    """Headless Chromium with one page, spoken to by its debugging protocol over a pipe.

    Source: https://chromedevtools.github.io/devtools-protocol/, `--remote-debugging-pipe`: messages end with a zero.
    """

    def __init__(self, profile: Path, url: str) -> None:
        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()

        assert CHROMIUM is not None
        command = [CHROMIUM, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        command += [f"--user-data-dir={profile}", "--window-size=1200,800", "--remote-debugging-pipe", "about:blank"]
        # It reads from descriptor 3 and writes to descriptor 4.
        self.process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{to_read} 4>&{to_write}', "bash", *command],
            pass_fds=(to_read, to_write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(to_write)
        self._read, self._number = b"", 0
        page = self._ask("Target.createTarget", url=url)["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]

    def picture(self) -> Image.Image:
        """What the page shows."""
        shot = self._ask("Page.captureScreenshot", session=self._session, format="png")
        return Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait(30.0)
        os.close(self._to)
        os.close(self._from)

    def _ask(self, method: str, session: str = "", **parameters: object) -> dict[str, Any]:
        self._number += 1
        question = {"id": self._number, "method": method, "params": parameters}
        os.write(self._to, json.dumps(question | ({"sessionId": session} if session else {})).encode() + b"\0")
        while True:
            answer, end, rest = self._read.partition(b"\0")
            if not end:
                self._read += os.read(self._from, 1 << 16)
                continue
            self._read, told = rest, json.loads(answer)
            if told.get("id") == self._number:
                return told["result"]


@contextmanager
def served(uri: str) -> Iterator[str]:
    """The viewer as a page on the loopback interface, for a run that is served elsewhere; its address."""
    port = free_port()
    words = ["--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(port)]
    with quiet_environment() as environment:
        process = subprocess.Popen(
            [rerun_program(), *words, uri],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            wait_for_port(port)
            yield f"http://127.0.0.1:{port}?url={quote(uri, safe='')}"
        finally:
            process.terminate()
            process.wait(30.0)


def wait_for_port(port: int) -> None:
    """Until somebody listens."""
    end_s = time.monotonic() + 60.0
    while time.monotonic() < end_s:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    pytest.fail(f"nobody listens at port {port}")


def share_of_orange(picture: Image.Image) -> float:
    """Which share of a picture has the colour of the arms' joints."""
    least, most = ORANGE
    pixels = np.asarray(picture)
    return float(((pixels >= least) & (pixels <= most)).all(axis=2).mean())


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (Debian, Ubuntu: apt-get install chromium)")
def test_the_browser_shows_a_run_that_is_served(tmp_path: Path) -> None:
    """A friction of the first hour: a black page with faint text."""
    scene, floor = made_up_scene(3, 4, (16.0, 12.0))
    header = Header(scene=scene, floor=floor, about={})
    with RerunRecorder(tmp_path / "a.rrd", header, tick_s=1 / 60, port=free_port()) as recorder:
        for frame in made_up_frames(scene, 30):
            recorder.record(frame)
        with served(recorder.uri) as url:
            browser = Browser(tmp_path / "profile", url)
            try:
                end_s, seen = time.monotonic() + MOST_S, 0.0
                while seen < LEAST and time.monotonic() < end_s:
                    time.sleep(2.0)
                    picture = browser.picture()
                    picture.save(tmp_path / "seen.png")
                    seen = share_of_orange(picture)
                assert seen >= LEAST, f"no arms in {tmp_path / 'seen.png'}"
                assert len(picture.getcolors(picture.width * picture.height) or []) > 500  # no blank page
            finally:
                browser.close()
