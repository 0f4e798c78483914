"""The parts of a skin: all taxels of a device on the skin's link, or its links on bodies of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from firmware_protocols import Layout
from tactemu.base.errors import SceneError, no_such
from tactemu.scene.schema import LinkTable, SkinTable


@dataclass(frozen=True)
class SkinPart:
    """The taxels of one device on one body."""

    name: str
    """Name of the sensor."""
    layout: Layout
    """Layout of the taxels, in the frame that ``position`` and ``quaternion`` place on the body."""
    taxels: np.ndarray
    """Indices of the taxels in the device's layout."""
    links: tuple[str, ...]
    """The device's links in this part."""
    body: str
    """Name of the body."""
    position: tuple[float, float, float]
    """Position of the layout's frame on the body [m]."""
    quaternion: tuple[float, float, float, float]
    """Orientation of the layout's frame on the body."""


def parts_of(skin: SkinTable, layout: Layout) -> list[SkinPart]:
    """Return the parts of a skin, those on the skin's own link first.

    Raises:
        SceneError: the device has no such link.
    """
    for link in skin.links:
        if link not in layout.links:
            known = [name for name in layout.links if name]
            raise SceneError(f"skin {skin.title!r}: links: {skin.device} has {no_such('link', link, known)}")
    assert skin.link is not None
    on_skin_link = tuple(link for link in layout.links if link not in skin.links)
    parts = []
    if not skin.links:
        everything = np.arange(len(layout))
        return [SkinPart(skin.title, layout, everything, on_skin_link, skin.link, skin.position, skin.quaternion)]
    if on_skin_link:
        own, taxels = layout.on_links(on_skin_link)
        parts.append(SkinPart(skin.title, own, taxels, on_skin_link, skin.link, skin.position, skin.quaternion))
    for link, given in skin.links.items():
        place = LinkTable(body=given) if isinstance(given, str) else given
        own, taxels = layout.on_links((link,))
        own = replace(own, positions=own.positions - own.positions.mean(axis=0))
        name = f"{skin.title}/{link}"
        parts.append(SkinPart(name, own, taxels, (link,), place.body, place.position, place.quaternion))
    return parts
