"""The arrows of the design: who may import whom, and what must stay light."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

LEAVES = ("errors", "firmware_protocols", "options", "random_streams", "version")
"""What everybody in tactemu may import."""

ARROWS = {
    # room (a package, or a file beside them): what of ours it may import, lowest first
    "firmware_protocols": (),
    "errors": (),
    "options": ("errors",),
    "random_streams": (),
    "version": (),
    "clock": (),
    "collector": (),
    "files": ("errors",),
    "folders": ("leftovers",),
    "kernels": ("folders",),
    "leftovers": (),
    "priority": ("errors",),
    "statistics": (),
    "plan": (),
    "sampling": LEAVES,
    "frame_text": ("firmware_protocols",),
    "truth": (*LEAVES, "frame_text", "leftovers"),
    "saving": (*LEAVES, "files"),
    "scene": LEAVES,
    "transports": (*LEAVES, "frame_text", "leftovers"),
    "imperfections": (*LEAVES, "plan"),
    "transducers": (*LEAVES, "plan"),
    "physics": (*LEAVES, "kernels", "plan", "imperfections", "scene", "transducers"),
    "units": (),
    "wire": (*LEAVES, "frame_text", "truth", "transports", "units"),
    "agenda": (),
    "calls": ("agenda",),
    "channel": (*LEAVES, "imperfections", "sampling", "scene", "statistics", "wire"),
    "emulator": (*LEAVES, "agenda", "calls", "channel", "clock", "plan", "saving", "transports", "truth", "wire"),
    "recordings": (*LEAVES, "agenda", "calls", "clock", "frame_text", "scene", "transports", "truth", "wire"),
    "conversions": (*LEAVES, "files", "frame_text", "recordings", "scene", "truth"),
    "scenario": (*LEAVES, "agenda", "channel", "emulator", "imperfections", "scene", "wire"),
    "sensing": (*LEAVES, "imperfections", "scene"),
    "plugging": (*LEAVES, "scene", "transports", "wire"),
    "sources": (*LEAVES, "physics", "scene"),
    "assembly": (
        *LEAVES, "channel", "clock", "emulator", "physics", "plugging", "recordings", "sampling", "scenario", "scene",
        "sensing", "sources", "transports", "truth", "wire",
    ),
    "fit": (*LEAVES, "physics", "scene", "transducers", "truth"),
    "datasets": (*LEAVES, "assembly", "clock", "files", "physics", "plan", "scene"),
    "tune": (*LEAVES, "assembly", "channel", "clock", "emulator", "physics", "plan", "scene"),
    "control": (
        *LEAVES, "assembly", "calls", "channel", "clock", "emulator", "folders", "recordings", "saving", "scenario",
        "scene", "transports", "truth", "units", "wire",
    ),
    "serving": (*LEAVES, "assembly", "clock", "control", "kernels", "physics", "scene", "truth"),
    "exec": (*LEAVES, "folders", "serving", "transports", "wire"),
    "judge": (
        *LEAVES, "clock", "frame_text", "recordings", "scene", "serving", "tactemu", "transports", "truth", "wire",
    ),
    "pytest_plugin": ("cli", "exec", "serving"),
    "page": (*LEAVES, "control", "conversions", "frame_text", "scene", "truth", "wire"),
    "doors": (*LEAVES, "serving"),
    "tactemu": (  # the public names, imported on first use
        "control", "datasets", "errors", "exec", "physics", "scene", "serving", "truth", "version",
    ),
    "bench": (
        *LEAVES, "assembly", "clock", "collector", "control", "emulator", "exec", "fit", "judge", "kernels",
        "physics", "plan", "priority", "scene", "serving", "statistics", "tactemu", "transducers", "transports",
        "truth", "tune", "wire",
    ),
    "cli": (
        *LEAVES, "assembly", "bench", "channel", "clock", "collector", "control", "conversions", "datasets", "emulator",
        "exec", "files", "fit", "frame_text", "judge", "leftovers",
        "kernels", "page", "priority", "recordings", "scenario", "scene", "serving", "statistics", "tactemu",
        "transports", "truth", "tune", "wire",
    ),
    "__main__": ("cli",),
}  # fmt: skip

FACADES = {
    # scene is data and physics computes with it; only these look up
    "scene/scene.py": ("physics", "plan", "transducers"),  # build(): from the data to what computes
    "scene/building.py": ("physics", "transducers"),  # models, shapes and transducers by their names
    "scene/file.py": ("physics",),  # the table of the models' names
    "scene/bodies.py": ("physics",),  # what a shape is
    "scene/schema.py": ("physics",),  # the keys of each shape
    "scene/description.py": ("physics",),  # a built scene
    "scene/placement.py": ("physics", "imperfections"),  # a built sensor on its link
    "scene/mujoco_source.py": ("physics",),  # poses a built scene
    "scene/engine_registry.py": ("physics",),  # the type of a built sensor
    "scene/engine.py": ("physics",),  # likewise, at each of its steps
    "scene/batch_engine.py": ("physics", "plan"),  # likewise, as a stage of its plan
    "scene/mujoco_warp_engine.py": ("physics",),
    "scene/newton_engine.py": ("physics",),
    "scene/newton_source.py": ("physics",),
    "scene/mujoco_contacts.py": ("physics",),  # what a built sensor feels
}
FOREIGN = {
    "firmware_protocols": ("tactemu", "warp", "trimesh", "can", "serial"),
    "physics": ("time",),
}
"""What of others' a room must not import."""


