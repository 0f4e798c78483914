"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def _targets(incomplete: str) -> list[str]:
    """What a shell offers for a target: devices, and scene files here."""
    from firmware_protocols import names

    found = [*names(), *map(str, Path().glob("*.toml"))]
    return [each for each in found if each.startswith(incomplete)]


Target = Annotated[
    str,
    typer.Argument(
        metavar="DEVICE_OR_SCENE",
        help="A device's name, path/to/device.py:Class, or scene.toml.",
        autocompletion=_targets,
    ),
]
Options = Annotated[
    list[str] | None,
    typer.Argument(metavar="[OPTION=VALUE]...", help="Options of a device; `tactemu devices NAME` lists them."),
]
Ports = Annotated[
    list[str] | None,
    typer.Option(
        "--port",
        metavar="PORT",
        help="pty:PATH, can:INTERFACE:CHANNEL, HOST:PORT behind tcp:, rfc2217:, udp: or ws:, dds:DOMAIN or memory:; "
        "of several skins SKIN=PORT, repeatable.",
    ),
]
Rates = Annotated[
    list[str] | None,
    typer.Option(
        "--rate",
        metavar="HZ",
        help="Sampling rate; default: the device's own. Of a device with several streams --rate STREAM=HZ; repeatable.",
    ),
]


def _seconds(text: str, option: str = "--seconds") -> float:
    from tactemu.base.options import number
    from tactemu.geometry.limits import MAX_TIME_S

    try:
        given: float | str = float(text)
    except ValueError:
        given = text
    return number("command line", option, given, at_least=0, at_most=MAX_TIME_S, unit="s")


def _save_at(text: str) -> float:
    return _seconds(text, "--save-at")


Seconds = Annotated[float | None, typer.Option("--seconds", metavar="S", parser=_seconds, help="Stop after this long.")]
Seed = Annotated[int | None, typer.Option(metavar="N", help="Root of all random numbers; same seed, same bytes.")]
Compute = Annotated[str | None, typer.Option("--device", metavar="DEV", help="Where kernels run: cpu or cuda:0.")]
Faults = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="FAULT", help="What goes wrong on the wire; repeatable. See `tactemu faults`."),
]

Measured = Annotated[
    bool,
    typer.Option("--measured", help="Noise, clock and so on as of real ones, where such were measured."),
]
TruthFile = Annotated[
    Path | None,
    typer.Option(
        "--truth", metavar="FILE", help="Write what was felt, sent and injected: .mcap, or .jsonl for JSON lines."
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
    typer.Option("--name", metavar="NAME", help="For `tactemu poke --name`; default: the target's."),
]

WebPort = Annotated[
    int | None,
    typer.Option("--web-port", metavar="N", min=0, max=65535, help="Of the live page; default: 8080, if it is free."),
]
WebHost = Annotated[
    str | None,
    typer.Option("--web-host", metavar="ADDRESS", help="Let others reach the live page; default: only this machine."),
]
SaveAt = Annotated[float | None, typer.Option(metavar="S", parser=_save_at, help="When to save it instead [s], once.")]
