"""Skins with the numbers of real ones, where recordings of such have told them: ``measured/``, a file for each device.

A file has keys of a scene's ``[[skin]]``, and in its comments what they stand on. A skin that asks for them keeps what
it says itself, key by key, and within its options, clock and device options likewise.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from tactemu.base.errors import SceneError, nearest
from tactemu.scene.schema import SkinTable

MEASURED_FOLDER = Path(__file__).parent / "measured"


def measured_devices() -> list[str]:
    """Those of which anything was measured."""
    return sorted(path.stem for path in MEASURED_FOLDER.glob("*.toml"))


def measured_defaults(skin: SkinTable) -> SkinTable:
    """Return the skin with numbers of real ones where it says nothing itself.

    Raises:
        SceneError: nothing was measured of its device, or its own transducers end in another unit than was measured in.
    """
    known, where = measured_devices(), f"skin {skin.title!r}: measured"
    if skin.device not in known:
        hint = nearest(skin.device, known) or f" (devices: {', '.join(known)})"
        raise SceneError(f"{where}: nothing was measured of a real {skin.device!r}{hint}")
    found: dict[str, Any] = tomllib.loads((MEASURED_FOLDER / f"{skin.device}.toml").read_text(encoding="utf-8"))
    own = skin.model_dump(by_alias=True, exclude_unset=True)
    needed, given = ([str(table.get("kind")) for table in tables.get("transducer", ())] for tables in (found, own))
    if given and not set(needed) <= set(given):
        raise SceneError(
            f"{where}: its numbers are of a skin that is {', '.join(needed)}; add that transducer, or none"
        )
    within = {key: {**found.get(key, {}), **own.get(key, {})} for key in ("device_options", "options", "clock")}
    return SkinTable.model_validate({**found, **own, **within})


def with_measured_defaults(skins: tuple[SkinTable, ...]) -> tuple[SkinTable, ...]:
    """Likewise all skins of a scene of which anything was measured.

    Raises:
        SceneError: none is.
    """
    if not any(skin.device in measured_devices() for skin in skins):
        raise SceneError(
            f"nothing was measured of {', '.join(s.device for s in skins)} (devices: {', '.join(measured_devices())})"
        )
    return tuple(measured_defaults(skin) if skin.device in measured_devices() else skin for skin in skins)
