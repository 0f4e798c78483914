"""What users get: sdist and wheels, built, installed where this tree has never been, and used from there."""

import ast
import json
import os
import platform
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from email.parser import HeaderParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

pytestmark = [pytest.mark.index, pytest.mark.timeout(600)]


def run(*command, cwd=None, **environment):
    """As a user has it: nothing of this tree on the path, and not its environment either."""
    env = {
        k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "PYTEST_ADDOPTS", "CAN_CONFIG")
    }
    return subprocess.run(
        list(map(str, command)), cwd=cwd, env=env | {"NO_COLOR": "1", "COLUMNS": "120"} | environment,
        capture_output=True, text=True, timeout=500, check=False,
    )  # fmt: skip


def uv(*arguments, cwd=None, **environment):
    """Run uv, which needs a folder for its cache; skip where it finds no index."""
    elsewhere = {} if os.access(Path.home(), os.W_OK) else {"UV_CACHE_DIR": f"{tempfile.gettempdir()}/tactemu-tests-uv"}
    done = run(UV, *arguments, cwd=cwd, **elsewhere, **environment)
    if done.returncode and re.search(r"dns error|error sending request|offline|Failed to fetch", done.stderr):
        pytest.skip("no package index is reached")
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def dist(tmp_path_factory):
    """sdist, and the wheel that is made from it."""
    if not UV.exists():
        pytest.skip("uv is not there: it comes with the extra dev")
    folder = tmp_path_factory.mktemp("dist")
    uv("build", "--out-dir", folder, ROOT)
    return folder


@pytest.fixture(scope="module", params=["any", pytest.param(platform.machine(), marks=pytest.mark.nightly)])
def wheel(request, dist, tmp_path_factory):
    """The one for every machine; and, each night, the one for this kind of machine, which has the preload library."""
    folder = dist
    if request.param != "any":
        folder = tmp_path_factory.mktemp("machine")
        uv("build", "--wheel", "--out-dir", folder, ROOT, TACTEMU_WHEEL=request.param)
    (found,) = folder.glob("*.whl")
    assert found.name.endswith(f"{request.param}.whl")
    return found


