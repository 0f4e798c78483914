"""What ``check`` finds: mistakes planted in the device of docs/adding-a-device.md, each named."""

import json
import re

import pytest

from firmware_protocols.check import check
from firmware_protocols.check.taxel_orders import ORDERS, matching_names, wire_order_of
from firmware_protocols.layouts import grid_layout
from tests.firmware.page import pieces

PALM = "acme_palm.py"
ANY_LENGTH = ('data="B"', 'data="*"')
RESERVED = "    0     00              reserved\n"
PERIOD = "            self.period_ns = request.value * 1_000_000\n"
FORCE = 'self.layout.push(reading["force"])'
BIND = "wire_order=self.layout.wire_order"
ORDER = "wire_order=[p + 4 * r + c for p in (0, 12) for c in range(4) for r in range(3)]"
STARTS = "        self.streaming = request.value > 0\n"
STARTED = "self.streaming, self.number = False, 0"
ANSWER = "PACKET.pack(command=READ, data=self._reading())"
WHOLE_CHUNKS = """    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        return super().receive(data, t_ns, port) if len(data) > 1 else ()

"""


def converted(counts):
    """Return the replacements that give the palm a converter of its own."""
    measure = f"self.counts = {counts}\n        return self.counts"
    return [("return super().measure(reading, t_ns)", measure), ("place, stack,", "place, quantize, stack,")]


