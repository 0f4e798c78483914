"""Bands that are kept in files, so that a large mesh is compared once; each is found by its mesh's hash.

The folder is ``~/.cache/tactemu/bands`` (``$XDG_CACHE_HOME`` moves it); the files used last stay, up to
:data:`MAX_BYTES`. A file that cannot be read, or holds something else, is built anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactemu.base.folders import cache_folder
from tactemu.geometry.shapes.band import Band
from tactemu.geometry.shapes.shape import Row

MAX_BYTES = 2**30
"""Maximum number of bytes of all files; those that were not used for the longest time are removed."""


def kept_band(row: Row, empty: Band, real: type) -> Band | None:
    """Return the band of a mesh from its file, or None.

    Args:
        row: the row of the mesh.
        empty: the band's grid, without its values.
        real: the type of the values.
    """
    path = _path(row, empty, real)
    try:
        with np.load(path, allow_pickle=False) as archive:
            nodes, smooth = archive["nodes"], archive["smooth"]
        os.utime(path)  # it was used last
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    shape = empty.smooth.shape
    if nodes.shape != (*shape, 4) or smooth.shape != shape or smooth.dtype != np.uint8 or nodes.dtype.kind != "f":
        return None
    return replace(empty, nodes=nodes, smooth=smooth)


def kept_bands() -> str:
    """Return where bands are kept, how many there are, and their size, for messages."""
    folder = cache_folder("bands")
    sizes = [path.stat().st_size for path in folder.glob("*.npz")]
    return f"{folder} ({len(sizes)} bands, {sum(sizes) / 2**20:.0f} of at most {MAX_BYTES / 2**20:.0f} MiB)"


def keep_band(row: Row, band: Band, real: type) -> None:
    """Write the band of a mesh to its file; nothing is kept if the folder cannot be written to."""
    path = _path(row, band, real)
    with contextlib.suppress(OSError):
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=".band-", suffix=".npz")
        try:
            with os.fdopen(descriptor, "wb") as file:
                np.savez(file, nodes=band.nodes, smooth=band.smooth)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
        _remove_oldest(path.parent)


def _path(row: Row, band: Band, real: type) -> Path:
    assert row.mesh is not None
    hashed = hashlib.sha256()
    for code in sorted(Path(__file__).parent.glob("*.py")):  # bands of another version are not used
        hashed.update(code.read_bytes())
    numbers = [*row.middle, row.mesh_unit, *band.origin, band.cell, band.tolerance, *band.smooth.shape]
    for part in (row.mesh.points.numpy(), row.mesh.indices.numpy(), np.array(numbers, float)):
        hashed.update(np.ascontiguousarray(part).tobytes())
    return cache_folder("bands") / f"{hashed.hexdigest()[:32]}-{real.__name__}.npz"


def _remove_oldest(folder: Path) -> None:
    files = sorted((path.stat().st_mtime_ns, path.stat().st_size, path) for path in folder.glob("*.npz"))
    total = sum(size for _, size, _ in files)
    for _, size, path in files[:-1]:
        if total <= MAX_BYTES:
            return
        path.unlink(missing_ok=True)
        total -= size
