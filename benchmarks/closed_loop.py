"""The closed loop, part of `python -m benchmarks loop`: its rate, its lateness, and the time from contact to wire.

Another process drives two Feetech servos and reads two PaXini pads by their bytes: a gripper that closes on a ball and
opens again. There is one run without a page and one with a page that has a viewer.

* Rate: steps of the scene in a second of the clock, and the number that the loop's own thread could do.
* Lateness: that of the pads' samples, as counted by the loop.
* Latency: from a contact in the engine to the reader's first frame with it, including a sample's period.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.page import page_of, python
from tactemu.base.statistics import Lateness
from tactemu.tune.timing import Report

STEP_S = 0.004
MIN_CONTACT_N = 0.05
"""The force that a frame shows: half a count."""
MAX_LATENCY_S = 0.2
"""Maximum latency; later frames do not count as showing the contact."""
STARTING_S = 5.0
"""The time for the page to start."""
MODEL = """
<mujoco>
  <option timestep="0.002" cone="elliptic" impratio="10"/>
  <default><geom solref="0.008 1" solimp="0.99 0.9995 0.0005" condim="4" priority="1" mass="0.05"/></default>
  <worldbody>
    <body name="carriage">
      <body name="left" pos="0 -0.035 0">
        <joint name="left" type="slide" axis="0 1 0" range="0 0.03" damping="40" armature="2"/>
        <geom name="left pad" type="box" size="0.009 0.004 0.0065"/>
      </body>
      <body name="right" pos="0 0.035 0" euler="0 0 180">
        <joint name="right" type="slide" axis="0 1 0" range="0 0.03" damping="40" armature="2"/>
        <geom name="right pad" type="box" size="0.009 0.004 0.0065"/>
      </body>
    </body>
    <body name="ball">
      <joint type="slide" axis="0 1 0" stiffness="100" damping="5"/><geom name="the ball" type="sphere" size="0.02"/>
    </body>
  </worldbody>
</mujoco>
"""
SCENE = """
[scene]
dt = {step_s}
[engine]
kind = "mujoco"
file = "model.xml"
friction = 0.8
[[skin]]
name = "servos"
device = "feetech_sts3215"
device_options = {{ ids = [1, 2] }}
link = "carriage"
joints.shoulder_pan = {{ joint = "left", ratio = 0.02 }}
joints.shoulder_lift = {{ joint = "right", ratio = 0.02 }}
[[skin]]
name = "pads"
device = "paxini_high_speed"
device_options = {{ models = ["S1813E", "S1813E"], places = [2, 6] }}
link = "carriage"
[skin.links]
"module 2" = {{ body = "left pad", position = [0, 0.004, 0], quaternion = [0.70710678, -0.70710678, 0, 0] }}
"module 6" = {{ body = "right pad", position = [0, 0.004, 0], quaternion = [0.70710678, -0.70710678, 0, 0] }}
"""


class Witness:
    """A recorder of the times at which the engine's pads begin to touch, and of the loop's rate."""

    def __init__(self, emulator, engine):
        self._emulator, self._engine, self._touches = emulator, engine, False
        self.contacts: list[float] = []
        """The times of contact on this machine's monotonic clock [s]."""
        self.steps = 0
        self.began = self.at = (0.0, 0.0)
        """Real time and thread time at the first step and at the last [s]."""

    def __call__(self, simulation, t_s: float) -> None:
        """Record the contact after a step of the engine."""
        now = time.monotonic()
        touches = max(pad.force for pad in self._engine.pads.values()) > MIN_CONTACT_N
        if touches and not self._touches:  # the engine may be ahead of the clock
            self.contacts.append(now + t_s - self._emulator.clock.now_ns() * 1e-9)
        self._touches, self.at, self.steps = touches, (now, time.thread_time()), self.steps + 1
        if self.steps == 1:
            self.began = self.at

    def rates(self) -> tuple[float, float]:
        """Return the steps in a second of the clock, and of the thread's time [1/s]."""
        real, own = (after - before for before, after in zip(self.began, self.at))
        return (self.steps - 1) / max(real, 1e-9), (self.steps - 1) / max(own, 1e-9)


def measured(seconds: float, *, looked_at: bool, step_s: float = STEP_S) -> dict[str, float]:
    """Measure one run with steps of ``step_s``, and return its figures by name."""
    from tactemu.session.serving import serve

    name = f"bench-closed-{os.getpid()}"
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tactemu-bench-")))
        (folder / "model.xml").write_text(MODEL, encoding="utf-8")
        (folder / "scene.toml").write_text(SCENE.format(step_s=step_s), encoding="utf-8")
        run = stack.enter_context(serve(folder / "scene.toml", name=name))
        witness = Witness(run.emulator, run.simulation.posers[0].__self__)
        if looked_at:
            url, _ = stack.enter_context(page_of(name))
            viewer = python("benchmarks.viewers", url, seconds + 2 * STARTING_S, 1)
            stack.callback(viewer.communicate, timeout=seconds + 60)
            time.sleep(STARTING_S)
        pads = next(channel for channel in run.emulator.channels if channel.name == "pads").statistics

        def begin() -> None:
            run.simulation.posers.append(witness)
            pads.lateness, pads.missed = Lateness(), 0

        run.in_loop(begin)
        command = [sys.executable, "-m", "benchmarks.closed_loop_driver", *run.ports.values(), str(seconds)]
        said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=seconds + 60).stdout
        late = run.stats("pads")["skins"]["pads"]
        rate, could = witness.rates()
    told = np.array(json.loads(said))
    after = np.array([told[told > at - step_s].min(initial=np.inf) - at for at in witness.contacts])
    after = after[after < MAX_LATENCY_S]
    if not len(after):
        raise RuntimeError(f"no contact came through: {len(witness.contacts)} in the engine, {len(told)} on the wire")
    figures = {name: late[name] for name in ("lateness_p50_us", "lateness_p99_us", "missed")}
    p50, p99 = np.percentile(after, (50, 99)) * 1e3
    return figures | {
        "steps_per_s": rate,
        "could_do_per_s": could,
        "contacts": len(witness.contacts),
        "told": len(after),
        "p50_ms": p50,
        "p99_ms": p99,
    }


def run(report: Report, *, seconds: float = 20.0) -> dict[str, float]:
    """Measure a run without a page and one with a page, report a line for each, and return the figures by name."""
    found: dict[str, float] = {}
    for looked_at in (False, True):
        got = measured(seconds, looked_at=looked_at)
        page = "with a page" if looked_at else "no page    "
        report(
            f"closed loop, {page} {got['steps_per_s']:.0f} steps/s (could do {got['could_do_per_s']:.0f}), late p50 "
            f"{got['lateness_p50_us']:.0f} µs, p99 {got['lateness_p99_us']:.0f} µs, missed {got['missed']:.0f}; "
            f"contact to wire p50 {got['p50_ms']:.1f} ms, p99 {got['p99_ms']:.1f} ms, {got['told']} of "
            f"{got['contacts']} within {1e3 * MAX_LATENCY_S:.0f} ms"
        )
        found |= {f"closed_{name}{'_with_page' if looked_at else ''}": value for name, value in got.items()}
    return found
