"""The page on live control: its table is written from the verbs.

``python tests/control/test_page.py --write`` writes it.
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tactemu.control.control_commands import CONTROL_COMMANDS

PAGE = Path(__file__).parents[2] / "docs" / "live-control.md"
TABLE = re.compile(r"(<!-- verbs: [^\n]* -->\n).*?(<!-- end of verbs -->)", re.DOTALL)


def table() -> str:
    lines = ["| verb | arguments | effect |", "| --- | --- | --- |"]
    for verb in CONTROL_COMMANDS.values():
        words = ["the keys of an entry `[[scenario]]` of a scene file"] if verb.name == "happen" else []
        for each in verb.arguments.values():
            text = f"`{each.name}`: {each.type.json}"
            words.append(text if each.needed else f"[{text}]")
        lines.append(f"| `{verb.name}` | {', '.join(words)} | {verb.about} |")
    return "\n" + "\n".join(lines) + "\n\n"


def test_the_table_is_that_of_the_verbs():
    assert TABLE.search(PAGE.read_text())
    assert TABLE.sub(lambda m: m[1] + table() + m[2], PAGE.read_text()) == PAGE.read_text(), "write it: see above"


if __name__ == "__main__" and "--write" in sys.argv:
    PAGE.write_text(TABLE.sub(lambda m: m[1] + table() + m[2], PAGE.read_text()))
