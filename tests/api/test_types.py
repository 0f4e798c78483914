"""The programs and files that the pages show pass pyright's strict rules; autocomplete shows the public names."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT, files_of

SHOWN = {  # page: the files of it that a user keeps
    "docs/adding-a-device.md": ("acme_palm.py", "acme_grip.py"),
    "docs/adding-a-sensor-model.md": ("pin_taxel.py", "test_pin_taxel.py"),
    "docs/adding-a-shape.md": ("torus.py", "ring.py"),
}
FILES = [(page, name) for page, names in SHOWN.items() for name in names]
WARP = {
    "reportInvalidTypeForm", "reportUnknownParameterType", "reportUnknownVariableType", "reportUnknownArgumentType",
    "reportUnknownMemberType", "reportUntypedFunctionDecorator", "reportAssignmentType", "reportGeneralTypeIssues",
    "reportCallIssue", "reportArgumentType",
}  # fmt: skip
"""The rules that Warp's types break, in files with kernels."""


@pytest.fixture(scope="module")
def errors(tmp_path_factory) -> dict[tuple[str, str], list[str]]:
    """What pyright finds in the files of the pages, each page in a folder of its own."""
    pytest.importorskip("pyright")
    folder = tmp_path_factory.mktemp("pages")
    for page, names in SHOWN.items():
        (folder / Path(page).stem).mkdir()
        for name in names:
            (folder / Path(page).stem / name).write_text(files_of(ROOT / page)[name])
    roots = [{"root": Path(page).stem, "extraPaths": [str(ROOT)]} for page in SHOWN]
    config = {"typeCheckingMode": "strict", "pythonVersion": "3.11", "executionEnvironments": roots}
    (folder / "pyrightconfig.json").write_text(json.dumps(config))
    words = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson", "-p", str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    told = json.loads(done.stdout)
    assert told["summary"]["filesAnalyzed"] == len(FILES), done.stderr
    found: dict[tuple[str, str], list[str]] = {each: [] for each in FILES}
    for each in told["generalDiagnostics"]:
        path = Path(each["file"])
        line = each["range"]["start"]["line"] + 1
        found[f"docs/{path.parent.name}.md", path.name].append(f"{line}: {each['message']} ({each.get('rule')})")
    return found


@pytest.mark.parametrize("file", FILES, ids=[name for _, name in FILES])
def test_a_file_of_a_page_passes_the_strict_rules(errors, file):
    assert errors[file] == []


@pytest.mark.parametrize("file", FILES, ids=[name for _, name in FILES])
def test_only_files_with_kernels_leave_out_rules_and_only_those_of_warp(file):
    text = files_of(ROOT / file[0])[file[1]]
    left_out = {
        word.strip() for line in text.splitlines() if line.startswith("# pyright: ") for word in line[11:].split(",")
    }
    assert left_out <= {f"{rule}=false" for rule in WARP}
    assert not left_out or "@wp." in text


def test_the_program_of_a_user_is_checked_by_the_strict_rules():
    """`.ci/run` has pyright read tests/typing."""
    assert "\n# pyright: strict\n" in (ROOT / "tests/typing/user_program.py").read_text()
