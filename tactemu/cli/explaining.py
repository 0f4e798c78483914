"""``tactemu explain``: the content of a scene, and the stages of its simulation with reasons and times."""

from __future__ import annotations

import json
import time

from tactemu.base.kernels import start_quietly
from tactemu.cli.datasheet import frame_page, ports_of, rates_of, taxel_map
from tactemu.scene import file

MAX_MAP_LINES = 60
"""Maximum number of lines of a skin's taxel map."""


def print_schema() -> None:
    """Print the JSON schema of scene files."""
    print(json.dumps(file.json_schema(), indent=2))


def explain_target(target: str, *, compute: str | None, cost: bool, code: bool = True) -> None:
    """Print bodies, skins, frames, taxels and the plan of a device's scene or a scene file.

    Raises:
        TactemuError: the scene is invalid, or it names Python files and ``code`` is False.
    """
    from tactemu.emulator.scenario import laws_needed
    from tactemu.scene.building import build_scene, make_devices

    loaded = file.load(target, code=code)
    devices = make_devices(loaded)
    laws = {name: laws_needed(loaded.tables.scenario, name) for name in devices}
    scene, skins = build_scene(loaded, devices, laws)
    world = loaded.tables.scene
    print(f"{loaded.source}: a step of {world.dt * 1e3:g} ms, seed {world.seed}\n")
    _print_bodies(loaded)
    for skin in loaded.tables.skin:
        _print_skin(skin, devices[skin.title], skins.get(skin.title))
    if not skins:
        print("Plan: nothing is simulated")
        return
    _print_schedule(loaded)
    start_quietly()
    simulation = scene.build(device=compute or world.device, seed=world.seed, dtype=world.dtype)
    simulation.step()
    if cost:
        simulation.plan.time_stages(time.perf_counter_ns)
    print("Plan: the stages that this scene needs, with their time per step on this machine")
    print(simulation.plan)


def _print_bodies(loaded: file.LoadedScene) -> None:
    print("Bodies")
    for body in loaded.tables.body:
        motion = loaded.motions.get(body.name)
        how = "fixed" if body.fixed else motion.kind if motion else "moved from Python only"
        print(f"  {body.name:<16} {body.shape:<9} {how}")
    print()


def _print_schedule(loaded: file.LoadedScene) -> None:
    if not loaded.tables.scenario:
        return
    print("Schedule")
    for event in sorted(loaded.tables.scenario, key=lambda event: event.at):
        said = event.model_dump(exclude_defaults=True, exclude={"at", "until", "skin"})
        until = "" if event.until is None else f" to {event.until:g} s"
        what = ", ".join(f"{name} = {value}" for name, value in said.items())
        print(f"  {event.at:g} s{until}  {event.skin or 'every skin'}: {what}")
    print()


def _print_skin(skin, device, sensor) -> None:
    print(f"Skin {skin.title!r}: {device.title}, {f'on {skin.link!r}' if skin.link else f'plays {skin.readings}'}")
    if sensor is not None:
        from tactemu.scene.building import model_name

        print(f"  model     {model_name(skin, device)}: the device senses {', '.join(s.key for s in device.sensed)}")
    print(f"  wire      {', '.join(ports_of(device))}")
    print(f"  rate      {rates_of(device, skin.rate_hz)}")
    for fault in skin.faults:
        print(f"  fault     {fault}")
    print("  frames")
    print("\n".join(f"    {line}".rstrip() for line in frame_page(device)))
    lines = taxel_map(device.layout)
    print("\n".join("  " + line for line in lines[:MAX_MAP_LINES]))
    if len(lines) > MAX_MAP_LINES:
        print(f"  … {len(lines) - MAX_MAP_LINES} more lines: `tactemu devices {skin.device}`")
    print()
