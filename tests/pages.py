"""The files that the pages on additions print, as a user has them and as files of this tree; and runs of them."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FACE = "tactemu.models"


def files_of(page: Path) -> dict[str, str]:
    """Fenced blocks of a page by the name after their language; blocks of one name are joined in order."""
    files: dict[str, str] = {}
    for name, text in re.findall(r"^```\w+ (\S+)\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.M | re.S):
        files[name] = files.get(name, "") + text
    return files


def imports(text: str) -> list[tuple[ast.ImportFrom, str]]:
    """Each ``from module import ...`` of the code, with its source."""
    found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) and node.module]
    return [(node, ast.get_source_segment(text, node) or "") for node in found]


def as_in_the_tree(text: str) -> str:
    """The same file for the packages themselves: each name of the face is imported from its own module."""
    own = {
        alias.name: node.module
        for node, _ in imports((ROOT / f"{FACE.replace('.', '/')}.py").read_text())
        for alias in node.names
    }
    for node, source in imports(text):
        if node.module == FACE:
            text = text.replace(source, "; ".join(f"from {own[a.name]} import {a.name}" for a in node.names))
    return text


def copy_with(folder: Path, files: dict[str, str], added: str, registry: str, before: str) -> Path:
    """Copy ``tactemu`` into a folder, with ``added`` as one of its own files and its line ahead of ``before``."""
    shutil.copytree(ROOT / "tactemu", folder / "tactemu", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / added).write_text(as_in_the_tree(files[Path(added).name]))
    text = (folder / registry).read_text()
    assert text.count(before) == 1
    (folder / registry).write_text(text.replace(before, files[Path(registry).name] + before))
    return folder


def run(folder: Path, *words: str) -> str:
    """Output of Python in that folder, which comes before this tree."""
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    return done.stdout


def run_pytest(folder: Path, *words: str) -> str:
    """Output of pytest in that folder."""
    return run(folder, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:tactemu", *words)