PLANTS = {
    # mistake: replacements in the palm, what the report says
    "offset: a line lost": ([(RESERVED, "")], r"import: .*'touch' is at 1, but the fields before it end at 0"),
    "offset: a byte nobody knew of": (
        [(RESERVED, ""), ("    1     <u2 x taxels", "    0     <u2 x taxels")],
        r"it fits with one byte more before reading\.touch",
    ),
    "endianness: an array": ([("<u2 x taxels", ">u2 x taxels")], r"it fits with reading\.touch as <u2 x taxels"),
    "endianness: a number": ([("<u2 wrap", ">u2 wrap")], r"it fits with reading\.time as <u2 wrap"),
    "wrap: a clock": ([("<u2 wrap ", "<u2 ")], r"range: .*reading: time: 70000.* does not fit 0\.\.65535.*`wrap`"),
    "wrap: a counter": (
        [("u1 wrap ", "u1 "), ("self.number = (self.number + 1) & 0xFF", "self.number += 1")],
        r"range: .*reading: number: 256.* does not fit 0\.\.255",
    ),
    "order: column by column": ([(BIND, ORDER)], r"order: .*'row by row', pressing one .* finds 'column by column'"),
    "order: the pads exchanged": (
        [('(("left", -0.02), ("right", 0.02))', '(("right", 0.02), ("left", -0.02))')],
        r"it fits with taxels sent last patch first",
    ),
    "restart: state in the class": (
        [
            (STARTS, "        type(self).streaming = request.value > 0\n"),
            (STARTED, "self.number = 0"),
            ('    judge = "none"\n', '    judge = "none"\n    streaming = False\n'),
        ],
        r"restart: after 'stream' and a restart AcmePalm\.streaming is True, False when new",
    ),
    "restart: state in the module": (
        [
            (STARTS, '        STATE["streaming"] = request.value > 0\n'),
            ("if self.streaming", 'if STATE["streaming"]'),
            ("READ = 0x01", 'STATE = {"streaming": False}\nREAD = 0x01'),
        ],
        r"restart: after 'stream' and a restart .*STATE is .*True",
    ),
    "rate: forgotten": ([(PERIOD, "            pass\n")], r"it converts 100 times a second instead of 50"),
    "rate: survives a restart": (
        [(PERIOD, f"{PERIOD}            type(self).rate_hz = 1000 / request.value\n")],
        r"restart: .*the rate must not survive",
    ),
    "no data: an index": (
        [ANY_LENGTH, ("request.value", "request.data[0]")],
        r"'stream' with 0 bytes of data: acme_palm\.receive on c10200c3 raised IndexError.* acme_palm\.py:\d+: self",
    ),
    "no data: unpacked": (
        [
            ANY_LENGTH,
            (STARTS, "        (period,) = request.data\n        self.streaming = period > 0\n"),
            ("request.value", "request.data[0]"),
        ],
        r"'stream' with 0 bytes of data: .*raised ValueError: not enough values to unpack",
    ),
    "length: of the counts": (
        converted(f"quantize({FORCE}[:23], 1000.0, 0, 0xFFFF)"),
        r"returned 23 counts for the 24 points of 'force'",
    ),
    "length: of the table": ([(BIND, "wire_order=range(12)")], r"reading: touch: expected shape \(12,\), got \(24,\)"),
    # beyond the sixteen
    "wrap: by a cast": (
        converted(f"(1000 * {FORCE}).astype('i8').astype('u2')"),
        r"converter: .*column 'touch': counts of taxel 0 rise and fall while the push only rises: they wrap",
    ),
    "order: rows and columns exchanged": (
        [("grid_layout(3, 4,", "grid_layout(4, 3,")],
        r"patch 'left' is 4 x 3, the example's image 3 x 4",
    ),
    "order: declared without effect": (
        [(BIND, "taxels=24")],
        r"order: reversing layout\.wire_order changes no byte",
    ),
    "length: a byte that says so": ([("len(data)\n", "len(data) + 1\n")], r"packet\.size = len\(data\)$"),
    "push: the wrong way": (converted(f"quantize(-{FORCE}, 1000.0, 0, 0xFFFF)"), r"counts do not rise under a push"),
    "push: another rest": (
        converted(f"quantize({FORCE}, 1000.0, 0, 0xFFFF, rest=9)"),
        r"9 without contact, declared rest is 0",
    ),
    "span: declared too small": (
        [*converted(f"quantize({FORCE}, 1000.0, 0, 0xFFFF)"), ("high=0xFFFF", "high=1000")],
        r"counts 0 to 65535, declared are 0 to 1000",
    ),
    "frames: bare bytes": (
        [(f"[{ANSWER}] if", f"{ANSWER} if")],
        r"stream returned bytes: return \[frame\]",
    ),
    "frames: empty": (
        [(f"[{ANSWER}] if", 'b"" if'), ("else ()", 'else [b""]')],
        r"expected bytes that are not em",
    ),
    "state: no plain data": (
        [(STARTED, f"{STARTED}\n        self.act = lambda: 1")],
        r"self\.act is a builtins\.function",
    ),
    "state: on the class": (
        [('    judge = "none"\n', '    judge = "none"\n    heard = []\n')],
        r"AcmePalm\.heard is a list",
    ),
    "pieces: one packet a chunk": (
        [("    def reply(", f"{WHOLE_CHUNKS}    def reply(")],
        r"C10100C0 byte by byte is answered by silence",
    ),
    "answer: not as documented": (
        [("C1 02 00 C3", "C1 02 00 C4")],
        r"is answered by C10200C3, documented: C1 02 00 C4",
    ),
    "layout: two taxels at one place": ([("0.02))", "-0.02))")], r"taxels 0 and 12 lie at one place"),
    "datasheet: of no kind that lists have": ([('kind = "fingertip"', 'kind = "pad"')], r"kind 'pad': expected one of"),
    "datasheet: a guess of evidence": ([('evidence = ("assumed",)', 'evidence = ("guessed",)')], r"evidence 'guessed'"),
    "datasheet: no line to try": ([("Try it:", "Or:")], r"the docstring of acme_palm\.py lacks 'try it'"),
    "datasheet: no columns": (
        [("    columns = (", "    old_columns = (")],
        r"columns: declare the meaning of the counts",
    ),
    "datasheet: a name that is taken": ([('name = "acme_palm"', 'name = "anyskin"')], r"name 'anyskin' is taken by"),
    "options: no annotation": (
        [('serial: Annotated[str, Option("at most 252 characters of ASCII")] =', "serial=")],
        r"option 'serial': annotate it",
    ),
    "contract: the first version": (
        [("def measure(self, reading: Reading, t_ns: int)", "def digitize(self, reading)")],
        "WrongClassError",
    ),
    "file: no Python": ([("class AcmePalm(Device):", "class AcmePalm(Device)")], r"import: .*\(acme_palm\.py:\d+\)"),
}


def planted(folder, replacements=()):
    """The palm with some text replaced, and its example; as ``check`` names it."""
    files = pieces()
    for right, wrong in replacements:
        assert right in files[PALM], right
        files[PALM] = files[PALM].replace(right, wrong)
    (folder / "golden").mkdir()
    for name in (PALM, "golden/acme_palm.json"):
        (folder / name).write_text(files[name])
    return f"{folder / PALM}:AcmePalm"


