"""The ``[engine]`` tables of a scene file: the simulator that moves the bodies, and its options."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from firmware_protocols.bounds import Bounds
from tactemu.base.units import Newtons
from tactemu.scene.table import Table, one_of


class EngineTable(Table):
    """``[engine]``: a simulator that moves bodies of its own, which press on skins and may carry them."""

    file: str = Field(description="path of the model, relative to the scene file")
    friction: Annotated[float, Bounds(low=0, high=10)] | None = Field(
        default=None,
        description="coefficient of friction between all bodies, in the model and for skins that simulate friction",
    )


class MujocoTable(EngineTable):
    """MuJoCo, live: motors of devices may move its joints, and skins may measure its contact forces."""

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


class BatchTable(EngineTable):
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

    kind: Literal["mujoco-warp"] = "mujoco-warp"


class NewtonTable(BatchTable):
    """Newton with its MuJoCo solver: many environments on the scene's device; skins measure how deep shapes overlap."""

    kind: Literal["newton"] = "newton"


ENGINES: dict[str, type[EngineTable]] = {
    "mujoco": MujocoTable,
    "mujoco-warp": MujocoWarpTable,
    "newton": NewtonTable,
}
"""The table of each ``kind`` of engine."""

if TYPE_CHECKING:
    AnyEngine = EngineTable
else:
    AnyEngine = one_of(ENGINES, "kind")
