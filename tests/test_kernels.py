"""Where kernels are kept when the usual folder cannot be written."""

import os
import subprocess
import sys
from pathlib import Path

from tests.cli.command import environment

ASK = "from tactemu.kernels import start_quietly; start_quietly(); import warp, os; d = warp.config.kernel_cache_dir; "


def test_without_a_home_kernels_go_to_a_folder_of_the_run(tmp_path):
    (tmp_path / "file").write_text("no folder can be made below a file")
    nowhere = str(tmp_path / "file" / "home")
    env = {**environment(), "HOME": nowhere, "XDG_CACHE_HOME": nowhere, "TMPDIR": str(tmp_path)}
    env.pop("WARP_CACHE_PATH", None)
    done = subprocess.run(
        [sys.executable, "-c", f"{ASK} print(d, os.access(d, os.W_OK))"],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    folder, writable = done.stdout.split()
    assert writable == "True" and tmp_path in Path(folder).parents
    assert done.stderr.startswith(f"tactemu: {nowhere}{os.sep}warp") and "WARP_CACHE_PATH names a folder" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"], "it is removed in the end"
