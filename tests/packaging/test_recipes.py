"""What people copy into their CI: files of the right form, and, each night, steps that run in a clean folder."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.packaging.test_wheel import ROOT, UV, run, uv

RECIPES = ROOT / "examples" / "ci"
PINNED = re.compile(r"uses: (?:\./|OWNER/tactemu@REF|[\w-]+/[\w-]+@[0-9a-f]{40} # v[\d.]+)$")
SCHEMAS = {
    "vendor.github-actions": [ROOT / "action.yml"],
    "vendor.github-workflows": [*(ROOT / ".github/workflows").glob("*.yml"), RECIPES / "github.yml"],
    "vendor.gitlab-ci": [RECIPES / "gitlab.yml"],
}


@pytest.mark.parametrize("schema", SCHEMAS)
def test_files_for_a_ci_are_of_its_form_and_pinned(schema):
    pytest.importorskip("check_jsonschema", reason="check-jsonschema is not installed: it comes with the extra dev")
    transform = ("--data-transform", "gitlab-ci") if "gitlab" in schema else ()
    done = run(sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *transform, *SCHEMAS[schema])
    assert done.returncode == 0, done.stdout + done.stderr
    for path in SCHEMAS[schema]:
        used = re.findall(r"uses: .*", path.read_text())
        assert [line for line in used if not PINNED.match(line)] == [], path


def test_every_input_of_the_action_is_used_and_every_one_that_is_used_is_there():
    text = (ROOT / "action.yml").read_text()
    declared = set(re.findall(r"(?m)^  (\w+):\n    description", text.partition("outputs:")[0]))
    assert declared == set(re.findall(r"inputs\.(\w+)", text))
    for path in (RECIPES / "github.yml", ROOT / ".github/workflows/ci.yml"):
        for block in re.findall(r"uses: (?:\./|OWNER/\S+)\n +with:\n((?: {10,}.*\n)+)", path.read_text()):
            assert set(re.findall(r"(?m)^ {10}(\w+):", block)) <= declared


def steps_of_the_action() -> dict[str, str]:
    """Its own shell steps by name; what ``uses:`` names is GitHub's and not seen here."""
    blocks = re.findall(r"    - name: ([^\n]*)\n(.*?)(?=\n    - |\Z)", (ROOT / "action.yml").read_text(), re.DOTALL)
    found = {name: re.search(r"\n      run: (?:\|\n)?(.*)", body, re.DOTALL) for name, body in blocks}
    return {name: run[1] for name, run in found.items() if run}


