"""Every fault against every unmodified driver: what the driver makes of it.

``python -m tests.drivers.fault_matrix --write`` runs all of it (some ten minutes) and writes
``docs/drivers-under-faults.md``. A driver is stopped after :data:`LIMIT_S`; its process is its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tactemu
from tests.drivers.rig import DRIVERS as SCRIPTS
from tests.drivers.test_inspire_rh56dftp import INDEX_TOP, PALM

PAGE = Path(__file__).parents[2] / "docs" / "drivers-under-faults.md"
LIMIT_S = 25.0

SCENE = """
[[body]]
name = "pad"
shape = "box"
size = [0.01, 0.01, 0.01]
position = [0.0, 0.0, -0.02]
fixed = true

[[skin]]
name = "skin"
device = "{device}"
link = "pad"
position = [0.0, 0.0, 0.02]
rate_hz = 100
options = {{ bias = {bias}, noise = {noise} }}
"""

FAULTS = (
    "drop 5%",
    "flip 5%",
    "truncate 5%",
    "length 5%",
    "checksum 5%",
    "duplicate 5%",
    "reorder 5%",
    "garbage 5%",
    "split 20% by 5ms",
    "merge 20%",
    "late 5% by 30ms",
    "stray 5%",
    "latency 16ms",
    "silence at {at} for 1s",
    "unplug at {at} for 0.5s",
)

TOUCH_FORCE = [121591.0 / (33000.0 / (k * (3.3 / 4096.0)) + 10000) + 0.878894 if k else 0 for k in range(4096)]
"""The ability-hand driver's arithmetic, in its order of operations."""


@dataclass(frozen=True)
class Driver:
    """One driver, how to run it, and what it should say for given counts."""

    name: str
    device: str
    script: str
    arguments: Callable[[str], list[str]]
    readings: Callable[[Any], list]
    expected: Callable[[np.ndarray], Any] = lambda counts: counts
    rejects: Callable[[Any], int] | None = None
    """Readings that the driver itself marks as bad."""
    port: str | None = None
    bias: float = -1.0
    noise: float = 0.2
    at: str = "1200ms"
    """A moment when it reads, for what happens once."""


OPTOFORCE_SCALE = np.array([1 / 7925 * 300, 1 / 8641 * 300, 1 / 6049 * 2000])


def _optoforce(packets) -> list:
    return [[packet[name] for name in ("Fx", "Fy", "Fz")] for packet in packets if packet["valid_checksum"]]


