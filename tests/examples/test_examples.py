"""Every example runs to its end and says what it promises."""

import subprocess
import sys

import pytest

from tests.cli.command import ROOT, environment

EXPECTED = {
    "two_drivers.py": ["read by the anyskin package", "read by the linkerbot SDK", "every one as it was sent"],
}


def test_every_example_is_tested():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(EXPECTED)


@pytest.mark.driver
@pytest.mark.timeout(150)
@pytest.mark.parametrize("name", EXPECTED)
def test_an_example_runs(name):
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / name)], capture_output=True, text=True, timeout=140, env=environment(),
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    for words in EXPECTED[name]:
        assert words in done.stdout.replace("\n", " "), words
