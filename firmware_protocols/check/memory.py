"""The check of registers: each reads its default, takes the ends of its range, and refuses numbers beyond them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, error_of_exception
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.registers import Memory, Refused, Reg, Registers


@dataclass(frozen=True)
class DeviceMemory:
    """The registers of a device, and the memory by which its protocols read and write them."""

    device: Device
    registers: Registers
    memory: Memory

    def call(self, method: str, *args: Any) -> Any:
        """Call ``read`` or ``write`` of the memory and return the result.

        Raises:
            Refused: the memory refused.
            AuthorError: the memory raised another exception.
        """
        try:
            return getattr(self.memory, method)(*args)
        except Refused:
            raise
        except Exception as error:
            raise error_of_exception(type(self.device), self.device.name, method, args, error) from error

    def read_all(self, t_ns: int) -> bytes:
        """Return the bytes of all readable registers, in order."""
        found = b""
        for reg in self.registers.table.rows:
            if "r" in reg.access:
                try:
                    found += self.call("read", reg.address, reg.end - reg.address, t_ns)
                except Refused:
                    continue
        return found

    def numbers(self, reg: Reg, t_ns: int) -> list[Any]:
        """Return the numbers that a host reads from a register."""
        data = self.call("read", reg.address, reg.end - reg.address, t_ns)
        return reg.decode(bytes(reg.address) + data)


def memory_of(device: Device) -> DeviceMemory | None:
    """Return the memory of a device; ``None`` if it has no :class:`Registers`, or several."""
    found = [value for value in vars(device).values() if isinstance(value, Registers)]
    if len(found) != 1:
        return None
    is_memory = callable(getattr(device, "read", None)) and callable(getattr(device, "write", None))
    return DeviceMemory(device, found[0], device if is_memory else found[0])  # type: ignore[arg-type]


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield registers that contradict their lines in the table."""
    if memory_of(subject.make()) is None:
        return
    for reg in _memory(subject)[1].registers.table.rows:
        try:
            yield from (
                Fault("registers", f"{reg.name} at {reg.address}: {text}") for text in _register_faults(subject, reg)
            )
        except AuthorError as error:
            yield Fault.of("registers", error, f"{reg.name} at {reg.address}: ")
        except Refused as refused:
            yield Fault(
                "registers", f"{reg.name} at {reg.address}: cannot be read ({refused.why}), declared {reg.access}"
            )


def _memory(subject: Subject) -> tuple[Host, DeviceMemory]:
    host = Host(subject.make())
    memory = memory_of(host.device)
    assert memory is not None
    return host, memory


def _register_faults(subject: Subject, reg: Reg) -> Iterator[str]:
    host, memory = _memory(subject)
    before = memory.numbers(reg, host.t_ns) if "r" in reg.access else None
    default = np.broadcast_to(np.asarray(reg.default, float), reg.count)
    may_differ = reg.name in host.device.options or (reg.flash and host.device.options)  # an option may set it
    if reg.access == "rw" and not may_differ and not np.allclose(before or [], default):
        yield f"reads {before} after power-up, declared default {reg.default}"
    if "w" not in reg.access:
        if _written(memory, reg, default, host.t_ns):
            yield "is declared read-only, but takes a write"
        return
    for value in reg.range if np.isfinite(reg.range).all() else ():
        host, memory = _memory(subject)
        if not _written(memory, reg, np.full(reg.count, value), host.t_ns):
            yield f"refuses {value:g}, which is in its declared range"
        elif before is not None and (now := memory.numbers(reg, host.t_ns)) not in ([value] * reg.count, before):
            yield f"reads {now} after {value:g} was written"
    for value in _beyond(reg):
        host, memory = _memory(subject)
        _written(memory, reg, np.full(reg.count, value), host.t_ns)
        low, high = reg.range
        if before is not None and not all(low <= n <= high for n in memory.numbers(reg, host.t_ns)):
            yield f"takes {value}, declared range {low:g} to {high:g}"


def _beyond(reg: Reg) -> list[int]:
    """Return numbers just beyond the range of a register that its type can hold."""
    if reg.type.endswith("f4") or reg.sign_bit is not None:
        return []
    kind = np.iinfo(np.dtype(reg.type))
    low, high = reg.range
    return [int(value) for value in (low - 1, high + 1) if kind.min <= value <= kind.max]


def _written(memory: DeviceMemory, reg: Reg, values: np.ndarray, t_ns: int) -> bool:
    numbers = values if reg.type.endswith("f4") else np.rint(values).astype(np.int64)
    if reg.sign_bit is not None:
        numbers = np.abs(numbers) | (numbers < 0).astype(np.int64) << reg.sign_bit
    try:
        memory.call("write", reg.address, numbers.astype(reg.type).tobytes(), t_ns)
    except Refused:
        return False
    return True
