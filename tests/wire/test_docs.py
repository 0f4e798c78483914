"""The page on the wire names every port and every fault that there is, and its examples parse."""

import re
from pathlib import Path

from tactemu.transports import TRANSPORTS
from tactemu.wire.faults import KINDS, parse

PAGE = (Path(__file__).parents[2] / "docs" / "wire.md").read_text()


def test_every_port_and_every_fault_is_in_the_tables():
    first_cells = re.findall(r"^\| `([a-z0-9]+)[:`]", PAGE, re.MULTILINE)
    assert set(first_cells) == set(KINDS) | set(TRANSPORTS)


def test_the_examples_parse():
    block = next(block for block in PAGE.split("```") if "checksum every 10" in block)
    texts = [re.split(r"\s{2,}", line)[0] for line in block.strip().splitlines()]
    assert [parse(text).kind for text in texts] == [
        "drop", "flip", "checksum", "late", "drop", "unplug", "load", "flip", "truncate", "garbage", "drop", "replace",
    ]  # fmt: skip
