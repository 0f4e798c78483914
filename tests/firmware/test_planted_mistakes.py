"""Thirty mistakes, planted in two right devices with worked examples: each is named, or stands in a list."""

import re
from pathlib import Path

import pytest

from firmware_protocols.check import check

FOLDER = Path(__file__).parent / "planted"
MEASURE = "    def stream(self, t_ns: int, name: str):\n"


def measured(*lines: str) -> tuple[str, str]:
    """A `measure` of these lines before `stream`."""
    body = "".join(f"        {line}\n" for line in lines)
    return MEASURE, f"    def measure(self, reading, t_ns):\n{body}\n{MEASURE}"


def received(*lines: str) -> tuple[str, str]:
    """A `receive` of these lines before `stream`, which goes on as the kit does."""
    body = "".join(f"        {line}\n" for line in (*lines, "return super().receive(data, t_ns, port)"))
    return MEASURE, f"    def receive(self, data, t_ns, port):\n{body}\n{MEASURE}"


def scaled(scale: float) -> tuple[str, str]:
    """A `measure` of the panel with a scale of its own."""
    counts = f"self.counts = quantize(self.layout.push(reading['force']), {scale}, 0, 255)"
    return measured(counts, "return self.counts")


COUNTS = "self.counts = counts = super().measure(reading, t_ns)"
IS_GARBAGE = "data[:1] not in (b'', b'\\x81') and not self.packets._buffer and not self.packets._stage"
DONE = '        return [b"\\x05\\x00"]\n'
STARTED = '        return [b"\\x05\\x03"]\n'

MISTAKES = {
    # mistake: file, replacements, what the first fault says
    "sum of an answer from another byte": (
        "panel",
        [("bytes           data\n    last  sum8 from 2 ", "bytes           data\n    last  sum8 from 4 ")],
        r"commands: 'rate': .* is answered by .*, documented: ",
    ),
    "sum of a frame from another byte": (
        "panel",
        [("contacts\n    last  sum8 from 2 ", "contacts\n    last  sum8 from 5 ")],
        r"examples: .*byte 87: .*fits with frame\.sum from byte [0-4]",
    ),
    "byte order of a size": (
        "panel",
        [("<u2             size = len(data)", ">u2             size = len(data)")],
        r"answer\.size = len\(data\)|answer\.size as <u2|documented: 05 7E 00 02 00",
    ),
    "byte order of a gyro": (
        "mat",
        [(">i2 x 3         gyro", "<i2 x 3         gyro")],
        r"examples: .*fits with frame\.gyro as >i2 x 3",
    ),
    "two taxels exchanged in measure": (
        "mat",
        [measured(COUNTS, "counts['force'][[5, 6]] = counts['force'][[6, 5]]", "return counts")],
        r"order: .*taxel 6 at place 5, not 5, taxel 5 at place 6, not 6",
    ),
    "two taxels exchanged in wire_order": (
        "mat",
        [("self.layout.wire_order)", "[0, 1, 2, 3, 4, 6, 5, *range(7, 16)])")],
        r"order: .*taxel 6 at place 5, not 5",
    ),
    "count of contacts off by one": (
        "panel",
        [("count(contacts)\n", "count(contacts) + 1\n")],
        r"examples: .*fits with frame\.n = count\(contacts\)",
    ),
    "declared rate": (
        "panel",
        [("rate_hz = 50.0", "rate_hz = 100.0")],
        r"converts 100 times a second instead of 50: .*correct rate_hz",
    ),
    "rate set by a command": (
        "panel",
        [("        self.period_ns = round(1e9 / self.registers", "        _ = (1e9 / self.registers")],
        r"it converts 50 times a second instead of 20: set self\.period_ns",
    ),
    "missing answer": (
        "panel",
        [(STARTED, "        return ()\n")],
        r"'start': .*answered by silence, documented: 05 03",
    ),
    "wrong scale": ("panel", [scaled(45.0)], r"scale: .*changes 'push' by 45 counts, counts_per_unit 50 makes 50"),
    "mN for N in measure": (
        "panel",
        [scaled(0.05)],
        r"scale: .*changes 'push' by 0 counts, counts_per_unit 50 makes 50",
    ),
    "mN for N in measure and column": (
        "mat",
        [("counts_per_unit=100.0", "counts_per_unit=0.1")],
        r"fits with the scale of touch times 1000 \(N for mN\?\)",
    ),
    "flash register that is never saved": (
        "panel",
        [("        self.flash.update(self.registers.kept())\n", "")],
        r"registers: rate at 0: is declared flash, but reads 50 after a power cycle, 20 was written by '20 frames",
    ),
    "frame in no table": (
        "mat",
        [("return [STUFFING", 'return [b"HELLO", STUFFING')],
        r"examples: .*frame 0, byte 0: 48454C4C… instead of 5B0A",
    ),
    "positions mirrored": (
        "panel",
        [
            (
                'grid_layout(4, 5, 0.004, name="pad")',
                'grid_layout(4, 5, 0.004, name="pad")\n'
                "        self.layout = replace(self.layout, positions=self.layout.positions * (-1, 1, 1))",
            )
        ],
        r"layout: patch 'pad' is mirrored",
    ),
    "length field one too large": (
        "panel",
        [("size = len(data)\n", "size = len(data) + 1\n")],
        r"documented: 05 7E 00 02 00|fits with answer\.size = len\(data\)",
    ),
    "list on the class": (
        "panel",
        [
            ('    origin = "written', '    loads = []\n    origin = "written'),
            (DONE, "        self.loads.append(1)\n" + DONE),
        ],
        r"Panel\.loads is a list on the class",
    ),
    "dict of the module": (
        "panel",
        [
            ("THRESHOLD_COUNTS = 25\n", "THRESHOLD_COUNTS = 25\nLOADS = {}\n"),
            (DONE, "        LOADS[self.register] = request.packet\n" + DONE),
        ],
        r"restart: after '20 frames a second' and a restart .*LOADS is",
    ),
    "answer two seconds late": (
        "panel",
        [
            ("return [ANSWER.pack(", "return [Sent(ANSWER.pack("),
            ("data=data)]", "data=data), delay_ns=2_000_000_000)]"),
        ],
        r"timing: 'rate': is answered after 2001 ms, line included; its driver gives up after 100 ms",
    ),
    "garbage is never skipped": (
        "panel",
        [
            received(f"self.stuck |= {IS_GARBAGE}", "if self.stuck:", "    return ()"),
            ("        self.register = 0\n", "        self.register, self.stuck = 0, False\n"),
        ],
        r"garbage: 'rate': one byte of garbage before it, and no request is answered any more",
    ),
    "garbage raises": (
        "panel",
        [received(f"if {IS_GARBAGE}:", "    raise ValueError(data[0])")],
        r"raised ValueError: \d+ at panel\.py",
    ),
    "random numbers": (
        "mat",
        [measured(COUNTS, "counts['force'] ^= np.random.randint(0, 2, counts['force'].shape)", "return counts")],
        r"the same inputs give other bytes the second time",
    ),
    "the host's clock": (
        "mat",
        [("touch=touch,", "touch=(touch + time.perf_counter_ns()) % 256,")],
        r"the same inputs give other bytes the second time",
    ),
    "a seeded generator in self": (
        "mat",
        [("        self.frame = ", "        self.rng = np.random.default_rng(1)\n        self.frame = ")],
        r"self\.rng is a numpy\.random",
    ),
    "a sense left out of what measure returns": (
        "mat",
        [measured(COUNTS, "return {key: counts[key] for key in ('force', 'acceleration')}")],
        r"scale: mat\.measure leaves out 'angular_velocity', which have columns",
    ),
    "axes of the accelerometer exchanged": (
        "mat",
        [measured(COUNTS, "counts['acceleration'] = counts['acceleration'][:, [1, 0, 2]]", "return counts")],
        r"scale: .*along x on point 0 of 'acceleration' changes 'ay' and not 'ax': exchanged\?",
    ),
    "degrees for radians": (
        "mat",
        [
            measured(
                COUNTS,
                "degrees = np.degrees(reading['angular_velocity'])",
                "counts['angular_velocity'] = quantize(degrees, 7505.747, -0x8000, 0x7FFF)",
                "return counts",
            )
        ],
        r"scale: .*'gx' by .* counts, counts_per_unit 7505\.75 makes",
    ),
    "escape forgotten": (
        "mat",
        [("STUFFING.wrap(", "b'['+("), ("gyro=gyro[0]))]", "gyro=gyro[0]))+b']']")],
        r"examples: .*byte 5: 5B5D5C82… instead of 5C285C29",
    ),
}
LISTED = {
    "rest of the chunk dropped after garbage": (
        "panel",
        [received(f"if {IS_GARBAGE}:", "    return ()")],
        r"of 2 requests with one byte of garbage in the chunk are answered: before it 0, amid it 0, behind it 2",
    ),
}
IMPORTS = """import time
from dataclasses import replace

import numpy as np

from firmware_protocols import Sent, quantize
from fir"""


