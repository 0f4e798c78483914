"""The fenced blocks of the pages, with the marks before them, and the commands of a block."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += sorted((ROOT / "examples").rglob("*.md"))

_MARK = r"<!-- (not run|nightly)(?: lines with ([^:]*))?: (.*?) -->\n"
_BLOCK = re.compile(
    rf"(?P<marks>(?:^{_MARK})*)^```(?P<language>\w*) ?(?P<name>\S*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Mark:
    """A comment before a block: its commands with one of the ``words``, or all, are not run, or at night only."""

    kind: str
    words: tuple[str, ...]
    reason: str

    def holds_for(self, command: str) -> bool:
        """Return True if the comment speaks of this command."""
        return not self.words or any(word in command for word in self.words)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    place: str
    language: str
    name: str
    text: str
    marks: tuple[Mark, ...]

    def marked(self, command: str = "") -> str:
        """Return "not run" or "nightly" if a mark holds for a command of the block, or the empty string."""
        return next((mark.kind for mark in self.marks if mark.holds_for(command)), "")


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            place=f"{page.name}:{text.count(chr(10), 0, found.start('language')) + 1}",
            language=found["language"],
            name=found["name"],
            text=found["text"],
            marks=tuple(
                Mark(kind, tuple(re.findall(r"`([^`]+)`", words)), " ".join(reason.split()))
                for kind, words, reason in re.findall(_MARK, found["marks"], re.DOTALL)
            ),
        )
        for found in _BLOCK.finditer(text)
    ]


def commands_of(text: str) -> Iterator[str]:
    """Yield the commands of a block for a shell: lines without their comment, continued lines as one."""
    for line in re.sub(r"\\\n *", "", text).splitlines():
        if command := re.sub(r"(^|\s)#.*", "", line).strip():
            yield command
