"""The base class of all tables of a scene file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Union

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from firmware_protocols.named_classes import NamedClasses, beside
from tactemu.base import words
from tactemu.base.errors import SceneError, shown


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
                    hint = words.hint(key, known) or f"; it has: {', '.join(known)}"
                    raise ValueError(f"unknown key {key!r}{hint}")
            for name, field in cls.model_fields.items():
                given = data.get(field.alias or name, False)
                if field.annotation is bool and not isinstance(given, bool):  # pydantic would also take "yes" and 1
                    raise ValueError(f"{name} must be true or false, got {shown(given)}")
        return data


def placed(name: str, info: ValidationInfo) -> str:
    """Return a name of a registry, with the path of a file taken relative to the scene file's folder."""
    folder: Path | None = (info.context or {}).get("folder")
    return name if folder is None else beside(name, folder)


ClassName = Annotated[str, AfterValidator(placed)]
"""A name of a registry. The path of ``path/to/file.py:Class`` is relative to the scene file, and once it is checked to
the working directory.
"""


def one_of(
    tables: Mapping[str, type[Table]], key: str, registry: NamedClasses, own: Callable[[str], type[Table]]
) -> Any:
    """Return the annotation of a table that is one of several, chosen by the value of its ``key``.

    Args:
        tables: the tables of this package, by name.
        key: the key with the name.
        registry: the classes that the names denote.
        own: the function that returns the table of a class of a user's own, by name.
    """

    def known(data: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        given = data.get(key) if isinstance(data, dict) else None
        if not isinstance(data, dict) or (isinstance(given, str) and given in tables):
            return handler(data)
        if not isinstance(given, str) or not registry.knows(given):
            hint = (
                registry.unknown(given, tables) if key in data else f"missing key {key!r} ({key}s: {', '.join(tables)})"
            )
            raise ValueError(hint)
        name = placed(given, info)
        try:
            table = own(name)
        except SceneError as error:
            raise ValueError(str(error)) from None
        return table.model_validate({**data, key: name}, context=info.context)

    one = Annotated[Union[tuple(tables.values())], Field(discriminator=key)]  # noqa: UP007
    return Annotated[one, WrapValidator(known)]


def tables_of(header: str) -> BeforeValidator:
    """Return the check of an array of tables, which refuses a single table: brackets are missing in the file."""

    def check(tables: Any) -> Any:
        if isinstance(tables, dict):
            raise ValueError(f"write [[{header}]] instead of [{header}]: there may be several")
        return tables

    return BeforeValidator(check)


def not_empty(tables: Any) -> Any:
    """Return tables of skins, of which there must be one."""
    if tables in ([], ()):
        raise ValueError("expected one [[skin]] or more")
    return tables
