"""tactemu stands beside what drivers pin: it resolves, and, each night, it runs there."""

import json
import sys

import pytest

from tests.packaging.test_wheel import PROJECT, ROOT, UV, run, uv

pytestmark = pytest.mark.index

OTHERS = {
    "pymodbus 2.5.3": ["pymodbus==2.5.3"],
    "pymodbus 3.16": ["pymodbus==3.16.*"],
    "numpy 1.26": ["numpy==1.26.*"],
    "numpy 2": ["numpy>=2"],
    "pydantic 2.8": ["pydantic==2.8.*"],
    "the newest": ["pymodbus>=3.16", "numpy>=2", "pydantic>=2.13"],
    "all old at once": ["pymodbus==2.5.3", "numpy==1.26.*", "pydantic==2.8.*", "typer==0.15.*", "rich==13.9.*"],
}


@pytest.fixture(scope="module", autouse=True)
def needs_uv():
    if not UV.exists():
        pytest.skip("uv is not there: it comes with the extra dev")


ALWAYS = ("the newest", "all old at once")


@pytest.mark.parametrize("python", ["3.11", pytest.param("3.14", marks=pytest.mark.nightly)])
@pytest.mark.parametrize(
    "others", [name if name in ALWAYS else pytest.param(name, marks=pytest.mark.nightly) for name in OTHERS]
)
def test_it_resolves_beside(others, python, tmp_path):
    (tmp_path / "all.in").write_text("\n".join([*PROJECT["dependencies"], *OTHERS[others]]))
    done = uv("pip", "compile", "--quiet", "--python-version", python, "--no-header", tmp_path / "all.in")
    assert all(f"{line.partition('=')[0].partition('>')[0]}==" in done.stdout for line in OTHERS[others])


def test_what_it_needs_is_little_and_loosely_pinned():
    assert len(PROJECT["dependencies"]) <= 14
    assert [line for line in PROJECT["dependencies"] if "==" in line or "<" in line or ">=" not in line] == []


def test_every_file_of_the_lock_has_its_hash_and_no_address():
    text = (ROOT / "requirements.lock").read_text()
    packages = [block for block in text.split("\n")[1:] if block and not block.startswith((" ", "#"))]
    assert len(packages) > 80 and all("==" in line and line.endswith("\\") for line in packages)
    assert "://" not in text and "--hash=sha256:" in text


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("others", ALWAYS)
def test_it_runs_beside(others, tmp_path):
    python = tmp_path / "venv/bin/python"
    uv("venv", "--python", sys.executable, tmp_path / "venv")
    lowest = ("--resolution", "lowest-direct") if "old" in others else ()
    uv("pip", "install", "--python", python, *lowest, ROOT, "pytest>=8", *OTHERS[others])
    frozen = json.loads(uv("pip", "list", "--python", python, "--format", "json").stdout)
    versions = {package["name"]: package["version"] for package in frozen}
    assert versions["pymodbus"].startswith("2.5.3" if "old" in others else "3.")
    for arguments in (
        ["run", "anyskin", "--seconds", "1", "--plain"],
        ["run", "inspire_rh56dftp", "--seconds", "1", "--plain"],
        ["run", "linker_hand_l6", "--seconds", "1", "--plain"],
        ["check", "robotiq_tsf85", "--fuzz", "100"],
        ["devices", "xela_uskin"],
        ["explain", "--no-cost", ROOT / "examples/hand.toml"],
    ):
        done = run(python.with_name("tactemu"), *arguments, cwd=tmp_path)
        assert done.returncode == 0, f"{arguments}: {done.stderr}\n{versions}"
    plugin = run(
        python.with_name("pytest"), "-q", "-p", "no:cacheprovider", ROOT / "examples/test_my_driver.py", cwd=tmp_path
    )
    assert "3 passed" in plugin.stdout, plugin.stdout + plugin.stderr
