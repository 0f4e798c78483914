#!/usr/bin/env python3
"""Draw the figures of docs/accuracy.md again, without measuring: all metrics, and one for the front page of the site.

usage: scripts/trade_pictures.py
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tactemu.tune.trade.picture import draw
from tactemu.tune.trade.report import read_table

PICTURES = ROOT / "docs" / "pictures"


def main() -> None:
    """Draw both."""
    found = {"summary": read_table((ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8"))}
    draw(found, PICTURES / "accuracy.svg")
    draw(found, PICTURES / "trade.svg", ["normal force"])


if __name__ == "__main__":
    main()
