"""The errors of tactemu. Each message names the place, the value, what was expected, and what to do.

::

    TactemuError
     ├── SceneError             a scene or an option is wrong; raised before any port opens
     ├── MeshError              a mesh that cannot be loaded or used
     ├── PoseError              a pose or twist that is not finite, or a quaternion of length zero
     ├── SourceError            a simulator of the user's own that raised, or returned unusable values
     ├── DeviceError            an unknown device, or one that does not fit its wire or its skin
     ├── StateError             a state that cannot be saved, or that is of another run
     └── TransportError         a port that cannot be made, or was lost
          └── TransportUnavailable   this machine lacks what the transport needs; the message names the fix

Bad bytes from a driver are no error: the device counts them and answers as the real firmware does.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable

from firmware_protocols.messages import nearest as nearest
from firmware_protocols.messages import shown as shown


def reason_of(error: Exception, path: str | os.PathLike | None = None) -> str:
    """Return the system's reason for an error, without the path, which pyserial repeats; else the error's own words.

    Args:
        error: the error.
        path: the file or folder that could not be written; the reason names its folder if there is none.
    """
    number = getattr(error, "errno", None)
    if number == errno.ENOENT and path is not None and not os.path.isdir(folder := os.path.dirname(path) or "."):
        return f"there is no folder {folder}; make it first"
    return os.strerror(number) if number else str(error)


def no_such(kind: str, name: object, known: Iterable[str], plural: str = "") -> str:
    """Return a message about an unknown name: ``"no skin 'tumb'; did you mean 'thumb'? (skins: thumb, palm)"``.

    Args:
        kind: what is named, ``"skin"``.
        name: the name.
        known: the known names.
        plural: the plural of ``kind``; default: with an s.
    """
    names = list(known)
    return f"no {kind} {shown(name)}{nearest(name, names)} ({plural or f'{kind}s'}: {', '.join(names) or 'none'})"


class TactemuError(Exception):
    """Base of all errors raised on purpose. The command line prints it and exits with 2."""


class SceneError(TactemuError):
    """A scene or an option is wrong."""


class MeshError(SceneError):
    """A mesh cannot be loaded or used."""


class PoseError(TactemuError):
    """A pose is not usable; the message names body, environment and step."""


class SourceError(TactemuError):
    """A simulator of the user's own has failed; the message names the time."""


class DeviceError(TactemuError):
    """An unknown device, or one that does not fit its wire or its skin."""


class StateError(TactemuError):
    """A state cannot be saved, or is of another run, or no state at all."""


class TransportError(TactemuError):
    """A port cannot be made or was lost."""


class TransportUnavailable(TransportError):
    """The machine lacks what the transport needs."""
