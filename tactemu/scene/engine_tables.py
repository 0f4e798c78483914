"""``[engine]`` of a scene file: which simulator moves the bodies, and its options."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, Strict

from tactemu.scene.table import Real, Table, one_of


class EngineTable(Table):
    """``[engine]``: a simulator that moves bodies of its own, which skins feel and may sit on."""

    file: str = Field(description="its model, by a path relative to the scene file")
    friction: Real | None = Field(
        default=None, ge=0, le=10, description="of all on all, in the model and for skins that know friction"
    )


class MujocoTable(EngineTable):
    """MuJoCo, live: motors of devices may move its joints, and skins may feel its forces."""

    kind: Literal["mujoco"] = "mujoco"
    felt: Literal["force", "overlap"] = Field(
        default="force",
        description="skins are pressed in until they feel the model's force, or as deep as its geoms overlap",
    )
    on_late: Literal["slow", "drop"] = Field(
        default="slow",
        description="slower than real time: the model falls behind the clock, or catches up and samples are dropped",
    )
    breaks: dict[str, Annotated[Real, Field(gt=0)]] = Field(
        default={}, description="geoms that are gone once something presses them harder than this [N]"
    )


class BatchTable(EngineTable):
    """What simulators of many environments have in common."""

    nconmax: Annotated[int, Strict()] | None = Field(
        default=None, ge=1, le=10_000, description="contacts of an environment that there is room for"
    )
    njmax: Annotated[int, Strict()] | None = Field(
        default=None, ge=1, le=100_000, description="constraints of an environment that there is room for"
    )

    @property
    def sizes(self) -> dict[str, int]:
        """Room for contacts and constraints, as far as it is chosen."""
        chosen = {"nconmax": self.nconmax, "njmax": self.njmax}
        return {name: size for name, size in chosen.items() if size is not None}


class MujocoWarpTable(BatchTable):
    """MuJoCo Warp: many environments on the scene's device; skins feel how deep geoms overlap."""

    kind: Literal["mujoco-warp"] = "mujoco-warp"


class NewtonTable(BatchTable):
    """Newton with its MuJoCo solver: many environments on the scene's device; skins feel how deep shapes overlap."""

    kind: Literal["newton"] = "newton"


ENGINES: dict[str, type[EngineTable]] = {
    "mujoco": MujocoTable,
    "mujoco-warp": MujocoWarpTable,
    "newton": NewtonTable,
}
"""Table of each ``kind``."""

if TYPE_CHECKING:
    AnyEngine = EngineTable
else:
    AnyEngine = one_of(ENGINES, "kind")
