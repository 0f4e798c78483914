"""What is installed because of tactemu, with its licence."""

import json
import re

import pytest

from tactemu.base.errors import TactemuError
from tactemu.cli import licences
from tests.cli.command import here

PACKAGES = {
    "skin": """
        License-Expression: Apache-2.0
        Provides-Extra: plots
        Provides-Extra: dev
        Requires-Dist: Wire_Kit[fast]>=1.2
        Requires-Dist: elsewhere; sys_platform == "win32"
        Requires-Dist: pictures>=3; extra == "plots"
        Requires-Dist: tool; extra == "dev"
    """,
    "wire-kit": """
        License: UNKNOWN
        Classifier: License :: OSI Approved :: MIT License
        Provides-Extra: fast
        Requires-Dist: speed ~= 1.0 ; platform_system != "Windows" and extra == 'fast'
        Requires-Dist: slow; extra == 'slow'
    """,
    "speed": "License: BSD",
    "slow": "License: not asked for",
    "pictures": "Name-Only: yes",
    "tool": "License: GPL",
}


@pytest.fixture
def packages(tmp_path, monkeypatch):
    for name, text in PACKAGES.items():
        folder = tmp_path / f"{name.replace('-', '_')}-1.0.dist-info"
        folder.mkdir()
        lines = [line.strip() for line in text.strip().splitlines()]
        (folder / "METADATA").write_text("\n".join(["Metadata-Version: 2.4", f"Name: {name}", "Version: 1.0", *lines]))
    monkeypatch.syspath_prepend(tmp_path)


def test_what_is_needed_is_followed_and_what_is_not_is_left_out(packages):
    assert [tuple(row) for row in licences.rows("skin")] == [
        ("skin", "1.0", "Apache-2.0", ""),
        ("wire-kit", "1.0", "MIT License", "skin"),
        ("pictures", "1.0", "?", "skin[plots]"),
        ("speed", "1.0", "BSD", "wire-kit"),
    ]


def test_a_package_that_is_not_installed_is_said_so():
    with pytest.raises(TactemuError, match="nobodys-skin is not installed"):
        licences.rows("nobodys-skin")


def test_all_that_tactemu_needs_is_listed_and_says_its_licence():
    found = {row["package"].lower(): row for row in json.loads(here("licences", "--json").stdout)}
    assert found["tactemu"]["licence"] == "Apache-2.0"
    for name in ("numpy", "warp-lang", "pyserial", "python-can", "pydantic", "typer", "rich", "trimesh", "crcmod-plus"):
        assert found[name]["needed_by"] == "tactemu"
    assert [name for name, row in found.items() if row["licence"] == "?"] == []
    assert re.search(r"(?m)^numpy +\S+ +BSD", here("licences").stdout)
