"""``tactemu explain``: the content of a scene, and the stages of its simulation with reasons and times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tactemu.cli.fitting import output_width, print_fitted
from tactemu.cli.parameters import Compute

if TYPE_CHECKING:
    from firmware_protocols import Device
    from tactemu.scene.file import LoadedScene
    from tactemu.scene.placement import PlacedSkin
    from tactemu.scene.schema import SkinTable

MAX_MAP_LINES = 60
"""Maximum number of lines of a skin's taxel map."""

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def explain(
    target: Annotated[str | None, typer.Argument(metavar="DEVICE_OR_SCENE")] = None,
    device: Compute = None,
    cost: Annotated[bool, typer.Option(help="Measure the time of each stage on this machine.")] = True,
    code: Annotated[
        bool, typer.Option(help="Run code of others that the scene names (files, installed packages), or refuse it.")
    ] = True,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of scene files.")] = False,
) -> None:
    """Show the stages that a scene simulates, and why.

    It prints bodies, skins, frames and taxels, and the plan of the simulation with the time of each stage. If a mesh
    needs a band of distances, it first prints how long that takes to build, or that it is kept.

    \b
      tactemu explain anyskin
      tactemu explain hand.toml --device cuda:0
      tactemu explain downloaded.toml --no-code
      tactemu explain --schema > scene.schema.json
    """
    import json
    import time

    from tactemu.base.kernels import start_warp
    from tactemu.base.long_work import notices_to
    from tactemu.emulator.scenario import check_scenario, laws_needed
    from tactemu.scene import file
    from tactemu.scene.building import build_scene, build_simulation, make_devices

    if schema:
        print(json.dumps(file.json_schema(), indent=2))
        return
    if target is None:
        raise typer.BadParameter("name a device or a scene file, or ask for --schema", param_hint="DEVICE_OR_SCENE")
    loaded = file.load(target, code=code)
    devices = make_devices(loaded)
    check_scenario(loaded.tables.scenario, devices, loaded.source)
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
    start_warp()
    with notices_to(lambda text: print(f"{text}\n", flush=True)):
        simulation = build_simulation(scene, loaded, device=device)
    simulation.step()
    if cost:
        simulation.plan.time_stages(time.perf_counter_ns)
    print("Plan: the stages that this scene needs, with their time per step on this machine")
    print_fitted(*str(simulation.plan).splitlines())


def _print_bodies(loaded: LoadedScene) -> None:
    print("Bodies")
    for body in loaded.tables.body:
        motion = loaded.motions.get(body.name)
        how = "fixed" if body.fixed else motion.kind if motion else "moved from Python only"
        rough = "" if body.texture is None else f", textured by a {body.texture.kind}"
        print(f"  {body.name:<16} {body.shape:<9} {how}{rough}")
    print()


def _print_schedule(loaded: LoadedScene) -> None:
    if not loaded.tables.scenario:
        return
    print("Schedule")
    for event in sorted(loaded.tables.scenario, key=lambda event: event.at):
        said = event.model_dump(exclude_defaults=True, exclude={"at", "until", "skin"})
        until = "" if event.until is None else f" to {event.until:g} s"
        what = ", ".join(f"{name} = {value}" for name, value in said.items())
        print_fitted(f"  {event.at:g} s{until}  {event.skin or 'every skin'}: {what}")
    print()


def _print_skin(skin: SkinTable, device: Device, sensor: PlacedSkin | None) -> None:
    from tactemu.cli.datasheet import frame_page, ports_of, rates_of, taxel_map

    where = f"on {skin.link!r}" if skin.link else f"plays {skin.readings}"
    print_fitted(f"Skin {skin.title!r}: {device.title}, {where}")
    if sensor is not None:
        from tactemu.scene.building import model_name

        senses = ", ".join(s.key for s in device.sensed)
        print_fitted(f"  model     {model_name(skin, device)}: the device senses {senses}")
    print_fitted(f"  wire      {', '.join(ports_of(device))}", f"  rate      {rates_of(device, skin.rate_hz)}")
    for fault in skin.faults:
        print(f"  fault     {fault}")
    print("  frames")
    print_fitted(*(f"    {line}".rstrip() for line in frame_page(device, output_width() - 4)))
    lines = taxel_map(device.layout)
    print_fitted(*(f"  {line}".rstrip() for line in lines[:MAX_MAP_LINES]))
    if len(lines) > MAX_MAP_LINES:
        print(f"  … {len(lines) - MAX_MAP_LINES} more lines: `tactemu devices {skin.device}`")
    print()