def planted(folder: Path, name: str, replacements) -> str:
    """A device with some text replaced, and its examples; as ``check`` names it."""
    text = (FOLDER / f"{name}.py").read_text().replace("from fir", IMPORTS, 1)
    for right, wrong in replacements:
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    (folder / "golden").mkdir()
    (folder / f"{name}.py").write_text(text)
    (folder / "golden" / f"{name}.json").write_text((FOLDER / "golden" / f"{name}.json").read_text())
    return f"{folder / name}.py:{name.title()}"


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(tmp_path, mistake):
    name, replacements, said = MISTAKES[mistake]
    report = check(planted(tmp_path, name, replacements), fuzz=20)
    assert report.faults, "no fault"
    assert any(re.search(said, str(fault)) for fault in report.faults), "\n".join(report.lines())


@pytest.mark.parametrize("mistake", LISTED)
def test_a_miss_is_listed_under_what_no_example_pins(tmp_path, mistake):
    name, replacements, said = LISTED[mistake]
    report = check(planted(tmp_path, name, replacements), fuzz=20)
    assert report.ok and any(re.search(said, note) for note in report.notes), "\n".join(report.lines())


def test_thirty_mistakes_of_which_most_are_named():
    assert len(MISTAKES) + len(LISTED) == 30 and len(MISTAKES) >= 27


@pytest.mark.parametrize("name", ["panel", "mat"])
def test_the_devices_are_right_and_their_examples_pin_all(tmp_path, name):
    report = check(planted(tmp_path, name, []), fuzz=20)
    assert report.ok and report.unpinned == (), "\n".join(report.lines())
