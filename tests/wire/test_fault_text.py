"""The text of faults: what it means, and how wrong text is refused; the page on the wire has all of it."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tactemu.base.errors import SceneError
from tactemu.transports import TRANSPORTS
from tactemu.transports.memory import MemoryTransport
from tactemu.wire.faults import KINDS, parse
from tactemu.wire.faults.fault import ALL_LINES
from tactemu.wire.faults.frames import CORRUPTIONS
from tactemu.wire.line_models import LINE_MODELS
from tactemu.wire.wire import Wire
from tests.wire.fault_rig import CAN, MS, UDP, USB

PAGE = (Path(__file__).parents[2] / "docs" / "wire.md").read_text()


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("drop 1%", {"probability": 0.01, "direction": "to_driver", "stop_ns": None}),
        ("unplug at 3s for 0.5s", {"start_ns": 3_000_000_000, "stop_ns": 3_500_000_000, "once": False}),
        (
            "flip 5% id=0x201 from_driver from 2s to 6s bits 3",
            {
                "probability": 0.05,
                "arbitration_id": 0x201,
                "direction": "from_driver",
                "start_ns": 2_000_000_000,
                "stop_ns": 6_000_000_000,
                "amount": 3,
            },
        ),
        ("late every 10 by 30ms both prefix=55aa", {"every": 10, "by_ns": 30 * MS, "prefix": b"\x55\xaa"}),
        ("latency 16ms", {"by_ns": 16 * MS}),
        ("latency", {"by_ns": 16 * MS}),
        ("drop at 200us", {"start_ns": 200_000, "once": True}),
        ("load 30%", {"probability": 0.3}),
        ("babble id=7 from 1s to 2s", {"arbitration_id": 7}),
    ],
)
def test_words(text, values):
    fault = parse(text)
    assert {name: getattr(fault, name) for name in values} == values
    assert str(fault) == text


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "expected one of: drop, flip"),
        ("dorp 1%", "unknown kind 'dorp', did you mean 'drop'.*busoff"),
        ("drop 101%", "0% to 100%"),
        ("drop 1.2.3%", "0% to 100%"),
        ("drop 1", "unknown word.*prefix=.*to_driver"),
        ("drop to_drivr", "did you mean 'to_driver'"),
        ("drop at", "a value must follow"),
        ("drop at 3", "a time such as 3s"),
        ("drop at 3s from 2s", "not both"),
        ("drop from 3s to 2s", "ends before it begins"),
        ("drop 1% 2%", "given twice"),
        ("drop every 0", "whole number from 1"),
        ("flip id=0x20000000", "whole number from 0"),
        ("flip prefix=5", "bytes in hex"),
        ("close code 7", "whole number from 1000"),
        ("halfopen 3%", "fault of the link"),
        ("drop bits 3", "no such option; these have: flip"),
        ("duplicate frames 3", "no such option; these have: reorder"),
        ("unplug 5%", "fault of the link"),
        ("unplug to_driver", "fault of the link"),
        ("latency every 3", "fault of the link"),
        ("drop frame 0", "whole number from 1"),
        ("drop frame 5-3", "whole number from 5"),
        ("drop frame 3 every 2", "not two of them"),
        ("flip bit 3", "of which byte"),
        ("flip byte 3 bit 8", "from 0 to 7"),
        ("drop byte 3", "these have: flip, lose"),
        ("truncate to 3 bytes 2", "not both"),
        ("truncate to 3x", "a time such as 3s"),
        ("garbage hex=a", "bytes in hex"),
        ("replace", "by what"),
        ("unplug as ../tty", "same folder"),
        ("unplug frame 3", "fault of the link"),
    ],
)
def test_wrong_words_name_the_right_ones(text, complaint):
    with pytest.raises(SceneError, match=complaint):
        parse(text)


@pytest.mark.parametrize(
    ("text", "spec"),
    [("busoff at 1s", USB), ("garbage 1%", CAN), ("latency", CAN), ("split", UDP), ("close", USB), ("halfopen", UDP)],
)
def test_a_wire_refuses_what_it_cannot_have(text, spec):
    with pytest.raises(SceneError, match="expected one of"):
        Wire(MemoryTransport(), spec, faults=[text])


VALUES = "1% 5 % every at from to for by bits bytes id=0x1 id= prefix=5a to_driver both 3s 1e9s -1s 0s 16ms 0x".split()
WORDS = st.sampled_from([*KINDS, *VALUES, "", "\u00bd", "\N{ARABIC-INDIC DIGIT THREE}s"])


@example("drop 1% 2%")
@example("drop bits 2 bits 3")
@example("flip from 2s from 3s")
@example("drop for 0s")
@example("flip id=0x1z")
@example("flip prefix=xy")
@example("latency 1ms by 2ms")
@given(st.lists(WORDS | st.text(max_size=8), max_size=8).map(" ".join))
def test_any_words_give_a_fault_or_an_error_that_names_the_word(text):
    try:
        fault = parse(text)
    except SceneError as error:
        if not text.split():
            assert "expected one of: drop" in str(error)
            return
        why = str(error).removeprefix(f"fault {text!r}: ")
        why = re.sub(r"^fault .* \.\.\. \(\d+ characters\): ", "", why)  # a long text is shown in short
        assert any(why.removeprefix("unknown kind ").startswith(repr(word)) for word in text.split()), why
    else:
        assert parse(str(fault)) == fault
        assert fault.stop_ns is None or fault.start_ns < fault.stop_ns


# -- the page --------------------------------------------------------------------------------------------------------


def test_every_port_and_every_fault_is_in_the_tables():
    first_cells = re.findall(r"^\| `([a-z0-9]+)[:`]", PAGE, re.MULTILINE)
    assert set(first_cells) == set(KINDS) | set(TRANSPORTS)


def test_the_examples_parse():
    block = next(block for block in PAGE.split("```") if "checksum every 10" in block)
    texts = [re.split(r"\s{2,}", line)[0] for line in block.strip().splitlines()]
    assert [parse(text).kind for text in texts] == [
        "drop", "flip", "checksum", "late", "drop", "unplug", "load", "flip", "truncate", "garbage", "drop", "replace",
    ]  # fmt: skip


def test_faults_name_lines_that_exist():
    classes = [getattr(import_module(path.partition(":")[0]), path.partition(":")[2]) for path in LINE_MODELS.values()]
    assert {model.kind for model in classes} == set(ALL_LINES)
    assert all(set(kind.wires) <= set(ALL_LINES) for kind in KINDS.values())


@pytest.mark.parametrize(
    "kind", sorted(set(CORRUPTIONS) & {kind for kind, about in KINDS.items() if about.keeps_frame})
)
def test_the_frame_arrives_undamaged_where_the_judge_expects_it(kind):
    """Otherwise the judge would count its reading as one that the driver has lost."""
    frame = bytes(range(64, 80))
    parts = CORRUPTIONS[kind](frame, parse(kind), np.random.default_rng(1))
    assert frame in b"".join(bytes(part) for part, _ in parts or ())


@pytest.mark.parametrize("kind", ["lose", "truncate", "checksum"])
def test_a_damaged_frame_is_not_expected(kind):
    assert not KINDS[kind].keeps_frame
