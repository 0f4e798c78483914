"""The ``[engine]`` tables of a scene file: the simulator that moves the bodies, its options, and how it is opened."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from firmware_protocols.bounds import Bounds
from firmware_protocols.named_classes import NamedClasses, imported
from tactemu.base.errors import SceneError
from tactemu.base.own_code import load_class
from tactemu.base.units import Newtons
from tactemu.scene.table import Table, one_of

if TYPE_CHECKING:
    from tactemu.scene.engine_interface import Engine, JointMotors
    from tactemu.scene.scene import Scene


class EngineTable(Table):
    """``[engine]``: a simulator that moves bodies of its own, which press on skins and may carry them.

    The fields of a subclass are keys of the table. ``docs/scene-files.md`` shows an engine of your own.
    """

    moves_motors: ClassVar[bool] = False
    """True if the engine moves the motors of devices; a scene with ``joints`` is refused otherwise."""

    kind: Any = Field(description="name of the engine, or path/to/file.py:Class")  # a text, which subclasses narrow
    friction: Annotated[float, Bounds(low=0, high=10)] | None = Field(
        default=None,
        description="coefficient of friction between all bodies, in the model and for skins that simulate friction",
    )

    def open(self, scene: Scene, folder: Path, motors: Sequence[JointMotors]) -> Engine:
        """Add the engine's bodies to the scene, and return the engine.

        Args:
            scene: the scene, with the bodies of the scene file.
            folder: the folder of the scene file, which paths are relative to.
            motors: the motors of devices, if the engine moves them.
        """
        raise NotImplementedError


class ModelTable(EngineTable):
    """The keys of an engine that reads a model from a file."""

    opener: ClassVar[str]
    """The ``"module:function"`` that opens the engine, imported only when a scene needs it."""

    file: str = Field(description="path of the model, relative to the scene file")

    def open(self, scene: Scene, folder: Path, motors: Sequence[JointMotors]) -> Engine:
        """Open the engine by its opener.

        Raises:
            SceneError: the engine or a library that it needs is not installed, or it cannot read its model.
        """
        try:
            opener: Any = imported(self.opener)
        except ModuleNotFoundError as error:
            raise SceneError(f"engine: this installation has no engine of kind {self.kind!r} ({error})") from None
        return opener(self, scene, folder, motors)


class MujocoTable(ModelTable):
    """MuJoCo, live: motors of devices may move its joints, and skins may measure its contact forces."""

    moves_motors = True
    opener = "tactemu.engines.engine:open_engine"

    kind: Literal["mujoco"] = "mujoco"
    felt: Literal["force", "overlap"] = Field(
        default="force",
        description="skins are pressed in until they measure the model's force, or as deep as its geoms overlap",
    )
    on_late: Literal["slow", "drop"] = Field(
        default="slow",
        description="if MuJoCo is slower than real time: the model falls behind the clock, or catches up while samples "
        "are dropped",
    )
    breaks: dict[str, Newtons] = Field(
        default={}, description="geoms that disappear once a contact presses them harder than this [N]"
    )


class BatchTable(ModelTable):
    """The keys that simulators of many environments have in common."""

    nconmax: Annotated[int, Bounds(low=1, high=10_000)] | None = Field(
        default=None, description="most contacts in an environment"
    )
    njmax: Annotated[int, Bounds(low=1, high=100_000)] | None = Field(
        default=None, description="most constraints in an environment"
    )

    @property
    def sizes(self) -> dict[str, int]:
        """The capacities for contacts and constraints that the file gives."""
        chosen = {"nconmax": self.nconmax, "njmax": self.njmax}
        return {name: size for name, size in chosen.items() if size is not None}


class MujocoWarpTable(BatchTable):
    """MuJoCo Warp: many environments on the scene's device; skins measure how deep geoms overlap."""

    opener = "tactemu.engines.mujoco_warp_engine:open_engine"

    kind: Literal["mujoco-warp"] = "mujoco-warp"


class NewtonTable(BatchTable):
    """Newton with its MuJoCo solver: many environments on the scene's device; skins measure how deep shapes overlap."""

    opener = "tactemu.engines.newton_engine:open_engine"

    kind: Literal["newton"] = "newton"


ENGINES: dict[str, type[ModelTable]] = {
    "mujoco": MujocoTable,
    "mujoco-warp": MujocoWarpTable,
    "newton": NewtonTable,
}
"""The table of each ``kind`` of engine."""
REGISTRY = NamedClasses(
    "engine",
    "tactemu.engines",
    {name: f"{__name__}:{table.__name__}" for name, table in ENGINES.items()},
    f"{__name__}:{EngineTable.__name__}",
)
"""The engines of :data:`ENGINES`, of installed packages and of files."""


def _own_table(kind: str) -> type[EngineTable]:
    """Return the table of an engine of the user's own.

    Raises:
        SceneError: there is no such engine, or the file raises an error.
    """
    return load_class(REGISTRY, kind)


if TYPE_CHECKING:
    AnyEngine = EngineTable
else:
    AnyEngine = one_of(ENGINES, "kind", REGISTRY, _own_table)