def imported_modules(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == "tactemu":
            found |= {f"tactemu.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module}
    return found


def room_of(module: str) -> str | None:
    """``tactemu.sensors.sensor`` lives in ``physics``; ``None``: in nobody's room, it is not ours."""
    package, _, rest = module.partition(".")
    if package == "tactemu":
        return rest.partition(".")[0] or "tactemu"
    return package if package == "firmware_protocols" else None


def files_of(room: str) -> list[Path]:
    if room in ("firmware_protocols", "tactemu"):
        return list((ROOT / room).rglob("*.py")) if room == "firmware_protocols" else [ROOT / "tactemu/__init__.py"]
    package = ROOT / "tactemu" / room
    return list(package.rglob("*.py")) if package.is_dir() else [package.with_suffix(".py")]


@pytest.mark.parametrize("room", ARROWS)
def test_arrows_point_one_way(room):
    for path in files_of(room):
        modules = imported_modules(path)
        name = str(path.relative_to(ROOT / "tactemu")) if path.is_relative_to(ROOT / "tactemu") else path.name
        allowed = {room, *ARROWS[room], *FACADES.get(name, ())}
        assert {found for module in modules if (found := room_of(module))} <= allowed, name
        assert not {module.partition(".")[0] for module in modules} & set(FOREIGN.get(room, ())), name


def test_every_room_has_its_row():
    files = [path for path in (ROOT / "tactemu").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    rooms = {"tactemu" if path.stem == "__init__" else path.stem for path in files}
    assert rooms | {"firmware_protocols"} == set(ARROWS)


def test_no_row_leads_back_to_itself():
    list(TopologicalSorter(ARROWS).static_order())  # raises a CycleError that names the ring


def test_every_exception_is_needed():
    for name, rooms in FACADES.items():
        assert set(rooms) <= {room_of(module) for module in imported_modules(ROOT / "tactemu" / name)}, name


def test_no_file_leads_back_to_itself():
    """Imports for types alone and those inside functions count: who reads a file reads what it names."""
    files = {path for package in ("tactemu", "firmware_protocols") for path in (ROOT / package).rglob("*.py")}
    name_of = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files}
    modules = {name.removesuffix(".__init__"): path for path, name in name_of.items()}
    arrows = {}
    for path in files - {ROOT / "tactemu/__init__.py"}:
        found = {modules.get(module) or modules.get(module.rpartition(".")[0]) for module in imported_modules(path)}
        arrows[path] = {other for other in found if other and other != path and other.name != "__init__.py"}
    list(TopologicalSorter(arrows).static_order())


@pytest.mark.parametrize("statement", ["import firmware_protocols", "import tactemu"])
def test_imports_stay_light(statement):
    code = f"import sys; {statement}; print([m for m in ('warp', 'trimesh', 'can') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert out.stdout.strip() == "[]"
