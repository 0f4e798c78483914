"""Every example runs to its end and says what it promises."""

import subprocess
import sys

import pytest

from tactemu.cli.truths import summarise
from tests.cli.command import ROOT, environment, plugin_options, tactemu

EXPECTED = {
    "without_a_wire.py": ["relative poses", "depth [mm]"],
    "own_simulator.py": ["poses: 100 frames", "readings: 100 frames", "largest force on the skin was 1.00 N"],
    "genesis_skin.py": ["100 frames", "the largest force on the skin was"],
    "mujoco_skin.py": ["t = 0.80 s, ball at x =", "force on the skin"],
    "hand_env.py": ["return:", "force:", "steps/s"],
    "press_env.py": ["return: 18", "steps/s"],
    "two_drivers.py": [
        "read by the anyskin package",
        "read by the linkerbot SDK",
        "150 of them equal a frame of the truth log",
    ],
}
ON_THE_CPU = ["--device", "cpu", "--envs", "2", "--steps", "5"]
ARGUMENTS = {"hand_env.py": [[*ON_THE_CPU, "--engine", engine] for engine in ("mujoco-warp", "newton")]}
NEEDS = {
    "mujoco_skin.py": ("mujoco",),
    "genesis_skin.py": ("genesis",),
    "hand_env.py": ("gymnasium", "newton"),
    "press_env.py": ("gymnasium",),
}
ELSEWHERE = ("two_drivers.py", "hand_env.py")
"""What other tests run daily: `scripts/try`, and tests/envs and tests/scene with these engines."""
RUNS = [
    pytest.param(name, arguments, marks=[pytest.mark.nightly] * (name in ELSEWHERE), id=" ".join([name, *arguments]))
    for name in EXPECTED
    for arguments in ARGUMENTS.get(name, [[]])
]


def test_every_example_is_tested():
    tested = {*EXPECTED, "test_my_driver.py"}
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == tested


@pytest.mark.driver
@pytest.mark.timeout(150)
@pytest.mark.parametrize(("name", "arguments"), RUNS)
def test_an_example_runs(name, arguments):
    for package in NEEDS.get(name, ()):
        pytest.importorskip(package, reason="the example says what to install")
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / name), *arguments], capture_output=True, text=True,
        timeout=140, env=environment(), check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    for words in EXPECTED[name]:
        assert words in done.stdout.replace("\n", " "), words


def test_a_driver_that_is_missing_is_said_at_once():
    code = "import two_drivers; two_drivers.ANYSKIN_DRIVER = 'import nosuchdriver'; two_drivers.main()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment(),
        cwd=ROOT / "examples", check=False,
    )  # fmt: skip
    assert done.returncode == 1 and "No module named 'nosuchdriver'" in done.stderr
    assert "pip install 'tactemu[drivers]'" in done.stderr


@pytest.mark.timeout(150)
def test_the_example_of_a_driver_under_test():
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *plugin_options(), "-p", "no:cacheprovider", "test_my_driver.py"],
        capture_output=True, text=True, timeout=140, env=environment(), cwd=ROOT / "examples", check=False,
    )  # fmt: skip
    assert "3 passed" in done.stdout, done.stdout + done.stderr


RIG = ROOT / "examples" / "so101.toml"


@pytest.mark.parametrize("path", sorted({*(ROOT / "examples").glob("*.toml")} - {RIG}), ids=lambda path: path.name)
def test_a_scene_runs_and_its_schedule_happens(path, tmp_path):
    log = tmp_path / "truth.jsonl"
    done = tactemu("run", str(path), "--port", "memory:", "--clock=virtual", "--seconds", "8", "--truth", str(log))
    assert done.returncode == 0, done.stderr
    skins = summarise(log)
    assert all(skin["largest_ideal"] > 0 for skin in skins.values()), "everything is touched"
    assert sum(len(skin["injected"]) for skin in skins.values()) >= 3


def test_the_rig_of_an_arm_runs(tmp_path):
    """Two arms have no taxels; of the fingertips both are touched, and the leader's joints swing."""
    log = tmp_path / "truth.jsonl"
    ports = [word for skin in ("leader", "follower", "fingertips") for word in ("--port", f"{skin}=memory:{skin}")]
    done = tactemu("run", str(RIG), *ports, "--clock=virtual", "--seconds", "4", "--truth", str(log))
    assert done.returncode == 0, done.stderr
    skins = summarise(log)
    assert set(skins) == {"leader", "follower", "fingertips"} and skins["fingertips"]["largest_ideal"] > 0
    assert all(skin["samples"] > 300 for skin in skins.values())
