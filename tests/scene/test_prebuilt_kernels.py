"""Kernels compiled ahead of time: default scenes and the demo start without a compiler, and transmit the same bytes."""

import json
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


SEVERAL = """
import json, sys
from pathlib import Path
from tactemu.base import cpu_code
from tactemu.cli import main
cpu_code.PREBUILT, cache, compiled = Path(sys.argv[1]), Path(sys.argv[2]), {}
for name in sys.argv[3:]:
    before = len(list(cache.rglob("*.cpp")))
    sys.argv = ["tactemu", "run", name, "--port", "memory:", "--clock", "virtual", "--seconds", "0.1", "--json"]
    try:
        main()
    except SystemExit as end:
        assert not end.code, name
    compiled[name] = len(list(cache.rglob("*.cpp"))) - before
(cache / "compiled.json").write_text(json.dumps(compiled))
"""


def scenes_here(request):
    """Return the devices whose scenes this run starts."""
    here = [item for item in request.session.items if item.path == request.path and hasattr(item, "callspec")]
    return {item.callspec.params["name"] for item in here}


@pytest.fixture(scope="module")
def prebuilt(request, tmp_path_factory):
    """Compile the kernels of the scenes that this run starts; with all devices, those that the wheel contains."""
    folder = tmp_path_factory.mktemp("prebuilt")
    names = scenes_here(request)
    scenes = [] if names >= set(firmware_protocols.names()) else [*sorted(names | {"anyskin"}), DEMO]
    subprocess.run([sys.executable, ROOT / "scripts/prebuild_kernels.py", folder, *scenes], check=True)
    return folder


def test_the_wheel_has_the_kernels_of_every_device_and_of_the_demo():
    build = runpy.run_path(str(ROOT / "scripts/prebuild_kernels.py"))
    assert set(build["default_scenes"]()) == {*firmware_protocols.names(), DEMO}


def run(name: str, cache: Path, prebuilt: Path, code: str = "portable") -> tuple[str, int]:
    """Return the truth log of a run, which has all bytes and values, and the number of kernels compiled so far."""
    log = cache / "truth.jsonl"
    words = ["run", name, "--port", "memory:", "--clock", "virtual", "--seconds", "2.2", "--seed", "1", "--json"]
    subprocess.run(
        [sys.executable, "-c", START, prebuilt, code, *words, "--truth", log], check=True, timeout=100,
        env=environment() | {"WARP_CACHE_PATH": str(cache)}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return log.read_text(), len(list(cache.rglob("*.cpp")))


@pytest.fixture(scope="module")
def compiled(request, prebuilt, tmp_path_factory):
    """Return the number of kernels that each scene compiles at its start, one after the other in one process."""
    cache = tmp_path_factory.mktemp("cache")
    scenes = [*sorted(scenes_here(request)), DEMO]
    subprocess.run(
        [sys.executable, "-c", SEVERAL, prebuilt, cache, *scenes], check=True, timeout=60 + 5 * len(scenes),
        env=environment() | {"WARP_CACHE_PATH": str(cache)}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return json.loads((cache / "compiled.json").read_text())


@needs_level
@pytest.mark.each_device
@pytest.mark.parametrize("name", firmware_protocols.names())
def test_a_default_scene_starts_without_the_compiler(name, compiled):
    assert compiled[name] == 0


@needs_level
def test_so_does_the_demo(compiled):
    assert compiled[DEMO] == 0


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
