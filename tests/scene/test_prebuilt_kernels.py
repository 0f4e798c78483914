"""Kernels compiled ahead of time: default scenes and the demo start without a compiler, and transmit the same bytes."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_protocols
from tactemu.base import cpu_code
from tests.cli.command import environment

ROOT = Path(__file__).parents[2]
DEMO = str(ROOT / "tactemu/scene/demo.toml")
needs_level = pytest.mark.skipif(cpu_code.compiler_flags() is None, reason="a processor of another level")
START = """
import sys
from pathlib import Path
from tactemu.base import cpu_code
from tactemu.cli import main
cpu_code.PREBUILT = Path(sys.argv[1])
if sys.argv.pop(2) == "native":
    cpu_code.compiler_flags = lambda: None
sys.argv[:2] = ["tactemu"]
main()
"""


@pytest.fixture(scope="module")
def prebuilt(request, tmp_path_factory):
    """Compile the kernels of the scenes that this run starts; with all devices, those that the wheel contains."""
    folder = tmp_path_factory.mktemp("prebuilt")
    here = [item for item in request.session.items if item.path == request.path and hasattr(item, "callspec")]
    names = {item.callspec.params["name"] for item in here}
    scenes = [] if names >= set(firmware_protocols.names()) else [*sorted(names | {"anyskin"}), DEMO]
    subprocess.run([sys.executable, ROOT / "scripts/prebuild_kernels.py", folder, *scenes], check=True)
    return folder


def test_the_wheel_has_the_kernels_of_every_device_and_of_the_demo():
    build = runpy.run_path(str(ROOT / "scripts/prebuild_kernels.py"))
    assert set(build["default_scenes"]()) == {*firmware_protocols.names(), DEMO}


def run(name: str, cache: Path, prebuilt: Path, code: str = "portable", *, seconds: float = 2.2) -> tuple[str, int]:
    """Return the truth log of a run, which has all bytes and values, and the number of kernels compiled so far."""
    log = cache / "truth.jsonl"
    words = ["run", name, "--port", "memory:", "--clock", "virtual", "--seconds", str(seconds), "--seed", "1", "--json"]
    subprocess.run(
        [sys.executable, "-c", START, prebuilt, code, *words, "--truth", log], check=True, timeout=100,
        env=environment() | {"WARP_CACHE_PATH": str(cache)}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return log.read_text(), len(list(cache.rglob("*.cpp")))


@needs_level
@pytest.mark.each_device
@pytest.mark.parametrize("name", firmware_protocols.names())
def test_a_default_scene_starts_without_the_compiler(name, prebuilt, tmp_path):
    _, compiled = run(name, tmp_path, prebuilt, seconds=0.1)
    assert compiled == 0


@needs_level
def test_so_does_the_demo(prebuilt, tmp_path):
    _, compiled = run(DEMO, tmp_path, prebuilt, seconds=0.1)
    assert compiled == 0


@needs_level
def test_bytes_are_the_same_ahead_of_time_cold_warm_and_compiled_for_this_processor_alone(prebuilt, tmp_path):
    caches = {name: tmp_path / name for name in ("ahead", "cold", "native")}
    for cache in caches.values():
        cache.mkdir()
    nothing = tmp_path / "nothing"
    ahead, none = run("anyskin", caches["ahead"], prebuilt)
    cold, some = run("anyskin", caches["cold"], nothing)
    warm = run("anyskin", caches["cold"], nothing)
    native, as_many = run("anyskin", caches["native"], prebuilt, "native")
    assert (none, some) == (0, as_many) and some > 0
    assert '"kind":"tx"' in ahead and ahead == cold and warm == (cold, some) and native == cold
