"""The start of Warp: what it prints, and where kernels are kept when the usual folder cannot be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import environment
from tests.scene.engine_models import NEEDS_ENGINES

ASK = "from tactemu.base.kernels import start_warp; start_warp(); import warp, os; d = warp.config.kernel_cache_dir; "


@pytest.fixture
def ask(tmp_path):
    """The folder of a run without a home, whether it can be written, and what was said."""
    (tmp_path / "file").write_text("no folder can be made below a file")
    nowhere = str(tmp_path / "file" / "home")
    env = {**environment(), "HOME": nowhere, "XDG_CACHE_HOME": nowhere, "TMPDIR": str(tmp_path)}
    env.pop("WARP_CACHE_PATH", None)

    def run() -> tuple[str, str]:
        done = subprocess.run(
            [sys.executable, "-c", f"{ASK} print(d, os.access(d, os.W_OK))"], env=env, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        folder, writable = done.stdout.split()
        assert writable == "True" and done.stderr.count("\n") <= 1
        assert not done.stderr or done.stderr.startswith(f"tactemu: {nowhere}{os.sep}warp")
        return folder, done.stderr

    return run


def test_without_a_home_kernels_are_kept_in_a_folder_of_the_user_alone(ask, tmp_path):
    folder = tmp_path / f"tactemu-kernels-{os.getuid()}"
    found, said = ask()
    assert folder in Path(found).parents and f"kernels are kept in {folder}" in said and "WARP_CACHE_PATH" in said
    assert folder.stat().st_mode & 0o777 == 0o700
    assert ask() == (found, ""), "the next run has them, and says nothing"


@pytest.mark.parametrize("whose", ["open to others", "a link"])
def test_a_folder_that_others_may_write_is_not_trusted(ask, tmp_path, whose):
    folder = tmp_path / f"tactemu-kernels-{os.getuid()}"
    if whose == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    found, said = ask()
    assert folder not in (Path(found), *Path(found).parents) and "compiled anew in each run" in said
    assert not os.path.exists(found), "it is removed in the end"


BATCH = """
import numpy as np, tactemu as tt
scene = tt.Scene(dt=1e-3)
pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
skin = scene.add_sensor(tt.ContactProbe(positions=np.zeros((1, 3)), radius=0.001), link=pad)
sim = scene.build(n_envs=2, device="cpu")
sim.step()
skin.read()
"""
SERVE = 'import tactemu\nwith tactemu.serve("anyskin", "memory:", clock="lockstep") as device: device.press(depth=1e-3)'
ENGINE = """
import pathlib, sys, tactemu as tt
file = pathlib.Path(sys.argv[1], "empty.xml")
file.write_text("<mujoco><option timestep='0.001'/><worldbody/></mujoco>")
tt.MujocoWarpEngine(tt.Scene(dt=1e-3), file)
"""


@pytest.mark.parametrize("program", [BATCH, SERVE, pytest.param(ENGINE, marks=NEEDS_ENGINES)])
def test_a_program_prints_nothing_of_warp(program, tmp_path):
    command = [sys.executable, "-c", program, str(tmp_path)]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_program_that_sets_warps_log_level_keeps_it():
    program = "import warp\nwarp.config.log_level = warp.LOG_DEBUG\n" + BATCH
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment(), capture_output=True, text=True, check=True
    )
    assert "Module" in done.stdout
