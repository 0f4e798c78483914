"""The table of missed fields in docs/infer.md: rows are folded by device, message and mistake, and none is lost."""

import re
from pathlib import Path

import pytest

from benchmarks.infer_misses import MissedField, misses_table, mistake_of

PAGE = Path(__file__).parents[2] / "docs" / "infer.md"


def test_fields_of_one_mistake_are_one_row_with_a_range_and_a_count():
    fields = [
        MissedField("hand", "AA -> 9 bytes", f"<12 at {at}", "place", f"u8 at {at}, ?8 at {at + 1}") for at in (2, 3, 5)
    ]
    lines = misses_table([*fields, MissedField("hand", "AA -> 9 bytes", "u1 at 8", "sign", "i8 at 8")])
    assert lines[-2:] == [
        "| `hand` | AA -> 9 bytes | `<12` at 2 to 5, 3 fields | single bytes: `u8 at 2`, `?8 at 3`, … |",
        "| `hand` | AA -> 9 bytes | `u1` at 8 | the other sign: `i8 at 8` |",
    ]


def test_messages_that_differ_only_in_their_selector_are_one_row():
    fields = [
        MissedField("hand", f"5C9, 8 bytes, byte 0 = {value:02X}", f"{code} at 4", "place", "<f32 at 4")
        for value in range(5)
        for code in ("u1", "<u2")
    ]
    (row,) = [line for line in misses_table(fields) if line.startswith("| `")]
    assert row.startswith(
        "| `hand` | 5C9, 8 bytes, byte 0 = 00 to 04 (5 values) | `u1` at 4, 5 fields; `<u2` at 4, 5 fields |"
    )


@pytest.mark.parametrize(
    "truth, verdict, found, mistake",
    [
        ("<u2 at 4", "place", "selector8 at 4 certain, u8 at 5", "selector"),
        ("<u2 at 4", "place", "?8 at 3, <u16 at 5", "wider integers"),
        ("<u2 at 4", "place", "bits4 at 4", "flags"),
        (">12 at 4", "place", "<?12 >> 4 at 4", "12-bit numbers"),
        ("<f4 at 4", "place", "<?24 at 4 or wider, >f32 at 7", "wider integers"),
        ("<u2 at 4", "order", ">u16 at 4", "the other byte order"),
        ("u1 at 4", "place", "nothing", "nothing"),
    ],
)
def test_kinds_of_mistakes(truth, verdict, found, mistake):
    assert mistake_of(MissedField("hand", "9 bytes", truth, verdict, found)) == mistake


def test_page_counts_as_many_missed_fields_as_its_table_of_devices_and_is_short():
    before, _, after = PAGE.read_text(encoding="utf-8").partition("## Every miss")
    wrong = {row[1]: int(row[2]) for row in re.finditer(r"^\| (`\w+`) \|.*\| (\d+) \| \d+ \|$", before, re.MULTILINE)}
    rows = [line.split(" | ") for line in after.splitlines() if line.startswith("| `")]
    counted = dict.fromkeys(wrong, 0)
    for device, _, places, _ in rows:
        for place in places.split("; "):
            count = re.search(r", (\d+) fields", place)
            counted[device.strip("| ")] += int(count[1]) if count else 1
    assert counted == wrong and 0 < len(rows) <= 100
