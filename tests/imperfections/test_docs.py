"""docs/imperfections.md names every option and nothing that is none."""

import dataclasses
import re
from pathlib import Path

from tactemu.imperfections import ChainOptions

PAGE = (Path(__file__).parents[2] / "docs" / "imperfections.md").read_text(encoding="utf-8")
OPTIONS = {field.name for field in dataclasses.fields(ChainOptions)}


def test_every_option_is_documented():
    assert not {name for name in OPTIONS if f"`{name}`" not in PAGE and f"{name}=" not in PAGE}


def test_no_row_of_a_table_names_an_unknown_option():
    named = set()
    for row in re.findall(r"^\| (`.*?) \|", PAGE, flags=re.M):
        named |= set(re.findall(r"`([a-z_]+)`", row))
    assert len(named) > 30 and named <= OPTIONS
