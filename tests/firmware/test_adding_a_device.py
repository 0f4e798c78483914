"""docs/adding-a-device.md works as it stands: its pieces make a device that the contract tests find and pass."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import firmware_protocols as fp

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "adding-a-device.md"
TEMPLATE = "firmware_protocols.template:VendorModel"


def pieces() -> dict[str, str]:
    """The files that the page writes: fenced blocks by the name after their language, joined in order."""
    files: dict[str, str] = {}
    for name, text in re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE.read_text(), flags=re.M | re.S):
        files[name] = files.get(name, "") + text
    return files


@pytest.fixture
def package(tmp_path) -> Path:
    """An installed package with the page's device (and the template), as ``pip install`` would leave it."""
    files = pieces()
    for name in ("acme_palm.py", "golden/acme_palm.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(files[name])
    points = tomllib.loads(files["pyproject.toml"])["project"]["entry-points"]["tactemu.devices"]
    info = tmp_path / "acme_palm-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme_palm\nVersion: 1.0\n")
    lines = [f"{name} = {target}" for name, target in (points | {"template": TEMPLATE}).items()]
    (info / "entry_points.txt").write_text("[tactemu.devices]\n" + "\n".join(lines) + "\n")
    return tmp_path


def contract(package: Path, name: str) -> tuple[int, dict[str, int], str]:
    """Exit status, outcomes and output of the contract tests of one device, in a fresh process."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:tactemu", "-k", name]
    environment = os.environ | {"PYTHONPATH": f"{package}{os.pathsep}{ROOT}"}
    test = str(ROOT / "tests" / "firmware" / "test_contract.py")
    done = subprocess.run(
        [*command, test], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=100, check=False
    )
    outcomes = {word: int(count) for count, word in re.findall(r"(\d+) (passed|failed|error)", done.stdout)}
    return done.returncode, outcomes, done.stdout


@pytest.mark.parametrize("name", ["acme_palm", "template"])
def test_contract_tests_find_it_by_its_registration_alone(package, name):
    status, outcomes, output = contract(package, name)
    assert status == 0 and outcomes.get("passed", 0) >= 10 and set(outcomes) == {"passed"}, output[-2000:]


@pytest.mark.parametrize(
    ("right", "wrong", "caught_by"),
    [
        ("check ^= byte", "check += byte & 1", "test_golden_frames"),
        ("self._buffer[size if good else 1 :]", "self._buffer[size:]", None),
        ("0, 0xFFFF).astype", "0, 0x10000).astype", "test_digitizes_what_is_felt"),
        ("if len(self._buffer) < size:", "if len(self._buffer) < 4:", "test_input_comes_in_any_pieces"),
        ("DATA_LENGTH.get(request[1]) == size - 4", "size", "test_survives_random_and_mutated_commands"),
        ('"assumed",)', '"guessed",)', "test_datasheet_is_complete"),
    ],
)
def test_contract_tests_catch_mistakes(package, right, wrong, caught_by):
    """``None``: a device may do it either way."""
    path = package / "acme_palm.py"
    assert right in path.read_text()
    path.write_text(path.read_text().replace(right, wrong))
    _, outcomes, output = contract(package, f"acme_palm and {caught_by}" if caught_by else "acme_palm")
    assert bool(outcomes.get("failed")) == (caught_by is not None), output[-3000:]
    assert caught_by is None or caught_by in output


def test_it_takes_less_than_150_lines():
    lines = pieces()["acme_palm.py"].splitlines()
    assert len(lines) < 150, len(lines)
    assert all(len(line) <= 120 for line in lines)


def test_it_loads_from_its_path(package):
    device = fp.create(f"{package}/acme_palm.py:AcmePalm", serial="X")
    assert device.receive(bytes.fromhex("c17f00be"), 0) == [bytes.fromhex("c17f0158e7")]
