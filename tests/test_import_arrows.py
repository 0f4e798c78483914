"""The arrows of the design: who may import whom, and what must stay light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "firmware_protocols": ("tactemu", "warp", "trimesh", "can", "serial"),
    "tactemu/physics": ("firmware_protocols", "tactemu.transports", "tactemu.wire", "tactemu.emulator", "time"),
    "tactemu/transports": ("tactemu.physics", "tactemu.scene", "tactemu.emulator", "tactemu.imperfections"),
}


def imported_modules(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("package", FORBIDDEN)
def test_arrows_point_one_way(package):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        for module in imported_modules(path):
            for bad in FORBIDDEN[package]:
                assert module != bad and not module.startswith(bad + "."), f"{path.relative_to(ROOT)} imports {module}"


@pytest.mark.parametrize("statement", ["import firmware_protocols", "import tactemu"])
def test_imports_stay_light(statement):
    code = f"import sys; {statement}; print([m for m in ('warp', 'trimesh', 'can') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert out.stdout.strip() == "[]"
