"""The events of a schedule: faults and changes at exact times (``[[scenario]]`` of a scene file)."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from tactemu.base.errors import SceneError
from tactemu.base.units import Number, Seconds, Whole
from tactemu.scene.table import Table
from tactemu.scene.validation_errors import list_errors
from tactemu.wire.faults import Fault, parse


def _known_fault(text: str) -> str:
    try:
        parse(text)
    except SceneError as error:
        raise ValueError(str(error).removeprefix("fault ")) from None
    return text


FaultText = Annotated[str, AfterValidator(_known_fault)]
"""A fault as text, which names a known one."""


def timed_fault(event: EventTable, now_s: float = 0.0) -> Fault:
    """Return the fault of an event, at its time after ``now_s``.

    Raises:
        ValueError: the fault has a time of its own, or two ends.
    """
    until = None if event.until is None else round((event.until + now_s) * 1e9)
    return parse(event.fault or "").scheduled(round((event.at + now_s) * 1e9), until)


class EventTable(Table):
    """An event of the schedule: a fault or a change while the scene runs."""

    at: Seconds = Field(default=0.0, description="time at which the event begins [s]")
    until: Seconds | None = Field(default=None, description="time at which the event ends [s]; default: it never ends")
    skin: str | None = Field(default=None, description="name of the skin; default: every skin")
    fault: FaultText | None = Field(default=None, description="a fault on the wire, as in `faults`")
    set: dict[str, Any] = Field(default={}, description="sensor options that change (noise, bias, gain ...)")
    taxels: tuple[Whole, ...] | None = Field(
        default=None, description="taxels whose options `set` changes; default: all"
    )
    dead: tuple[Whole, ...] = Field(default=(), description="taxels that become dead")
    value: Number | None = Field(default=None, description="reading of the dead taxels; default: their last reading")
    hang: bool = Field(default=False, description="the device neither samples nor answers until `until`")
    reset: bool = Field(default=False, description="the device restarts as after power-up")

    @model_validator(mode="after")
    def _does_something(self) -> Self:
        """Raise if the event does nothing, or if one of its keys has no effect."""
        if not (self.fault or self.set or self.dead or self.hang or self.reset):
            raise ValueError("the event does nothing; give it `fault`, `set`, `dead`, `hang` or `reset`")
        if self.until is not None and self.until <= self.at:
            raise ValueError(f"until: expected a time after at = {self.at} s, got {self.until}")
        if self.value is not None and not self.dead:
            raise ValueError("value: it is the reading of the taxels in `dead`; name them, too")
        if self.taxels is not None and not self.set:
            raise ValueError("taxels: they are those whose options `set` changes; give `set`, too")
        if self.hang and self.until is None:
            raise ValueError("hang: give its end with `until`")
        if self.fault:
            timed_fault(self)
        return self


class Event(EventTable):
    """An entry ``[[scenario]]`` of a scene file, made in Python: ``tt.Event(at=2, dead=(4,))``.

    Raises:
        SceneError: an event does not have a key, or a value does not fit.
    """

    def __init__(self, **entries: Any):
        try:
            super().__init__(**entries)
        except ValidationError as error:
            raise SceneError(list_errors(error, entries, "event")) from None
