"""The base class of all tables of a scene file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Union

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from tactemu.base.errors import nearest


class Table(BaseModel):
    """A table of a scene file. An unknown key is an error that names the nearest known key."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            for key in data:
                if key not in known:
                    hint = nearest(key, known) or f"; it has: {', '.join(known)}"
                    raise ValueError(f"unknown key {key!r}{hint}")
        return data


def one_of(tables: Mapping[str, type[Table]], key: str) -> Any:
    """Return the annotation of a table that is one of several, chosen by the value of its ``key``."""

    def known(data: Any) -> Any:
        given = data.get(key) if isinstance(data, dict) else None
        if isinstance(data, dict) and (not isinstance(given, str) or given not in tables):
            problem = f"unknown {key} {given!r}{nearest(given, tables)}" if key in data else f"missing key {key!r}"
            raise ValueError(f"{problem} ({key}s: {', '.join(tables)})")
        return data

    one = Annotated[Union[tuple(tables.values())], Field(discriminator=key)]  # noqa: UP007
    return Annotated[one, BeforeValidator(known)]
