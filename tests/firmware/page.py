"""The files that docs/adding-a-device.md writes."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "adding-a-device.md"


def pieces() -> dict[str, str]:
    """Fenced blocks by the name after their language, joined in order."""
    files: dict[str, str] = {}
    for name, text in re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE.read_text(), flags=re.M | re.S):
        files[name] = files.get(name, "") + text
    return files


def write(folder: Path) -> Path:
    """All of them into a folder."""
    for name, text in pieces().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder
