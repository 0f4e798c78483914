"""The cost of a live page for the loop, and its pictures a second: `python -m benchmarks page`.

* Lateness: pairs of runs, without a page and with one that has four viewers: two that read, one that stops reading
  after a second, one that is killed halfway. The skins sample at 1 kHz and at 100 Hz, on ptys without a reader.
* Pictures: of 60 boards with 4,200 taxels, as sent to viewers, and as drawn by a headless Chromium at 800 x 600 without
  a GPU, if there is one.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks import bus
from benchmarks.control import SCENE
from tactemu.base.errors import TactemuError
from tactemu.control.client import connect
from tactemu.tune.timing import Report

BOARDS = 60
_COUNT_FRAMES = """
window.drawn = 0;
let some = false;
for (const name of ["drawElements", "drawElementsInstanced", "drawArrays", "drawArraysInstanced"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...args) { some = true; return draw.apply(this, args); };
}
const tick = () => { if (some) window.drawn += 1; some = false; requestAnimationFrame(tick); };
requestAnimationFrame(tick);
"""


def python(*words: object, **more: Any) -> subprocess.Popen[str]:
    """Start a Python program in a process of its own."""
    return subprocess.Popen([sys.executable, "-m", *map(str, words)], stdout=subprocess.PIPE, text=True, **more)


@contextlib.contextmanager
def _running(scene: str, *more: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run a scene, and yield name and process of the run once it is ready."""
    name = f"bench-{os.getpid()}"
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
        file = Path(folder) / "scene.toml"
        file.write_text(scene, encoding="utf-8")
        run = python("tactemu", "run", file, "--json", "--name", name, *more)
        try:
            assert run.stdout is not None
            if '"ready"' not in run.stdout.readline():
                raise TactemuError(f"the run has ended (exit status {run.poll()})")
            yield name, run
        finally:
            run.terminate()
            run.communicate(timeout=60)


@contextlib.contextmanager
def page_of(name: str) -> Iterator[tuple[str, int]]:
    """Show the run on a page, and yield the page's link and process id."""
    page = python("tactemu", "see", name, "--web-port", 0)
    try:
        assert page.stdout is not None
        yield page.stdout.readline().split()[-1], page.pid
    finally:
        page.terminate()
        page.communicate(timeout=60)


def _late_us(seconds: float, *, seen: bool, preempt: bool) -> tuple[float, float]:
    """Return the 99th percentile of lateness in such a run [us], and the memory of the page [MB]."""
    with contextlib.ExitStack() as stack:
        name, _ = stack.enter_context(_running(SCENE, *(["--preempt"] if preempt else [])))
        memory = 0.0
        if seen:
            url, pid = stack.enter_context(page_of(name))
            killed = python("benchmarks.viewers", url, 2 * seconds, 1)
            others = python("benchmarks.viewers", url, seconds, 3, "stall")
            time.sleep(seconds / 2)
            killed.kill()
            killed.communicate()
            others.communicate(timeout=seconds + 30)
            memory = _memory_mb(pid)
        else:
            time.sleep(seconds)
        with connect(name) as emulator:
            skins = emulator.stats()["skins"]
    return max(skin["lateness_p99_us"] for skin in skins.values()), memory


def _memory_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def lateness(report: Report, *, pairs: int, seconds: float, preempt: bool) -> dict[str, Any]:
    """Measure the lateness in pairs of runs."""
    without, seen, memory = [], [], []
    for _ in range(pairs):
        without.append(_late_us(seconds, seen=False, preempt=preempt)[0])
        late, megabytes = _late_us(seconds, seen=True, preempt=preempt)
        seen.append(late)
        memory.append(megabytes)
        report(f"late p99 without {without[-1]:.0f} us, with four who look {seen[-1]:.0f} us; page {megabytes:.0f} MB")
    more = median(seen) - median(without)
    report(f"medians of {pairs}: {median(without):.0f} us, {median(seen):.0f} us: {more:+.0f} us")
    return {"without_us": without, "seen_us": seen, "more_us": more, "page_mb": memory}


def pictures(report: Report, *, seconds: float) -> dict[str, Any]:
    """Measure the pictures a second of a robot's complete skin, as sent and as drawn."""
    scene = bus.scene(BOARDS)
    for k in range(BOARDS // bus.BOARDS_PER_BUS):
        scene = scene.replace(f'"can:socketcan:can{k}"', '"memory:"')
    figures: dict[str, Any] = {}
    with _running(scene) as (name, _), page_of(name) as (url, _):
        looked = python("benchmarks.viewers", url, seconds, 1)
        sent = json.loads(looked.communicate(timeout=seconds + 60)[0])[0]
        figures["sent_per_s"] = sent["pictures_per_s"]
        report(f"{BOARDS} boards, {BOARDS * bus.TRIANGLES * 10} taxels: {figures['sent_per_s']:.1f} pictures/s sent")
        if shutil.which("chromium"):
            figures["drawn_per_s"] = _drawn(url, seconds)
            report(f"drawn by Chromium at 800 x 600 without a GPU: {figures['drawn_per_s']:.1f} pictures/s")
    return figures


def _drawn(url: str, seconds: float) -> float:
    """Return the number of pictures that a browser draws in a second."""
    from playwright.sync_api import sync_playwright

    arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = browser.new_page(viewport={"width": 800, "height": 600})
        page.add_init_script(_COUNT_FRAMES)
        page.goto(url)
        page.wait_for_selector("canvas[data-engine]", timeout=60_000)
        page.wait_for_timeout(6000)  # the scene arrives, and shaders are compiled
        before = page.evaluate("window.drawn")
        page.wait_for_timeout(1e3 * seconds)
        drawn = page.evaluate("window.drawn") - before
        browser.close()
    return drawn / seconds


def run(
    report: Report, *, pairs: int = 5, seconds: float = 8.0, only: str = "", preempt: bool = False
) -> dict[str, Any]:
    """Measure everything, or ``only`` a part, report one line per figure, and return the figures by name."""
    found: dict[str, Any] = {}
    if only in ("", "pictures"):
        found["pictures"] = pictures(report, seconds=seconds)
    if only in ("", "lateness"):
        found["lateness"] = lateness(report, pairs=pairs, seconds=seconds, preempt=preempt)
    return found
