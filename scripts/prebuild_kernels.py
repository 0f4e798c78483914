#!/usr/bin/env python3
"""Compile the kernels of every device's default scene, and of the demo, ahead of time, for one level of x86-64.

    scripts/prebuild_kernels.py [FOLDER [SCENE ...]]

FOLDER is that of the package if none is given, which `.gitignore` names. With scenes, only their kernels are compiled.
On another machine nothing is made, and a line says so.
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import warp as wp

from tactemu.base import cpu_code, kernels

KEPT = (".o", ".meta")
"""The files of a module that Warp needs to load it."""


def main(folder: Path, scenes: list[str]) -> None:
    if cpu_code.compiler_flags() is None:
        print(f"{sys.argv[0]}: no kernels ahead of time: this processor is not of the level {cpu_code.LEVEL}")
        return
    print(f"compiling kernels ahead of time; number of scenes: {len(scenes)} (a minute or less)", flush=True)
    with tempfile.TemporaryDirectory(prefix="tactemu-kernels-") as cache:
        wp.config.kernel_cache_dir = cache
        cpu_code.PREBUILT = Path(cache) / "none"  # all are compiled anew
        kernels.start_warp()
        build(scenes)
        modules = [each for each in Path(str(wp.config.kernel_cache_dir)).glob("wp_*") if each.is_dir()]
        made = folder / cpu_code.prebuilt_folder().name
        shutil.rmtree(made, ignore_errors=True)
        for module in modules:
            (made / module.name).mkdir(parents=True)
            for file in module.iterdir():
                if file.suffix in KEPT:
                    shutil.copyfile(file, made / module.name / file.name)
    size = sum(file.stat().st_size for file in made.rglob("*") if file.is_file())
    print(f"{len(modules)} kernels compiled ahead of time, {size / 1e3:.0f} kB, in {made}")


def default_scenes() -> list[str]:
    """Return the default scene of every device and the scene of ``tactemu see --demo``."""
    devices = json.loads((ROOT / "tactemu/cli/devices.json").read_text())
    return [*(device["name"] for device in devices), str(ROOT / "tactemu/scene/demo.toml")]


def build(scenes: list[str]) -> None:
    """Assemble scenes, which loads their kernels."""
    from tactemu.emulator.assembly import assemble
    from tactemu.emulator.options import AssemblyOptions
    from tactemu.scene import file

    for scene in scenes:
        assemble(file.load(scene), AssemblyOptions(port="memory:"))


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else cpu_code.PREBUILT), sys.argv[2:] or default_scenes())
