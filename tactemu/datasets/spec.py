"""What a dataset is asked to be, checked, and the file that says so beside its shards."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError
from tactemu.base.options import number
from tactemu.version import __version__

FILE = "dataset.json"
COMPRESSIONS = "lz4", "zstd", "none"
MOST_ENVS, MOST_STEPS = 10**6, 10**8
SHARD_BYTES = 256 * 2**20
"""Of a shard before compression, about."""


@dataclass(frozen=True, kw_only=True)
class DatasetSpec:
    """What is made. The same order makes the same shards, here or elsewhere."""

    target: str
    """A scene file or a device."""
    envs: int
    steps: int
    every: int = 1
    """Steps from one row of an environment to its next."""
    seed: int = 0
    device: str = "cpu"
    strands: int = 1
    """Parts of the environments that are simulated one after another, or side by side on a cluster."""
    bytes_envs: int = 16
    """Of the first so many environments what the wire says, too."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Bodies start displaced by up to so much along x, y and z, uniformly, in each environment differently."""
    turn_rad: float = 0.0
    """... and turned about z by up to so much."""
    compression: str = "lz4"

    def __post_init__(self):
        whole = {"envs": (1, MOST_ENVS), "steps": (1, MOST_STEPS), "every": (1, self.steps), "strands": (1, self.envs)}
        for name, (least, most) in (whole | {"bytes_envs": (0, self.envs), "seed": (-(2**63), 2**63 - 1)}).items():
            given = getattr(self, name)
            if not isinstance(given, int) or isinstance(given, bool) or not least <= given <= most:
                raise TactemuError(f"{name}: expected a whole number from {least} to {most}, got {given!r}")
        for name, value in (("shift", max(self.shift_m)), ("turn", self.turn_rad), ("shift", min(self.shift_m))):
            number("dataset", name, value, at_least=0, at_most=7)
        if self.compression not in COMPRESSIONS:
            raise TactemuError(f"compression: expected one of {', '.join(COMPRESSIONS)}, got {self.compression!r}")

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """The environments of each strand, ``(first, end)``."""
        return list(pairwise(self.envs * k // self.strands for k in range(self.strands + 1)))

    @property
    def rows(self) -> int:
        """Of each environment."""
        return self.steps // self.every


def remember(order: DatasetSpec, about: dict[str, Any], folder: Path) -> None:
    """Write what is made beside the shards, or check that it is what was begun there.

    Raises:
        TactemuError: the folder holds something else, or cannot be written.
    """
    said = json.loads(json.dumps({"tactemu": __version__, "order": asdict(order), **about}))
    path = folder / FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            if any(folder.iterdir()):
                raise TactemuError(f"{folder}: there are other files in it; give an empty folder, or a new one")
            path.write_text(json.dumps(said, indent=2) + "\n", encoding="utf-8")
            return
        before = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TactemuError(f"{path}: {error}") from None
    if changed := list(_changed(before, said)):
        raise TactemuError(f"{folder}: another dataset was begun there ({'; '.join(changed)}); give another folder")


def _changed(before: Any, now: Any, where: str = ""):
    """What differs, in words."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from _changed(before.get(key), now.get(key), f"{where}.{key}" if where else key)
    elif before != now:
        yield f"{where}: {before!r} then, {now!r} now"
