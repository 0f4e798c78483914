"""The options of a command with many, listed in sections of its help."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from typer.core import TyperCommand


def in_sections(sections: Mapping[str, str]) -> type[TyperCommand]:
    """Return the class of a command whose help lists its options in sections.

    Args:
        sections: the names of the parameters in each, by its title; those of none come last.
    """
    places = {name: title for title, names in sections.items() for name in names.split()}

    class Sectioned(TyperCommand):
        """A command with sections of options."""

        def format_options(self, ctx: Any, formatter: Any) -> None:
            """Write the arguments and each section."""
            rows: dict[str, list] = {title: [] for title in ("Arguments", *sections, "Other options")}
            for param in self.get_params(ctx):
                record = param.get_help_record(ctx)
                if record is not None:
                    is_option = param.param_type_name == "option"
                    title = places.get(param.name or "", "Other options") if is_option else "Arguments"
                    rows[title].append(record)
            for title, found in rows.items():
                if found:
                    with formatter.section(title):
                        formatter.write_dl(found)

    return Sectioned
