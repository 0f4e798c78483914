"""The flags of our kernels, and the copying of those that were compiled ahead of time."""

import re
from pathlib import Path

import pytest
import warp as wp

from tactemu.base import cpu_code

TACTEMU = Path(__file__).parents[2] / "tactemu"


@pytest.fixture
def prebuilt(tmp_path, monkeypatch):
    """A folder of one module, for a processor that has the level."""
    monkeypatch.setattr(cpu_code, "PREBUILT", tmp_path / "prebuilt")
    monkeypatch.setattr(cpu_code, "compiler_flags", lambda: "-target-cpu x86-64-v3")
    folder = cpu_code.prebuilt_folder() / "wp_some"
    folder.mkdir(parents=True)
    (folder / "some.o").write_text("object")
    (folder / "some.meta").write_text("meta")
    return folder


def test_all_our_kernels_are_declared_in_one_way():
    found = [path for path in TACTEMU.rglob("*.py") if re.search(r"@wp\.kernel", path.read_text())]
    assert found == [], "@warp_kernel gives them the flags of the CPU code"


def test_no_kernel_makes_the_compiler_warn_of_missing_parentheses():
    found = [
        f"{path.name}: {line.strip()}"
        for path in TACTEMU.rglob("*.py")
        for line in path.read_text().splitlines()
        if re.search(r"(?:=|,|return) *\([^()]*\) [&|] \([^()]*\) \?", line)
    ]
    assert found == [], "clang prints its warnings to the terminal of a user whose kernels are compiled"


def test_a_cache_gets_what_it_lacks_and_keeps_what_it_has(prebuilt, tmp_path):
    cache = tmp_path / "cache"
    (cache / "wp_some").mkdir(parents=True)
    (cache / "wp_some/some.meta").write_text("its own")
    cpu_code.fill_cache(str(cache))
    assert {path.name: path.read_text() for path in cache.rglob("*.*")} == {"some.o": "object", "some.meta": "its own"}
    assert cpu_code.why_compiled() == ""


def test_kernels_for_another_warp_are_left_alone_and_the_reason_names_it(prebuilt, tmp_path):
    prebuilt.parent.rename(prebuilt.parents[1] / "1.0.0-Linux-x86_64-00000000")
    cpu_code.fill_cache(str(tmp_path / "cache"))
    assert not (tmp_path / "cache").exists()
    assert cpu_code.prebuilt_versions() == ["1.0.0"]
    assert f"for Warp 1.0.0, and Warp {wp.config.version} is installed" in cpu_code.why_compiled()


def test_another_processor_compiles_its_own(prebuilt, tmp_path, monkeypatch):
    monkeypatch.setattr(cpu_code, "compiler_flags", lambda: None)
    cpu_code.fill_cache(str(tmp_path / "cache"))
    assert not (tmp_path / "cache").exists() and cpu_code.LEVEL in cpu_code.why_compiled()


@pytest.mark.parametrize("flags", ["", "-march=znver3", None])
def test_a_program_that_chose_flags_for_all_of_warp_keeps_them(monkeypatch, flags):
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", flags)
    assert cpu_code.compiler_flags.__wrapped__() is None


def test_a_cache_that_cannot_be_written_is_no_error(prebuilt, tmp_path):
    (tmp_path / "file").write_text("no folder can be made below a file")
    cpu_code.fill_cache(str(tmp_path / "file" / "cache"))
