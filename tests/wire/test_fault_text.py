"""The text of faults: what it means, and how wrong text is refused; the page on the wire has all of it."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tactemu.base.errors import SceneError
from tactemu.transports import TRANSPORTS
from tactemu.transports.memory import MemoryTransport
from tactemu.wire.faults import FAULTS, frames, parse, possible_faults
from tactemu.wire.faults.fault import FrameFault, Memory
from tactemu.wire.line_models import LINE_MODELS, kinds_with, modelled_for
from tactemu.wire.wire import Wire
from tests.wire.fault_rig import CAN, MS, UDP, USB, stream

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
                "bits": 3,
            },
        ),
        ("late every 10 by 30ms both prefix=55aa", {"every": 10, "by_ns": 30 * MS, "prefix": b"\x55\xaa"}),
        ("latency 16ms", {"by_ns": 16 * MS}),
        ("latency", {"by_ns": 16 * MS}),
        ("drop at 200us", {"start_ns": 200_000, "once": True}),
        ("load 30%", {"share": 0.3}),
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
        ("", "`tactemu faults` lists them"),
        ("dorp 1%", "unknown kind 'dorp'; did you mean 'drop'.$"),
        ("drop 101%", "0% to 100%"),
        ("drop 1.2.3%", "0% to 100%"),
        ("drop 1", r"needs its unit; did you mean '1%'"),
        ("drop x", "unknown word.*prefix=.*to_driver"),
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
        ("latency 0ms", "its timer needs a time"),
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
    with pytest.raises(SceneError, match="wire cannot have it"):
        Wire(MemoryTransport(), spec, faults=[text])


VALUES = "1% 5 % every at from to for by bits bytes id=0x1 id= prefix=5a to_driver both 3s 1e9s -1s 0s 16ms 0x".split()
WORDS = st.sampled_from([*FAULTS, *VALUES, "", "\u00bd", "\N{ARABIC-INDIC DIGIT THREE}s"])


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
            assert "tactemu faults" in str(error)
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
    assert set(first_cells) == set(FAULTS) | set(TRANSPORTS)


def test_every_line_and_its_ports_are_in_the_table():
    rows = re.findall(r"^\| `([A-Z]\w+)` \| [^|]+ \| (`.*`) \|$", PAGE, re.MULTILINE)
    told = {name: re.findall(r"`(\w+):`", ports) for name, ports in rows}
    assert told == {connector.__name__: [*model.schemes] for connector, model in LINE_MODELS.items()}


def test_the_examples_parse():
    block = next(block for block in PAGE.split("```") if "checksum every 10" in block)
    texts = [re.split(r"\s{2,}", line)[0] for line in block.splitlines()[1:]]
    assert [parse(text).word for text in texts] == [
        "drop", "flip", "checksum", "late", "drop", "unplug", "load", "flip", "truncate", "garbage", "drop", "replace",
    ]  # fmt: skip


def test_the_table_of_faults_has_the_options_and_the_lines_of_each():
    rows = {cells[1].strip(" `"): cells[3] for line in PAGE.splitlines() if len(cells := line.split("|")) == 5}
    names = {"serial": "serial", "tcp": "TCP", "can": "CAN", "websocket": "WebSocket"}
    for word, fault in FAULTS.items():
        options = [option.partition(" ")[0].removesuffix("aa07") for option in fault.own_options()]
        assert [each for each in options if f"`{each}" not in rows[word]] == [], word
        on = [] if fault.every_line else kinds_with(word)
        assert [kind for kind, name in names.items() if name in rows[word]] == [kind for kind in names if kind in on], (
            word
        )


def test_the_fault_of_the_page_works_as_it_stands(monkeypatch):
    """A new fault is its class and its line in the registry."""
    code = next(block for block in PAGE.split("```python\n") if block.startswith("@dataclass")).split("```")[0]
    names = dict(vars(frames))
    exec("from __future__ import annotations\n" + code, names)
    monkeypatch.setitem(FAULTS, "invert", names["Invert"])
    sent, seen, injected = stream(USB, ["invert every 4 bytes 2"], count=8)
    assert injected == {"invert": 2} and seen[3][1] == sent[3][:-2] + bytes(0xFF - each for each in sent[3][-2:])
    with pytest.raises(SceneError, match="from 1 to 65536"):
        parse("invert bytes 0")
    with pytest.raises(SceneError, match=r"these have: .*invert"):
        parse("drop bytes 3")


# -- every fault of the registry ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("word", FAULTS)
def test_a_fault_is_one_class_that_a_line_can_have(word):
    fault = FAULTS[word]
    assert fault.word == word and fault.about and word.isalpha()
    assert {each.name for each in fields(fault)} >= set(fault.options()), "a class with options is a dataclass"
    assert any(word in possible_faults(model) for model in LINE_MODELS.values())
    assert fault.every_line == (not kinds_with(word)), "either every line, or those that name it"


@pytest.mark.parametrize("model", list(LINE_MODELS.values()), ids=lambda model: model.__name__)
def test_a_line_names_faults_that_exist_and_that_it_can_have(model):
    assert set(model.faults) <= set(FAULTS) and set(model.likely_faults) <= set(possible_faults(model))


@pytest.mark.parametrize("model", list(LINE_MODELS.values()), ids=lambda model: model.__name__)
def test_what_a_real_line_cannot_have_its_model_can_and_the_page_says_so(model):
    assert set(model.only_modelled) <= set(possible_faults(model))
    assert not set(model.only_modelled) & set(possible_faults(model, is_real=True))
    row = next((line for line in PAGE.splitlines() if line.startswith(f"| a real {NAMES.get(model.kind)} |")), "||||")
    refused = [word for word in FAULTS if f"`{word}`" in row.split("|")[2]]
    assert refused == [word for word in FAULTS if word in model.only_modelled]
    assert all(model.kind in modelled_for(word) for word in refused)


NAMES = {"serial": "UART", "can": "CAN bus"}
VALUES_OF = {
    "start_ns": 3_000_000, "until_ns": 5_000_000_000, "lasts_ns": 200_000, "by_ns": 1_500_000, "probability": 0.05,
    "share": 0.3, "every": 4, "frames": ((2, 2), (5, 9)), "arbitration_id": 0x201, "prefix": b"\x55", "bits": 3,
    "byte": -2, "bit": 6, "cut": 2, "more": 2, "width": 2, "size": 7, "length": 5, "after": 4, "passed": 3,
    "code": 1006, "data": b"\xaa\x07", "name": "ttyUSB1", "direction": "both",
}  # fmt: skip
"""A value of every option, by the name of its field."""


@given(st.data())
def test_a_fault_made_in_python_is_the_one_that_its_text_describes(data):
    fault = data.draw(st.sampled_from(list(FAULTS.values())))
    given = {"data": b"\x01\x83"} if fault.word == "replace" else {}
    names = data.draw(st.lists(st.sampled_from(sorted(fault.options()))))
    try:
        made = fault(**given | {name: VALUES_OF[name] for name in names})
    except SceneError as error:
        assert re.search(r"not (both|two of them)|of which byte", str(error))
    else:
        assert parse(made.text) == made, made.text


@pytest.mark.parametrize(
    ("fault", "values", "complaint"),
    [
        ("flip", {"byte": 2, "bit": 8}, "'bit': expected a whole number from 0 to 7"),
        ("drop", {"probability": 1.5}, "expected 0% to 100%"),
        ("late", {"by_ns": -1}, "expected a time"),
        ("drop", {"frames": ((5, 3),)}, "whole number from 5"),
        ("drop", {"direction": "up"}, "expected to_driver, from_driver, both"),
        ("drop", {"start_ns": 3, "until_ns": 2}, "ends before it begins"),
        ("unplug", {"name": "../tty"}, "same folder"),
    ],
)
def test_a_fault_made_in_python_has_the_bounds_of_its_text(fault, values, complaint):
    with pytest.raises(SceneError, match=complaint):
        FAULTS[fault](**values)


def test_an_event_gives_a_fault_its_time_and_leaves_its_words():
    fault = parse("drop both for 1s 5%").scheduled(7)
    assert (fault.start_ns, fault.stop_ns, fault.text) == (7, 1_000_000_007, "drop both at 7ns for 1s 5%")
    fault = parse("unplug as for").scheduled(7, 9)
    assert (fault.start_ns, fault.stop_ns, fault.text) == (7, 9, "unplug as for from 7ns to 9ns")
    for text in ("drop from 0s", "drop to 3s", "drop at 3s"):
        with pytest.raises(ValueError, match="`at` and `until`"):
            parse(text).scheduled(1)


KEEPING = [fault for fault in FAULTS.values() if issubclass(fault, FrameFault) and fault.keeps_frame]


@pytest.mark.parametrize("kind", KEEPING, ids=lambda kind: kind.word)
def test_the_frame_arrives_undamaged_where_the_judge_expects_it(kind):
    """Otherwise the judge would count its reading as one that the driver has lost."""
    fault, memory = kind(), Memory(np.random.default_rng(1))
    sent, key = [bytes(range(64 + k, 80 + k)) for k in range(3)], ("pad", "to_driver")
    parts = [bytes(part) for frame in sent for part, _ in fault.apply(frame, key, frame is sent[1], memory)[0]]
    assert sent[1] in b"".join(parts)


@pytest.mark.parametrize("word", ["lose", "truncate", "checksum"])
def test_a_damaged_frame_is_not_expected(word):
    assert not FAULTS[word].keeps_frame
