"""The rehearsal of a device's state: a copy of the device is called in the way in which the loop calls the device."""

from __future__ import annotations

from collections.abc import Collection

from firmware_protocols import Device, calls
from firmware_protocols.check.readings import reading_of


def rehearse(copy: Device, streams: Collection[str], t_ns: int) -> None:
    """Let a copy with the state sample, answer every documented request, and wake.

    Raises:
        ValueError: the copy raises, or sends frames that its ports cannot carry.
    """
    if copy.periods.keys() != streams or min(copy.periods.values(), default=0) < 0:
        raise ValueError(f"periods: expected times of at least 0 ns of the streams {list(streams)}, got {copy.periods}")
    try:
        for stream in copy.periods:
            calls.measure(copy, reading_of(copy, stream=stream), t_ns)
            calls.transmissions(copy, "stream", t_ns, stream)
        if copy.wake_ns is not None:
            calls.transmissions(copy, "wake", t_ns)
        for command in copy.commands:
            port = command.port or copy.ports[0].name
            for stage in command.stages:
                calls.transmissions(copy, "receive", stage, t_ns, port, port=port)
    except calls.AuthorError as error:
        raise ValueError(f"cannot go on: {error}") from None