def run_step(name: str, folder: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """Run a step as the runner does, which cuts its indent and gives it files for outputs."""
    files = {"GITHUB_OUTPUT": str(folder.parent / "outputs"), "RUNNER_TEMP": str(folder.parent)}
    return run("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", steps_of_the_action()[name], cwd=folder,
               **files, **inputs)  # fmt: skip


@pytest.mark.parametrize(
    ("command", "passes"),
    [
        ("true\ntrue", True),
        ("false\ntrue", False),
        ("false | cat\ntrue", False),
        ("sleep 60 &\ntrap 'kill %1' EXIT\nfalse", False),
        ("sleep 60 &\ntrap 'kill %1' EXIT\ntrue", True),
    ],
)
def test_a_line_that_fails_fails_the_action(command, passes, tmp_path):
    folder = tmp_path / "driver"
    folder.mkdir()
    done = run_step("Run the tests", folder, COMMAND=command, KEEP="kept", ARTIFACT="failed-0")
    assert (done.returncode == 0) == passes, done.stdout + done.stderr


def test_the_action_keeps_a_folder_with_spaces_wherever_the_tests_run(tmp_path):
    folder = tmp_path / "driver"
    (folder / "sub").mkdir(parents=True)
    test = "def test_wrong(tactile_device):\n    tactile_device('anyskin', 'memory:')\n    assert 0\n"
    (folder / "sub" / "test_wrong.py").write_text(test)
    command = f"cd sub\n{shlex.quote(sys.executable)} -m pytest -p no:cacheprovider"
    inputs = {"COMMAND": command, "KEEP": "what failed", "ARTIFACT": "failed-0", "PYTHONPATH": str(ROOT)}
    for artifact in ("failed-0", "failed-0-2"):
        assert run_step("Run the tests", folder, **inputs).returncode == 1
        outputs = dict(line.split("=", 1) for line in (tmp_path / "outputs").read_text().splitlines())
        assert outputs == {"kept": str(folder / "what failed"), "artifact": artifact}
    assert {path.suffix for path in (folder / "what failed").iterdir()} >= {".mcap", ".svg", ".log"}
    assert list((folder / "sub").glob("what*")) == []


@pytest.mark.parametrize(
    "path", [RECIPES / "github.yml", ROOT / ".github/workflows/ci.yml"], ids=lambda path: path.stem
)
def test_no_example_ends_with_a_line_that_hides_what_failed(path):
    assert not re.search(r"(?m)^ +kill ", path.read_text()), "in a trap, so that the tests decide"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    if not UV.exists():
        pytest.skip("uv is not there: it comes with the extra dev")
    uv("build", "--wheel", "--out-dir", folder, ROOT)
    return next(folder.glob("*.whl"))


@pytest.fixture
def driver(tmp_path):
    """A repository of somebody's driver: its tests, one of them wrong."""
    folder = tmp_path / "driver"
    folder.mkdir()
    shutil.copy(ROOT / "examples/test_my_driver.py", folder)
    wrong = "def test_wrong(tactile_device):\n    tactile_device('anyskin').press(1e-3)\n    assert 0\n"
    (folder / "test_wrong.py").write_text(wrong)
    return folder


def _judge(done, kept: Path) -> None:
    """Three tests passed, one failed, and its truth and picture are there."""
    assert "1 failed, 3 passed" in done.stdout, done.stdout + done.stderr
    assert {path.suffix for path in kept.iterdir()} >= {".mcap", ".svg"}


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_shell_recipe(wheel, driver):
    _judge(run("sh", RECIPES / "tests.sh", cwd=driver, TACTEMU=str(wheel)), driver / "tactemu-failed")


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_steps_for_gitlab(wheel, driver):
    steps = re.findall(r"(?m)^    - (.*)", (RECIPES / "gitlab.yml").read_text())
    _judge(run("sh", "-ec", "\n".join(steps), cwd=driver, TACTEMU=str(wheel)), driver / "tactemu-failed")
    assert (driver / "tactemu-failed/report.xml").exists()


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_steps_of_the_action(wheel, driver, tmp_path):
    """Its own shell steps, with the inputs that a workflow gives."""
    assert run(sys.executable, "-m", "venv", tmp_path / "venv").returncode == 0
    inputs = {
        "GITHUB_ACTION_PATH": str(wheel), "EXTRAS": "", "KEEP": "tactemu-failed", "ARTIFACT": "failed-0",
        "COMMAND": "python -m pip install --quiet pytest\npython -m pytest -p no:cacheprovider",
        "PATH": f"{tmp_path}/venv/bin:/usr/bin:/bin",
    }  # fmt: skip
    for name in ("Install tactemu", "Print the capabilities of this machine", "Run the tests"):
        done = run_step(name, driver, **inputs)
        assert name == "Run the tests" or done.returncode == 0, done.stdout + done.stderr
    assert done.returncode == 1, "a test failed, and so does the step"
    _judge(done, driver / "tactemu-failed")
    assert "1 failed, 3 passed" in (driver / "tactemu-failed/tests.log").read_text()


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_steps_of_the_dockerfile(wheel, driver, tmp_path):
    """Each as the daemon would do it, with a folder for the user's home; the image itself is not built."""
    home = tmp_path / "tester"
    home.mkdir()
    variables = {"TACTEMU": str(wheel), "HOME": str(home)}
    here, command = home, []
    for line in (RECIPES / "Dockerfile").read_text().replace("/home/tester", str(home)).splitlines():
        word, _, rest = line.partition(" ")
        if word == "ENV":
            name, _, value = rest.partition("=")
            variables[name] = value.replace("$PATH", "/usr/local/bin:/usr/bin:/bin")
        elif word == "WORKDIR":
            here = Path(rest)
            here.mkdir()
        elif word == "RUN" and not rest.startswith("useradd"):
            step = rest.replace("python3 -m venv", f"{sys.executable} -m venv")
            done = run("sh", "-c", step, cwd=here, **variables)
            assert done.returncode == 0, done.stdout + done.stderr
        elif word == "COPY":
            assert rest == "--chown=tester . ."
            shutil.copytree(driver, here, dirs_exist_ok=True)
        elif word == "CMD":
            command = [word.strip('",[]') for word in shlex.split(rest.replace(",", " "))]
        else:
            assert word in ("", "#", "FROM", "ARG", "USER", "RUN")
    _judge(run(str(home / "venv/bin/python"), *command[1:], cwd=here, **variables), home / "failed")


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_image_is_built(wheel, driver):
    if (
        shutil.which("docker") is None
        or subprocess.run(["docker", "info"], capture_output=True, check=False).returncode
    ):
        pytest.skip("not built: no Docker daemon is reached")
    shutil.copy(wheel, driver)
    file = RECIPES / "Dockerfile"
    text = file.read_text().replace(
        "WORKDIR /home/tester/driver", f"WORKDIR /home/tester/driver\nCOPY {wheel.name} /tmp/"
    )
    (driver / "Dockerfile").write_text(text)
    done = run("docker", "build", "-q", "--build-arg", f"TACTEMU=/tmp/{wheel.name}", ".", cwd=driver)
    assert done.returncode == 0, done.stderr
    _judge(
        run("docker", "run", "--rm", "-v", f"{driver}/failed:/home/tester/failed", done.stdout.strip()),
        driver / "failed",
    )
