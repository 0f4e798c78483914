"""A set-up of a checkout says each step before it takes it, and nothing when there is nothing to do."""

import os
import shutil
import subprocess

from tests.packaging.test_wheel import ROOT

RECORDER = '#!/bin/sh\necho "python $1 $2 $3" >&2\n'
"""A Python that installs nothing and writes the beginning of its command line."""


def set_up(folder, extras):
    """Run a copy of ``scripts/setup-venv``, and return what it wrote, line by line."""
    command = [folder / "scripts/setup-venv", extras]
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, check=True).stderr.splitlines()


def checkout(folder):
    (folder / "scripts").mkdir(parents=True)
    (folder / ".venv/bin").mkdir(parents=True)
    shutil.copy(ROOT / "scripts/setup-venv", folder / "scripts")
    (folder / ".venv/bin/python").write_text(RECORDER)
    (folder / ".venv/bin/python").chmod(0o755)
    for file in ("pyproject.toml", "requirements.lock"):
        (folder / file).write_text("")
        os.utime(folder / file, (0, 0))
    return folder


def test_each_step_of_a_set_up_has_a_line_before_it(tmp_path):
    for extras, steps in (("drivers", 1), ("all", 3)):
        folder = checkout(tmp_path / extras)
        *said, kernels = set_up(folder, extras)
        assert kernels.split()[:2] == ["python", "scripts/prebuild_kernels.py"], "it writes a line of its own"
        assert len(said) == 2 * steps
        for line, command in zip(said[::2], said[1::2], strict=True):
            assert line.startswith("setup-venv: installing ") and line.endswith("s)"), line
            assert command == "python -m pip install"
        assert set_up(folder, extras) == [], "there is nothing to do"
