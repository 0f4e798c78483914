"""Options that many devices have, for the annotations of their ``__init__``.

A device gives name and default; text, unit and bounds stand here::

    def __init__(self, *, gains: FieldGains = (1.0, 1.0, 1.0), sees: Sees = "force"): ...

An option whose text names something of one device stands in that device.
"""

from __future__ import annotations

from typing import Annotated, Literal

from firmware_protocols.options import Option

Vector = tuple[float, float, float]
"""Numbers along x, y and z."""
Tool = Annotated[Vector, Option("point of contact on the tool, from the sensor's origin", unit="m")]
"""The place at which a force-torque sensor's tool is touched."""
FieldGains = Annotated[
    Vector, Option("field per force along x, y and z of a magnetometer, z out of the skin", unit="uT/N")
]
"""The gains of magnets over magnetometers."""
Sees = Annotated[
    Literal["force", "field"], Option("force times `gains`, or the field that a transducer of the scene gives")
]
"""The quantity that a magnetometer measures in the simulation."""
HalfForce = Annotated[float, Option("normal force half way from rest to full scale", unit="N", low=1e-6)]
"""The force of a resistive taxel at half of its range."""
CountsPerNewton = Annotated[float, Option("scale of a taxel", unit="1/N", low=1e-6)]
"""The scale of a taxel that is linear."""
