"""The arguments and options of several commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from tactemu.base import formats


def _targets(incomplete: str) -> list[str]:
    """Return the completions of a target: devices, and scene files in this folder."""
    from firmware_protocols import names

    found = [*names(), *map(str, Path().glob("*.toml"))]
    return [each for each in found if each.startswith(incomplete)]


Target = Annotated[
    str,
    typer.Argument(
        metavar="DEVICE_OR_SCENE",
        help="A name of `tactemu devices`, path/to/device.py:Class, or scene.toml.",
        autocompletion=_targets,
    ),
]
Options = Annotated[
    list[str] | None,
    typer.Argument(metavar="OPTION=VALUE", help="Options of the device; `tactemu devices NAME` lists them."),
]
Ports = Annotated[
    list[str] | None,
    typer.Option(
        "--port",
        metavar="PORT",
        help="Port for the driver, such as pty:PATH, tcp:HOST:PORT or can:INTERFACE:CHANNEL. With several skins give "
        "SKIN=PORT for each; repeatable.",
    ),
]
Rates = Annotated[
    list[str] | None,
    typer.Option(
        "--rate",
        metavar="HZ",
        help="Sampling rate; default: the device's own. With several streams give --rate STREAM=HZ; repeatable.",
    ),
]


def quantity_of(option: str, kind: str = "Seconds", **bounds: float) -> Callable[[str | float], float]:
    """Return the reader of an option that is a duration or a rate, as :func:`tactemu.cli.words.quantity` reads it."""

    def read(text: str | float) -> float:
        from tactemu.cli.words import quantity

        return quantity(option, text, kind, **bounds)

    return read


Seconds = Annotated[
    float | None,
    typer.Option("--seconds", metavar="S", parser=quantity_of("--seconds"), help="Stop after this long."),
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="Seed of all random numbers; same seed, same bytes.")]
Compute = Annotated[
    str | None,
    typer.Option(
        "--device", metavar="DEV", help="Where kernels run: cpu or cuda:0; default: the scene's `compute`, else cpu."
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="FAULT", help="A fault on the wire; repeatable. `tactemu faults` lists them."),
]

Measured = Annotated[
    bool,
    typer.Option("--measured", help="Use the noise, clock and other imperfections measured on real devices, if any."),
]
TruthFile = Annotated[
    Path | None,
    typer.Option(
        "--truth",
        metavar="FILE",
        help=f"Write a log of readings, frames and faults: {formats.names(formats.LOGS, dot='.')}.",
    ),
]
TruthKeep = Annotated[
    str | None,
    typer.Option(
        "--truth-keep", metavar="SIZE", help="Memory for samples and frames; default: the scene's, else 256MB."
    ),
]

RunName = Annotated[
    str | None,
    typer.Option("--name", metavar="NAME", help="Name of the run for `tactemu poke` and `see`; default: the target's."),
]

WebPort = Annotated[
    int | None,
    typer.Option(
        "--web-port", metavar="N", min=0, max=65535, help="Port of the live page; default: 8080, or any free one."
    ),
]
WebHost = Annotated[
    str | None,
    typer.Option(
        "--web-host", metavar="ADDRESS", help="Address of the live page, to let others reach it; default: this machine."
    ),
]
SaveAt = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        parser=quantity_of("--save-at"),
        help="Save the state at this time [s] instead of the end.",
    ),
]