@pytest.fixture(scope="module")
def files(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def metadata(files):
    (text,) = [content for name, content in files.items() if re.fullmatch(r"tactemu-[^/]+\.dist-info/METADATA", name)]
    return HeaderParser().parsestr(text.decode())


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """``bin`` of an environment that has the wheel and pytest, in the versions of the lock, and nothing else."""
    folder = tmp_path_factory.mktemp("anybody")
    versions = folder / "versions.txt"
    lock = (ROOT / "requirements.lock").read_text()
    versions.write_text("\n".join(re.findall(r"(?m)^[a-z][^ \n]*==[^ \\\n]+(?: ;[^\\\n]+)?", lock)))
    uv("venv", "--python", sys.executable, folder / "venv")
    packages = ("pytest", "pytest-xdist", "pytest-timeout")
    uv("pip", "install", "--python", folder / "venv/bin/python", "-c", versions, wheel, *packages)
    return folder / "venv/bin"


def test_the_sdist_has_what_the_tests_need(dist):
    (sdist,) = dist.glob("*.tar.gz")
    names = {name.partition("/")[2] for name in tarfile.open(sdist).getnames()}
    assert {"pyproject.toml", "requirements.lock", "README.md", "LICENSE", "tests/conftest.py", "scripts/test"} <= names
    assert not [name for name in names if name.startswith((".venv", "build/", "dist/"))]


def test_the_wheel_has_scenes_examples_and_pages(files):
    for folder, inside in (("examples", "tactemu/examples"), ("docs", "tactemu/docs")):
        for path in (ROOT / folder).rglob("*.*"):
            if not {"__pycache__", "pictures"} & set(path.parts):
                assert f"{inside}/{path.relative_to(ROOT / folder)}" in files
    scenes = {f"{path.relative_to(ROOT)}" for path in (ROOT / "tactemu/scene").glob("*/*.toml")}
    assert scenes and scenes <= files.keys()
    assert not [name for name in files if name.startswith(("tests/", "scripts/")) or "/pictures/" in name]


def test_only_the_wheel_for_x86_64_has_kernels_and_they_are_small(files, wheel):
    kernels = {name: content for name, content in files.items() if name.startswith("tactemu/prebuilt/")}
    assert bool(kernels) == wheel.name.endswith("_x86_64.whl")
    assert sum(map(len, kernels.values())) < 3e6


POINTER = re.compile(r"(?<![\w./@-])(?:docs|examples|scripts|tests)/[\w./-]*\w")
ALLOWED = {
    # where: what it says, of a source tree and not of what is installed
    "tactemu/docs/site/hooks.py": ["scripts/device_pages.py"],  # the site is made from a source tree
}


def _texts(source: str):
    """String constants that are no docstrings: what a user may read at run time."""
    tree = ast.parse(source)
    silent = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            yield node.value


def test_what_the_code_says_at_run_time_points_to_what_the_wheel_has(files):
    lacking = []
    for name, content in files.items():
        if name.endswith(".py") and not name.startswith(("firmware_protocols/devices/", "tactemu/examples/")):
            for text in _texts(content.decode()):
                lacking += [
                    (name, path)
                    for path in POINTER.findall(text)
                    if f"tactemu/{path}" not in files and path not in ALLOWED.get(name, ())
                ]
    assert lacking == []


def test_links_in_the_readme_are_absolute_and_classifiers_true(metadata):
    text = metadata.get_payload()
    assert "# tactemu" in text
    assert [link for link in re.findall(r"\]\(([^)]*)\)", text) if not link.startswith(("https://", "#"))] == []
    assert not re.findall(r"<img|src=", text)
    classifiers = metadata.get_all("Classifier")
    from trove_classifiers import classifiers as known

    assert set(classifiers) <= known
    stated = [line.rpartition(" ")[2] for line in classifiers if re.search(r":: 3\.\d+$", line)]
    workflow = (ROOT / ".github/workflows/ci.yml").read_text()
    assert set(stated) <= set(json.loads(re.search(r"python: (\[.*\])", workflow)[1])), "the workflow runs them"


def test_from_the_wheel_a_device_runs_and_is_judged(installed, tmp_path):
    assert run(installed / "python", "-c", "import tests", cwd=tmp_path).returncode, "this tree is not on its path"
    port = f"pty:{tmp_path}/skin"  # the usual path may be that of a page's own run
    done = run(installed / "tactemu", "run", "anyskin", "--port", port, "--seconds", "1", "--json", cwd=tmp_path)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0 and done.stderr == "", done.stderr
    summary = next(line for line in lines if line["event"] == "summary")
    assert lines[0]["event"] == "ready" and summary["samples"] > 10
    check = run(installed / "tactemu", "check", "anyskin", "--fuzz", "50", cwd=tmp_path)
    assert check.returncode == 0, check.stdout


@pytest.mark.nightly
def test_from_the_wheel_the_examples_run_in_the_plugin_side_by_side(installed, tmp_path):
    copied = run(installed / "tactemu", "examples", tmp_path / "tactile", cwd=tmp_path)
    assert copied.returncode == 0, copied.stderr
    options = ("-n", "4", "-p", "no:cacheprovider", "--timeout", "100", "--strict-markers")
    done = run(installed / "pytest", "-q", *options, tmp_path / "tactile/test_my_driver.py", cwd=tmp_path)
    assert "3 passed" in done.stdout, done.stdout + done.stderr
    explained = run(installed / "tactemu", "explain", "--no-cost", tmp_path / "tactile/hand.toml", cwd=tmp_path)
    assert explained.returncode == 0, explained.stderr


@pytest.mark.nightly
def test_uvx_runs_the_wheel(wheel, tmp_path):
    command = ("tactemu", "run", "anyskin", "--seconds", "0.3")
    done = uv("tool", "run", "--python", sys.executable, "--from", wheel, *command, cwd=tmp_path)
    assert "anyskin" in done.stdout
