"""The check of registers that survive power-off: each is written, the device is powered off and on, and it is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from firmware_protocols.calls import AuthorError
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.memory import DeviceMemory, memory_of
from firmware_protocols.check.report import Fault
from firmware_protocols.registers import Refused, Reg

Step = Callable[[Host, DeviceMemory], None]
"""An action of a host before or after a write, such as an order to save."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield registers that are declared ``flash`` and forget what was written."""
    memory = memory_of(subject.make())
    if memory is None:
        return
    steps = list(_steps(subject, memory))
    known: list[tuple[Step, Step]] = []
    for reg in memory.registers.table.rows:
        if not reg.flash:
            continue
        try:
            if text := _lost(subject, reg, steps, known):
                yield Fault("registers", f"{reg.name} at {reg.address}: {text}")
        except AuthorError as error:
            yield Fault.of("registers", error, f"{reg.name} at {reg.address}: ")


def _lost(subject: Subject, reg: Reg, steps: list[Step], known: list[tuple[Step, Step]]) -> str:
    """Return how a register forgets what a host or a documented command wrote; empty if it does not."""
    for write in (_written, *(_commanded(k) for k in range(len(subject.commands)))):
        lost = _after_power_cycle(subject, reg, write, _nothing, _nothing)
        if lost is None:
            continue  # it cannot be written in this way
        if not lost:
            return ""
        ways = [*known, *((_nothing, step) for step in steps), *((step, _nothing) for step in steps)]
        for before, after in ways:
            if _after_power_cycle(subject, reg, write, before, after) == "":
                known.insert(0, (before, after))
                return ""
        return f"is declared flash, but {lost}: keep it, as in self.flash.update(self.registers.kept())"
    return ""


Write = Callable[[Host, DeviceMemory, Reg], str]
"""Changes a register and returns how; empty if it cannot."""


def _after_power_cycle(subject: Subject, reg: Reg, write: Write, before: Step, after: Step) -> str | None:
    """Return how a register differs from what was written; empty if it does not, ``None`` if it was not written."""
    host = Host(subject.make())
    memory = memory_of(host.device)
    assert memory is not None
    try:
        before(host, memory)
        how = write(host, memory, reg)
        wrote = memory.registers.all(reg.name)
        after(host, memory)
        host.restart()
    except (AuthorError, Refused):
        return None
    again = memory_of(host.device)
    if not how or again is None:
        return None
    now = again.registers.all(reg.name)
    return "" if now == wrote else f"reads {_short(now)} after a power cycle, {_short(wrote)} was written {how}"


def _written(host: Host, memory: DeviceMemory, reg: Reg) -> str:
    """Write another value by the memory of the device, if it has one of its own."""
    if "w" not in reg.access or memory.memory is memory.registers:
        return ""
    present, (low, high) = memory.registers.all(reg.name), reg.range
    for value in (low + 1, high - 1, high, low):
        if not np.isfinite(value) or low > value or value > high or [value] * reg.count == present:
            continue
        data = reg.encode([value] * reg.count)
        try:
            memory.call("write", reg.address, data, host.t_ns)
        except (Refused, AuthorError):
            continue
        if memory.registers.all(reg.name) != present:
            return "by a host"
    return ""


def _commanded(k: int) -> Write:
    """Return a function that sends a documented command, for a register that it changes."""

    def write(host: Host, memory: DeviceMemory, reg: Reg) -> str:
        command = _command(host, k)
        present = memory.registers.all(reg.name)
        host.ask(command)
        return f"by {command.name!r}" if memory.registers.all(reg.name) != present else ""

    return write


def _command(host: Host, k: int):
    return host.device.commands[k]


def _steps(subject: Subject, memory: DeviceMemory) -> Iterator[Step]:
    """Yield what may save registers or unlock them: other registers set to 0 or 1, and documented commands."""
    for reg in memory.registers.table.rows:
        if "w" in reg.access and not reg.flash and reg.count == 1 and reg.default in (0, 1) and reg.range[1] >= 1:
            yield from (_set(reg, value) for value in (1, 0))
    yield from (_send(k) for k in range(len(subject.commands)))


def _set(reg: Reg, value: int) -> Step:
    def step(host: Host, memory: DeviceMemory) -> None:
        memory.call("write", reg.address, reg.encode(value), host.t_ns)

    return step


def _send(k: int) -> Step:
    def step(host: Host, memory: DeviceMemory) -> None:
        host.ask(_command(host, k))

    return step


def _nothing(host: Host, memory: DeviceMemory) -> None:
    """Do nothing before or after a write."""


def _short(numbers: list) -> str:
    if len(numbers) == 1:
        return str(numbers[0])
    return f"{str(numbers[:4])[:-1]}, …]" if len(numbers) > 4 else str(numbers)
