"""The files that docs/adding-a-device.md writes."""

from pathlib import Path

from tests.pages import ROOT, files_of

__all__ = ["ROOT", "pieces", "write"]

PAGE = ROOT / "docs" / "adding-a-device.md"


def pieces() -> dict[str, str]:
    """The files by name."""
    return files_of(PAGE)


def write(folder: Path) -> Path:
    """All of them into a folder."""
    for name, text in pieces().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder
