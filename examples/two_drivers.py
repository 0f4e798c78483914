"""One press, two sensors, two unmodified drivers: the simulated forces beside the values that each driver read.

A ball presses a simulated AnySkin, which the ``anyskin`` package reads from a virtual serial port, and then a simulated
LinkerHand fingertip, which the ``linkerbot`` SDK reads over CAN. Both drivers are unmodified, and each runs in its own
process. Start this program with ``scripts/try`` or ``python examples/two_drivers.py``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from typing import NoReturn

import numpy as np
from rich.columns import Columns
from rich.console import Console, Group
from rich.text import Text

import tactemu

DEPTH = 1.5e-3
TIME_LIMIT_S = 90

FRAMES = 50
"""Number of frames that a driver reads before the press, and again during and after it."""

ANYSKIN_DRIVER = """
import contextlib, json, sys
from anyskin.sensor import AnySkinBase
with contextlib.redirect_stdout(sys.stderr):
    driver = AnySkinBase(num_mags=5, port=sys.argv[1], temp_filtered=False)
while True:
    print(json.dumps(list(map(float, driver.get_sample()[1]))), flush=True)
"""

LINKERBOT_DRIVER = """
import json, sys
from linkerbot import L6, TimeoutError
with L6("left", sys.argv[1], sys.argv[2]) as hand:
    while True:
        try:
            data = hand.force_sensor.get_blocking(timeout_ms=500)
        except TimeoutError:  # the SDK asks before it waits: on a busy machine it may miss an answer
            continue
        fingers = [getattr(data, name).values.tolist() for name in ("thumb", "index", "middle", "ring", "pinky")]
        print(json.dumps(fingers), flush=True)
"""


def ended(process: subprocess.Popen[str]) -> NoReturn:
    """Exit with the last line that an ended driver printed."""
    lines = process.communicate()[1].strip().splitlines() or ["nothing"]
    sys.exit(
        f"The driver has ended; its last line: {lines[-1]}\nTo install both drivers: pip install 'tactemu[drivers]'"
    )


def wait_for(process: subprocess.Popen[str], dev) -> None:
    """Return when the driver has opened the port; exit with its message if it ends instead."""
    deadline = time.monotonic() + TIME_LIMIT_S
    while True:
        try:
            return dev.wait_for_driver(0.5)
        except TimeoutError as error:
            if process.poll() is not None:
                ended(process)
            if time.monotonic() > deadline:
                sys.exit(str(error))


def read_while_pressed(dev, driver: str, *arguments: str, taxel: int) -> np.ndarray:
    """Start a driver, press while it reads, and return the frames that it decoded."""
    command = [sys.executable, "-c", driver, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    silent = threading.Timer(TIME_LIMIT_S, process.kill)
    silent.start()
    frames: list[list[float]] = []

    def read() -> None:
        lines = [process.stdout.readline() for _ in range(FRAMES)]
        if not lines[-1]:
            ended(process)
        frames.extend(map(json.loads, lines))

    try:
        wait_for(process, dev)
        read()
        dev.press(DEPTH, taxel=taxel)
        read()
        dev.release()
        read()
    finally:
        silent.cancel()
        process.kill()
    return np.array(frames, np.float32)


SHADES = "·░▒▓█"
COLOURS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")


def picture(layout, values: np.ndarray, patch) -> Text:
    """Return a heat map of a patch: its grid, or the places in x and y of taxels that form none."""
    if patch.rows:
        rows, columns = np.divmod(np.arange(len(patch)), patch.cols)
    else:
        places = layout.positions[patch.taxels, :2] / layout.pitches.min()
        columns, rows = np.rint((places - places.min(axis=0)) * (1, -1)).astype(int).T
        rows -= rows.min()
    shares = values[patch.taxels] / (values[patch.taxels].max() or 1.0)
    cells = dict(zip(zip(rows.tolist(), columns.tolist()), shares, strict=True))
    text = Text(no_wrap=True)
    for row in range(rows.max() + 1):
        text.append("\n" if row else "")
        for column in range(columns.max() + 1):
            share = cells.get((row, column))
            level = 0 if share is None or share < 1 / 64 else min(1 + int(4 * share), 4)
            text.append("  " if share is None else 2 * SHADES[level], COLOURS[level])
    return text


def compare(console: Console, dev, read: np.ndarray, counts_of, title: str, unit: str, patch_name: str) -> bool:
    """Print simulated beside read values at the deepest moment; return True if every frame read equals a sent one."""
    device = dev.device()
    layout = device.layout
    samples = list(dev.truth.samples)
    sent = {counts_of(sample.counts).tobytes(): sample for sample in samples}
    matched = [sent.get(frame.tobytes()) for frame in read]
    deepest = int(np.argmax(np.abs(read - read[0]).reshape(len(read), -1).sum(axis=1)))
    change = np.abs((read[deepest] - read[0]).reshape(len(layout), -1)[:, -1])
    patch = next(patch for patch in layout.patches if patch.name == patch_name)
    forces = layout.push(matched[deepest].ideal) if matched[deepest] else np.zeros(len(layout))
    console.print(Text(f"\n{title}", style="bold"))
    console.print(
        Columns(
            [
                Group(Text("simulated: force per taxel"), picture(layout, forces, patch),
                      Text(f"peak {forces.max():.3g} N", style="dim")),
                Group(Text("read: change per taxel"), picture(layout, change, patch),
                      Text(f"peak {change.max():.4g} {unit}", style="dim")),
            ],
            padding=(0, 6),
        )
    )  # fmt: skip
    same = sum(entry is not None for entry in matched)
    verdict = "." if same == len(read) else ": THE OTHERS WERE NEVER SENT."
    console.print(
        f"The driver read {len(read)} frames; {same} of them equal a frame of the truth log, bit for bit{verdict}"
    )
    return same == len(read) and change.max() > 0


def anyskin(console: Console) -> bool:
    """Run the ``anyskin`` package against an AnySkin on a virtual serial port; return True if it read every frame."""
    with tactemu.serve("anyskin", rate_hz=100) as dev:
        read = read_while_pressed(dev, ANYSKIN_DRIVER, dev.port, taxel=2)
        title = f"AnySkin on the serial port {dev.port}, read by the anyskin package"
        return compare(console, dev, read, lambda c: np.float32(c).ravel(), title, "µT (Bz)", "skin")


def linker_hand(console: Console) -> bool:
    """Run the ``linkerbot`` SDK against a LinkerHand L6 over CAN (UDP multicast, which needs no CAN in the kernel)."""
    with tactemu.serve("linker_hand_l6", rate_hz=100) as dev:
        index = next(patch for patch in dev.device().layout.patches if "index" in patch.name)
        middle = index.start + 6 * index.cols + index.cols // 2
        read = read_while_pressed(dev, LINKERBOT_DRIVER, dev.can["channel"], dev.can["interface"], taxel=middle)
        title = f"LinkerHand L6, index finger, on the CAN bus {dev.port}, read by the linkerbot SDK"
        # A hand answers finger by finger, so a reading may join two samples: compare the pressed finger alone.
        fingers = read.reshape(len(read), 5, -1)
        order = [patch.name for patch in dev.device().layout.patches].index(index.name)
        padded = np.zeros((len(read), 5, fingers.shape[-1]), np.float32)
        padded[:, order] = fingers[:, order]

        def counts_of(counts: np.ndarray) -> np.ndarray:
            selected = np.zeros(len(dev.device().layout), np.float32)
            selected[index.taxels] = np.ravel(counts)[index.taxels]
            return selected

        return compare(console, dev, padded.reshape(len(read), -1), counts_of, title, "counts", index.name)


def main() -> int:
    """Run both drivers; return exit code 0 if every frame that they read equals a sent one."""
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    # Linux delivers to a program on one multicast group the frames of every group that this machine has joined on the
    # same UDP port. python-can reads this variable: another port separates this run from, say, a second run.
    os.environ.setdefault("CAN_CONFIG", json.dumps({"port": 20_000 + os.getpid() % 20_000}))
    return 0 if all([anyskin(console), linker_hand(console)]) else 1


if __name__ == "__main__":
    sys.exit(main())
