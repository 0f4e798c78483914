"""Skins with parameters measured on real devices, from the files in ``measured/``, one for each device.

A file in a folder ``measured`` of the working directory, such as `tactemu compare` writes, comes before the package's
own. A file has keys of a scene's ``[[skin]]``, and its comments name their sources. A skin with ``measured = true``
keeps its own keys, also those within its options, clock and device options.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from tactemu.base.errors import SceneError, nearest
from tactemu.scene.schema import SkinTable

MEASURED_FOLDER = Path(__file__).parent / "measured"
"""The folder of the package's own files."""


def _files() -> dict[str, Path]:
    """Return the files by device."""
    folders = (MEASURED_FOLDER, Path("measured"))
    return {path.stem: path for folder in folders for path in folder.glob("*.toml")}


def measured_devices() -> list[str]:
    """Return the names of the devices with measured parameters."""
    return sorted(_files())


def measured_defaults(skin: SkinTable) -> SkinTable:
    """Return the skin with measured parameters for the keys that it does not have itself.

    Raises:
        SceneError: the device has no measured parameters, or they are for transducers that the skin's own lack.
    """
    known, where = measured_devices(), f"skin {skin.title!r}: measured"
    if skin.device not in known:
        hint = nearest(skin.device, known) or f" (devices: {', '.join(known)})"
        raise SceneError(f"{where}: there are no measured parameters of {skin.device!r}{hint}")
    found: dict[str, Any] = tomllib.loads(_files()[skin.device].read_text(encoding="utf-8"))
    own = skin.model_dump(by_alias=True, exclude_unset=True)
    needed, given = ([str(table.get("kind")) for table in tables.get("transducer", ())] for tables in (found, own))
    if given and not set(needed) <= set(given):
        raise SceneError(
            f"{where}: the parameters are for the transducers {', '.join(needed)}; add them, or give no transducer"
        )
    within = {key: {**found.get(key, {}), **own.get(key, {})} for key in ("device_options", "options", "clock")}
    return SkinTable.model_validate({**found, **own, **within})


def with_measured_defaults(skins: tuple[SkinTable, ...]) -> tuple[SkinTable, ...]:
    """Return all skins of a scene, with measured parameters for the devices that have them.

    Raises:
        SceneError: none of the devices has measured parameters.
    """
    if not any(skin.device in measured_devices() for skin in skins):
        raise SceneError(
            f"there are no measured parameters of {', '.join(s.device for s in skins)} "
            f"(devices: {', '.join(measured_devices())})"
        )
    return tuple(measured_defaults(skin) if skin.device in measured_devices() else skin for skin in skins)
