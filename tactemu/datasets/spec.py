"""The specification of a dataset, its checks, and its file beside the shards."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import TactemuError, no_such, reason_of
from tactemu.base.options import number
from tactemu.version import __version__

FILE = "dataset.json"
COMPRESSIONS = "lz4", "zstd", "none"
MAX_ENVS = 10**6
"""Maximum number of environments; file names have six digits for them."""
MAX_STEPS = 10**8
"""Maximum number of steps; file names have eight digits for row numbers."""
SHARD_BYTES = 256 * 2**20
"""Approximate size of a shard before compression [byte]."""


@dataclass(frozen=True, kw_only=True)
class DatasetSpec:
    """The specification of a dataset. Equal specifications generate equal shards on every machine."""

    target: str
    """A scene file or a device."""
    envs: int
    steps: int
    every: int = 1
    """Steps from one row of an environment to its next."""
    seed: int = 0
    device: str = "cpu"
    partitions: int = 1
    """Number of partitions of the environments, simulated one after another, or in parallel on a cluster."""
    bytes_envs: int = 16
    """Number of environments, from the first, of which the wire log is written too."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Maximum displacement of start positions along x, y and z [m], drawn uniformly for each environment."""
    turn_rad: float = 0.0
    """Maximum rotation of start poses about z [rad], drawn uniformly for each environment."""
    compression: str = "lz4"

    def __post_init__(self):
        limits = {
            "envs": (1, MAX_ENVS),
            "steps": (1, MAX_STEPS),
            "every": (1, self.steps),
            "partitions": (1, self.envs),
        }
        for name, (least, most) in (limits | {"bytes_envs": (0, self.envs), "seed": (-(2**63), 2**63 - 1)}).items():
            given = getattr(self, name)
            if not isinstance(given, int) or isinstance(given, bool) or not least <= given <= most:
                raise TactemuError(f"{name}: expected a whole number from {least} to {most}, got {given!r}")
        for name, value in (("shift", max(self.shift_m)), ("turn", self.turn_rad), ("shift", min(self.shift_m))):
            number("dataset", name, value, Annotated[float, Bounds(low=0, high=7)])
        if self.compression not in COMPRESSIONS:
            raise TactemuError(no_such("compression", self.compression, COMPRESSIONS))

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """The environments of each partition, ``(first, end)`` with ``end`` exclusive."""
        return list(pairwise(self.envs * k // self.partitions for k in range(self.partitions + 1)))

    @property
    def rows(self) -> int:
        """The number of rows of each environment."""
        return self.steps // self.every


def write_spec(spec: DatasetSpec, about: dict[str, Any], folder: Path) -> None:
    """Write the specification beside the shards, or check that it equals the one that is there.

    Raises:
        TactemuError: the folder holds something else, or cannot be written.
    """
    content = json.loads(json.dumps({"tactemu": __version__, "order": asdict(spec), **about}))
    path = folder / FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            if any(folder.iterdir()):
                raise TactemuError(f"{folder}: there are other files in it; name an empty folder or a new one")
            path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
            return
        before = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TactemuError(f"{path}: {reason_of(error, path)}") from None
    if changed := list(_changed(before, content)):
        raise TactemuError(f"{folder}: another dataset was begun there ({'; '.join(changed)}); name another folder")


def _changed(before: Any, now: Any, where: str = ""):
    """Yield each difference between two JSON values as text."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from _changed(before.get(key), now.get(key), f"{where}.{key}" if where else key)
    elif before != now:
        yield f"{where}: {before!r} then, {now!r} now"
