"""The preload library as wheels bring it, built where the wheel is."""

import ctypes
import os
import platform
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tactemu.exec import build

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")
ELF_MACHINES = {"x86_64": 62, "aarch64": 183}


@pytest.mark.index
@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("machine", ELF_MACHINES)
def test_a_wheel_for_a_machine_has_the_library(machine, tmp_path, monkeypatch, exec_environment, compiled):
    if not UV.exists():
        pytest.skip("uv is not there: it comes with the extra dev")
    done = subprocess.run(
        [UV, "build", "--wheel", "--out-dir", tmp_path, ROOT], env=os.environ | {"TACTEMU_WHEEL": machine},
        capture_output=True, text=True, timeout=500, check=False,
    )  # fmt: skip
    if done.returncode and re.search(r"dns error|error sending request|offline|Failed to fetch", done.stderr):
        pytest.skip("no package index is reached")
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob(f"tactemu-*-py3-none-manylinux_2_17_{machine}.whl")
    with zipfile.ZipFile(wheel) as archive:
        (tags,) = [archive.read(name) for name in archive.namelist() if name.endswith(".dist-info/WHEEL")]
        archive.extract("tactemu/exec/preload/preload.so", tmp_path)
    library = tmp_path / "tactemu" / "exec" / "preload" / "preload.so"
    assert b"Root-Is-Purelib: false" in tags
    assert struct.unpack_from("<H", library.read_bytes(), 18) == (ELF_MACHINES[machine],)
    assert max(int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)", library.read_bytes())) <= 17
    if machine == platform.machine():
        monkeypatch.setattr(build, "SOURCES", library.parent)
        monkeypatch.setenv("CC", "/no/such/compiler")
        done = exec_environment("flexitac").run([compiled("vendor")], capture_output=True, text=True, timeout=20)
        assert done.stdout.startswith("opened 166\ndtr down 164\n"), done.stderr


@pytest.mark.usefixtures("preload")
def test_a_library_is_made_once_and_anew_when_its_sources_change(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = build.library()
    made = first.stat().st_mtime_ns
    assert build.library() == first and first.stat().st_mtime_ns == made
    monkeypatch.setattr(build.platform, "machine", lambda: "another")
    assert build.library() != first


@pytest.mark.usefixtures("preload")
def test_it_takes_over_functions_of_libc_and_no_others():
    """A driver may have a function of any other name."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("needs nm of binutils")
    listed = subprocess.run([nm, "-D", "--defined-only", build.library()], capture_output=True, text=True, check=True)
    names = {line.split()[-1] for line in listed.stdout.splitlines()}
    libc = ctypes.CDLL(None)
    assert [name for name in names if not hasattr(libc, name)] == []
    assert {"ioctl", "tcsetattr", "socket", "recvmsg"} <= names


@pytest.mark.usefixtures("preload")
def test_without_a_cache_it_is_kept_in_a_temporary_folder_of_the_user_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    made = build.library()
    assert made.parent == tmp_path / f"tactemu-exec-{os.getuid()}" and made.parent.stat().st_mode & 0o777 == 0o700
    assert build.library() == made
