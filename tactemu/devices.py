"""The face for devices of your own: the public names that such a file imports, all of :mod:`firmware_protocols`.

>>> from tactemu.devices import Device, create
>>> isinstance(create("anyskin"), Device)
True

A device needs nothing of the simulation: a file that imports the same names from :mod:`firmware_protocols` works with
that package alone, as the two of ``docs/adding-a-device.md`` do. Import from a face, never from the modules below it,
which may change in every version (``docs/versions.md``). The names that run a device (``serve``) are in :mod:`tactemu`.
"""

from firmware_protocols import *  # noqa: F403
from firmware_protocols import __all__ as __all__