ALL = (
    Driver(
        "anyskin 1.0.0", "anyskin", "anyskin_read.py", lambda port: ["anyskin", port, "240"],
        lambda got: got["readings"][40:], lambda counts: counts.reshape(-1),
    ),
    Driver(
        "pyrobotiqtactile 0.1.2", "robotiq_tsf85", "pyrobotiqtactile_read.py", lambda port: [port, "10", "sync"],
        lambda got: [reading["pressure"] for reading in got["readings"]],
    ),
    Driver(
        "ability-hand 0.2.2", "ability_hand", "ability_hand_read.py", lambda port: [port, "0"],
        lambda got: got["fsr"], lambda counts: [TOUCH_FORCE[count] for count in counts], bias=-3.0, noise=1.0,
    ),
    Driver(
        "flexitac 0.3.1", "flexitac", "flexitac_read.py", lambda port: [port],
        lambda got: got, bias=-0.5, noise=0.1,
    ),
    Driver(
        "optoforce 0.3.0", "optoforce", "optoforce_read.py", lambda port: [port, "OptoForce16"],
        _optoforce, lambda counts: (counts * OPTOFORCE_SCALE).reshape(-1),
        rejects=lambda packets: sum(not packet["valid_checksum"] for packet in packets),
        bias=-200.0, noise=20.0, at="600ms",
    ),
    Driver(
        "pymodbus 3.11", "inspire_rh56dftp", "pymodbus_read.py", lambda port: [port],
        lambda got: got["many"], lambda counts: counts[PALM], noise=0.5,
    ),
    Driver(
        "plusml-rh56dftp 0.1.7", "inspire_rh56dftp", "plusml_rh56dftp_read.py",
        lambda port: [port.removeprefix("socket://")], lambda got: [values[:96] for values in got["many"]],
        lambda counts: counts[INDEX_TOP], port="tcp:127.0.0.1:0", noise=0.5,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What became of one run."""

    injected: int
    readings: int = 0
    wrong: int = 0
    """Readings that the sensor never sent."""
    rejected: int | None = None
    error: str = ""

    def __str__(self) -> str:
        if self.error:
            return self.error
        words = f"{self.wrong} wrong of {self.readings}" if self.wrong else f"all {self.readings} right"
        return words if self.rejected is None else f"{words}, {self.rejected} rejected"


def run(driver: Driver, fault: str, *, seed: int = 0) -> Outcome:
    """Serve the driver's device with one fault and let the driver read it."""
    fault = fault.format(at=driver.at)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(SCENE.format(device=driver.device, bias=driver.bias, noise=driver.noise))
        faults = (fault,) if fault else ()
        with tactemu.serve(scene, driver.port, faults=faults, seed=seed) as dev:
            command = [sys.executable, str(SCRIPTS / driver.script), *driver.arguments(dev.port)]
            try:
                done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=LIMIT_S, cwd=folder)
            except subprocess.TimeoutExpired:
                return Outcome(_injected(dev, fault), error=f"does not come back ({LIMIT_S:.0f} s)")
            injected = _injected(dev, fault)
            truth = [sample.counts for sample in dev.truth.samples]
    if done.returncode:
        return Outcome(injected, error=f"raises `{_last_line(done.stderr)}`")
    got = json.loads(done.stdout.splitlines()[-1])
    readings = [np.asarray(reading, float).tobytes() for reading in driver.readings(got)]
    sent = {np.asarray(driver.expected(counts), float).tobytes() for counts in truth}
    wrong = sum(reading not in sent for reading in readings)
    return Outcome(injected, len(readings), wrong, driver.rejects(got) if driver.rejects else None)


def _injected(dev, fault: str) -> int:
    return dev.truth.injected[fault.split()[0]] if fault else 0


def _last_line(stderr: str) -> str:
    lines = [line for line in stderr.splitlines() if line and not line.startswith((" ", "Exception in thread"))]
    return (lines or ["(no message)"])[-1][:90].replace("|", "/").replace("`", "'")


def main() -> None:
    """Run the matrix and print it, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name}")
    parser.add_argument("--only", default="", help="drivers whose name contains this")
    wishes = parser.parse_args()
    rows = []
    drivers = [driver for driver in ALL if wishes.only in driver.name]
    for driver in drivers:
        for fault in ("", *FAULTS):
            try:
                outcome = run(driver, fault)
            except tactemu.TactemuError as error:
                outcome = Outcome(0, error=f"({error})")
            rows.append((driver, fault.format(at=driver.at), outcome))
            print(f"{driver.name:24} {rows[-1][1] or 'no fault':26} {outcome.injected:4}  {outcome}", flush=True)
    if wishes.write:
        PAGE.write_text(page(rows))


def page(rows: list[tuple[Driver, str, Outcome]]) -> str:
    """The documentation page."""
    lines = [HEAD]
    for driver in dict.fromkeys(driver for driver, _, _ in rows):
        lines += [f"\n## {driver.name} (`{driver.device}`)\n", "| fault | injected | the driver |", "|---|---|---|"]
        lines += [f"| {fault or 'none'} | {o.injected} | {o} |" for each, fault, o in rows if each is driver]
    return "\n".join(lines) + "\n"


HEAD = """\
# Drivers under faults

What unmodified drivers make of a wire that goes wrong. Each row is one run of `python -m tests.drivers.fault_matrix`: a
driver from the package index, in its own process, asks for 200 readings while one fault is on (seed 0); every reading
that it hands to its caller is compared with the truth log.

* **all N right**: every one of N readings is one that the sensor sent.
* **N wrong**: the driver handed over N readings that the sensor never sent.
* **N rejected**: the driver marked N readings as bad by itself.
* **raises**: the program ends with this exception if it does not catch it.
* **does not come back**: the driver still waited when it was stopped.

`injected` counts frames for most faults (`tactemu faults` lists them), packets handed over late for `latency`.
A script that does not reconnect ends at `unplug`: that is how the drivers' users would see it."""


if __name__ == "__main__":
    main()
