#!/usr/bin/env python3
"""Write a list of contents at the start of each long page in docs.

usage: scripts/contents.py [--check]      --check writes nothing; it fails where a list is missing or stale
"""

import re
import sys
import textwrap
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
MAX_LINES, MIN_HEADINGS = 120, 3
"""A page with more lines, and at least this number of headings, has a list."""
_MARK = "<!-- contents -->"
_LIST = re.compile(rf"{_MARK}\n.*?\n\n", re.DOTALL)
_FENCED = re.compile(r"^````?.*?^````?$", re.DOTALL | re.MULTILINE)


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as repositories' pages and the site make it."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def headings(text: str) -> list[str]:
    """Return the headings of the second level."""
    return re.findall(r"^## (.+)$", _FENCED.sub("", text), re.MULTILINE)


def with_contents(text: str) -> str:
    """Return a page with its list of contents; as it is if it is short, or its first lines link to all headings."""
    bare = _LIST.sub("", text)
    found = headings(bare)
    links = [f"[{heading}](#{anchor(heading)})" for heading in found]
    if len(bare.splitlines()) <= MAX_LINES or len(found) < MIN_HEADINGS:
        return bare
    if all(f"(#{anchor(heading)})" in bare.split("\n## ")[0] for heading in found):
        return bare
    blocks = bare.split("\n\n")
    first = next(k for k, block in enumerate(blocks) if not block.startswith(("#", "<!--")))
    words = [link.replace(" ", "\0") for link in links]
    lines = textwrap.fill(
        "On this page: " + ", ".join(words) + ".", 120, break_long_words=False, break_on_hyphens=False
    )
    place = first + (not blocks[first].endswith(":"))  # what follows a colon stays with it
    blocks.insert(place, f"{_MARK}\n{lines}".replace("\0", " "))
    return "\n\n".join(blocks)


def main() -> int:
    """Write the lists, or compare them, and return the exit status."""
    stale = [page for page in sorted(DOCS.glob("*.md")) if page.read_text() != with_contents(page.read_text())]
    if "--check" not in sys.argv:
        for page in stale:
            page.write_text(with_contents(page.read_text()))
        return 0
    if stale:
        print(
            f"{', '.join(page.name for page in stale)}: contents are not as the headings say; run scripts/contents.py"
        )
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