@pytest.mark.parametrize("name", PLANTS)
def test_a_planted_mistake_is_named(tmp_path, name):
    replacements, said = PLANTS[name]
    report = check(planted(tmp_path, replacements), fuzz=20)
    assert not report.ok
    assert any(re.search(said, str(fault)) for fault in report.faults), report.lines()


GRIP = {
    "registers: another default": (
        [("self.registers = Registers(MAP)", 'self.registers = Registers(MAP)\n        self.registers["goal"] = 5')],
        r"registers: goal at 0: reads \[5\] after power-up, declared default 1000",
    ),
    "registers: a value that it takes and then dies of": (
        [('self.registers["goal"] * METRES', '1 / self.registers["goal"]')],
        r"raised ZeroDivisionError",
    ),
    "streams: a measurement of none": (
        [('Convert("touch"', 'Convert("toch"')],
        r"asked for stream 'toch'; it has \['touch'",
    ),
    "streams: counts of another sense": (
        [('{"force": self.touch}', '{"pressure": self.touch}')],
        r"counts of 'pressure'",
    ),
    "ports: one that it does not have": (
        [
            ("return [line + b", 'return [Sent(line, port="fingr"), line + b'),
            (" Sense,\n", " Sense, Sent,\n"),
        ],
        r"sent to port 'fingr'; it has \['finger', 'motor'\]",
    ),
    "ports: a frame of another line": (
        [
            ("return [line + b", "return [CanFrame(arbitration_id=1), line + b"),
            ("    Column,", "    CanFrame, Column,"),
        ],
        r"receive sent 001#: expected bytes",
    ),
    "joints: no number": (
        [("float(self.motors", "float('nan') * float(self.motors")],
        r"joints are .*nan.*finite numbers",
    ),
    "lines: a mistake on DTR": ([('port == "finger" and not dtr', "1 / dtr == 0")], r"lines raised ZeroDivisionError"),
}


@pytest.mark.parametrize("name", GRIP)
def test_a_mistake_in_the_grip_is_named(tmp_path, name):
    replacements, said = GRIP[name]
    text = pieces()["acme_grip.py"]
    for right, wrong in replacements:
        assert right in text, right
        text = text.replace(right, wrong)
    (tmp_path / "acme_grip.py").write_text(text)
    report = check(f"{tmp_path}/acme_grip.py:AcmeGrip", fuzz=20)
    assert any(re.search(said, str(fault)) for fault in report.faults), report.lines()


def test_eight_mistakes_two_ways_each():
    kinds = [name.partition(":")[0] for name in list(PLANTS)[:16]]
    assert {kind: kinds.count(kind) for kind in kinds} == dict.fromkeys(
        ("offset", "endianness", "wrap", "order", "restart", "rate", "no data", "length"), 2
    )


def test_without_an_example_every_fact_is_unpinned_and_none_a_fault(tmp_path):
    target = planted(tmp_path)
    (tmp_path / "golden" / "acme_palm.json").unlink()
    report = check(target, fuzz=20)
    assert report.ok and report.examples == 0
    assert {"reading.time as >u2 wrap", "taxels sent last patch first", "one byte more before reading.number"} <= set(
        report.unpinned
    )


def test_an_example_is_read_with_care(tmp_path):
    target = planted(tmp_path)
    path = tmp_path / "golden" / "acme_palm.json"
    whole = json.loads(path.read_text())
    whole["vectors"][0]["push"] = 1
    path.write_text(json.dumps(whole))
    (fault,) = check(target, fuzz=20).faults
    assert "'push'" in fault.text and "pushes" in fault.text


def test_the_same_report_again(tmp_path):
    target = planted(tmp_path)
    first, second = check(target, fuzz=100), check(target, fuzz=100)
    assert first == second and json.loads(json.dumps(first.as_dict()))["ok"]


@pytest.mark.parametrize(("name", "is_found"), [("endianness: a number", True), ("restart: state in the class", False)])
def test_a_quick_check_tries_the_examples_and_no_restarts(name, is_found, tmp_path):
    report = check(planted(tmp_path, PLANTS[name][0]), fuzz=20, quick=True)
    assert report.ok != is_found and report.examples and not report.unpinned, report.lines()


def test_the_ways_are_different_orders():
    layout = grid_layout(3, 4, 0.002)
    for name in set(ORDERS) - {"last patch first", "row by row"}:
        assert matching_names(layout, wire_order_of(layout, name)) == [name]
