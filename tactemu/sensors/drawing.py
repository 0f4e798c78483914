"""Options of how viewers draw a sensor; they change no reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactemu.base.errors import SceneError
from tactemu.base.option_groups import OptionGroup
from tactemu.base.options import numbers
from tactemu.base.units import Length, Share


@dataclass(frozen=True, kw_only=True, repr=False)
class DrawOptions(OptionGroup):
    """Options for viewers of a sensor. Names and defaults are those of Genesis."""

    draw_debug: bool = False
    """Draw its probes as spheres that change their colour in contact, and the points that it samples."""
    debug_probe_color: Sequence[float] = (0.2, 0.4, 1.0)
    """Colour of a probe without contact: red, green, blue in 0..1."""
    debug_contact_color: Sequence[float] = (1.0, 0.2, 0.0)
    """Colour of a probe in contact."""
    debug_probe_center_radius: Length = 0.0008
    """Radius of the opaque ball at a probe's position [m]."""
    debug_probe_sphere_opacity: Share = 0.3
    """Opacity of the ball around it, as large as its sensing radius, 0..1; 0 leaves it out."""
    debug_point_cloud_color: Sequence[float] = (1.0, 0.8, 0.0, 1.0)
    """Colour of the points sampled on bodies: red, green, blue and opacity in 0..1."""
    debug_point_cloud_radius: Length = 0.002
    """Radius of the balls at these points [m]."""


def check_drawing(where: str, options: DrawOptions) -> None:
    """Check the colours among the drawing options.

    Raises:
        SceneError: a colour is not valid.
    """
    for name, length in (("debug_probe_color", 3), ("debug_contact_color", 3), ("debug_point_cloud_color", 4)):
        colour = numbers(where, name, getattr(options, name))
        if colour.shape != (length,) or not ((colour >= 0) & (colour <= 1)).all():
            raise SceneError(f"{where}: {name} must be {length} numbers in 0..1, got {getattr(options, name)!r}")
