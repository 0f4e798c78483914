"""The tutorial runs as it is written: its blocks, in order, in one shell; the output that it shows appears."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+) ?(\S*)\n(.*?)^```$", PAGE, flags=re.M | re.S)
"""Language, file name and text of each block."""
FOLDER = "~/first-driver"
FAILING = ["timeout 4 python driver.py sensor > forces.csv", "python -m pytest -q --tactemu-truth-dir failed"]
"""Commands of the page that end with an error: the time is up, and a test fails."""
STEP, FAILED = "@step", "@failed "


def script(folder: Path, *, installs: bool) -> str:
    """Return the shell script of the page, with ``folder`` instead of the reader's and job control."""
    lines = ["set -m", f"trap 'echo \"{FAILED}$BASH_COMMAND\"' ERR", "trap 'kill $(jobs -p) 2>/dev/null || true' EXIT"]
    for language, name, text in BLOCKS:
        if name:
            lines.append(f"cat > {name} <<'END OF FILE'\n{text}END OF FILE")
        elif language == "sh" and (installs or "pip install" not in text):
            lines += [text.replace(FOLDER, str(folder)), f"echo '{STEP}'"]
        elif language == "sh":
            lines.append(f"echo '{STEP}'")
    return "\n".join(lines)


def run(text: str, **environment: str) -> str:
    """Return the output of the script, which is ended with all that it started after some minutes."""
    cleared = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "TACTEMU_", "VIRTUAL_ENV"))}
    shell = subprocess.Popen(
        ["bash", "-c", text], cwd=ROOT, env=cleared | {"NO_COLOR": "1", "COLUMNS": "120"} | environment, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        return shell.communicate(timeout=170 if "pip install" not in text else 500)[0]
    except subprocess.TimeoutExpired:
        os.killpg(shell.pid, signal.SIGKILL)
        return pytest.fail(f"it does not end: {shell.communicate()[0][-3000:]}")


def plain(text: str) -> str:
    """Return a text with one space wherever it has spaces or line ends."""
    return " ".join(text.split())


def check(output: str) -> None:
    """Compare which commands fail, and what the page shows below a step, where '…' stands for anything."""
    assert re.findall(rf"^{FAILED}(.*)", output, flags=re.M) == FAILING, output
    steps = [plain(step) for step in output.split(STEP)]
    step = ""
    for language, name, text in BLOCKS:
        if language == "sh":
            step = steps.pop(0)
        elif language == "output" and not name:
            missing = [part for line in text.splitlines() for part in line.split("…") if plain(part) not in step]
            assert missing == [], step


@pytest.mark.timeout(180)
def test_it_runs_as_it_is_written(tmp_path):
    if not Path(sys.executable).with_name("tactemu").exists():
        pytest.skip("tactemu is not installed here")
    tmp_path /= "first-driver"
    tmp_path.mkdir()
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    check(run(script(tmp_path, installs=False), PATH=path))


@pytest.mark.index
@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_it_runs_in_a_fresh_environment(tmp_path):
    kernels = tmp_path / "kernels"
    check(run(script(tmp_path / "first-driver", installs=True), WARP_CACHE_PATH=str(kernels), PYTHONPATH=""))
    assert any(kernels.rglob("*.o")), "the first start has compiled the kernels"


@pytest.mark.parametrize("message", re.findall(r"`(is the port of [^`]*|plot needs [^`]*)`", PAGE))
def test_messages_in_its_last_table_are_ours(message):
    texts = (path.read_text() for path in (ROOT / "tactemu").rglob("*.py"))
    assert any(message.replace("matplotlib", "{error.name}") in text for text in texts)
