"""The page on the truth log says what is so."""

import re
from pathlib import Path

import tactemu as tt
from firmware_protocols.cdr import members_of
from tactemu.base.formats import CONVERTIBLE, FORMATS, READABLE, RECORDABLE
from tactemu.truth.conversion import convert
from tactemu.truth.memory import DEFAULT_KEEP, parse_size
from tactemu.truth.messages import EVENT, FRAME, INJECTION, POSE
from tactemu.truth.writer import MAX_WAITING_BYTES

ROLES = (CONVERTIBLE, RECORDABLE, READABLE)
PAGE = (Path(__file__).parents[2] / "docs" / "truth-log.md").read_text()


def block(language: str, word: str) -> str:
    return next(b for b in re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL) if word in b)


def test_the_lines_are_those_that_are_written(tmp_path):
    (tmp_path / "page.jsonl").write_text(block("json", '"kind":"log"'))
    log = tt.read_log(tmp_path / "page.jsonl")
    assert log["tip"].measured.shape == (1, 1, 3) and log.lost == 2
    assert log.summary["tip"]["device"] == {"unknown_command": 1}
    convert(tmp_path / "page.jsonl", str(tmp_path / "again.jsonl"))
    *lines, end = block("json", '"kind":"log"').splitlines()
    assert (tmp_path / "again.jsonl").read_text().splitlines() == [*lines, end.replace('"lost":2', '"lost":0')]


def test_the_messages_have_the_fields_that_it_names():
    for message in (FRAME, INJECTION, EVENT, POSE):
        (line,) = re.findall(rf"`{message.name}`: (.*?)(?:\n- |\n\n)", PAGE, re.DOTALL)
        named = [words.split()[-1] for words in re.findall(r"`([^`]+)`", line)]
        assert [member.name for member in members_of(message.definition)] == named


def test_it_lists_the_formats():
    listed = [line for line in PAGE.splitlines() if line.startswith("| `.")]
    assert listed == [
        f"| `{each.suffix}` | {each.about} | {' | '.join('yes' if each in formats else '' for formats in ROLES)} |"
        for each in FORMATS.values()
    ]


def test_the_bounds_are_those_of_the_code():
    assert f"{parse_size(DEFAULT_KEEP) // 10**6} MB a process" in PAGE
    assert f"({MAX_WAITING_BYTES // 10**6} MB)" in PAGE
