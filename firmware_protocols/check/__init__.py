"""The check of a device against the contract: its declarations, its worked examples, and its behaviour in use.

It only calls the device, as a runner would; it opens no port. It cannot verify that the declarations are true of the
hardware (scale, above all): an unmodified driver can.

>>> from firmware_protocols.check import check
>>> print("\\n".join(check("anyskin").lines()))                        # doctest: +SKIP
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_protocols import registry
from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check import (
    converter,
    declarations,
    examples,
    flash,
    garbage,
    memory,
    order,
    other_process,
    requests,
    restarts,
    slopes,
    timing,
)  # fmt: skip
from firmware_protocols.check.host import Subject
from firmware_protocols.check.report import Fault, Report, distinct

__all__ = ["Fault", "Report", "check"]

FUZZ = 1000
"""The default number of corrupted requests."""


def check(
    target: str,
    options: Mapping[str, Any] | None = None,
    *,
    fuzz: int = FUZZ,
    quick: bool = False,
    progress: Callable[[str], None] = lambda part: None,
) -> Report:
    """Check a device and return its faults, worst first, and the declared facts that no example pins.

    Args:
        target: a registered name, or ``path/to/file.py:Class``.
        options: the device's options.
        fuzz: the number of corrupted requests.
        quick: leave out what takes most of the time: facts that no example pins, which taxel changes which bits,
            restarts, and the snapshot that another process restores.
        progress: is called with the name of each part before it runs.

    Raises:
        LookupError: there is no such device.
        ValueError: the device has no such option, or its value is invalid.
    """
    start = time.perf_counter()
    name = target.rpartition(":")[2] if ".py:" in target else target
    try:
        subject = Subject(target, registry.device_class(target), dict(options or {}))
        name = getattr(subject.cls, "name", name)
        baseline = restarts.Baseline(subject)
        _ = subject.commands
    except (LookupError, ValueError) as error:
        if isinstance(error, LookupError) or not _own_fault(error, target):
            raise
        return Report(name, (_at_import(target, error),), seconds=time.perf_counter() - start)
    except AuthorError as error:
        return Report(name, (Fault.of("power-up", error),), seconds=time.perf_counter() - start)
    except Exception as error:
        return Report(name, (_at_import(target, error),), seconds=time.perf_counter() - start)
    run = _Parts(subject, progress)
    found, unpinned, count = _run_all(subject, baseline, fuzz, quick, run)
    notes = () if found or quick else tuple(_notes(subject, count, run))
    return Report(name, distinct(found), tuple(unpinned), notes, count, time.perf_counter() - start)


def _run_all(
    subject: Subject, baseline: restarts.Baseline, fuzz: int, quick: bool, tried: _Parts
) -> tuple[list[Fault], list[str], int]:
    found = tried("declarations", lambda: declarations.faults(subject))
    # Restarts come early: other checks may leave state behind.
    state = [] if quick else tried("restart", lambda: restarts.faults(baseline))
    wrong = tried("converter", lambda: converter.faults(subject))
    wrong += tried("scale", lambda: slopes.faults(subject))
    tried.progress("examples")
    judged, unpinned, count = examples.judged(subject, mutations=not quick)
    found += wrong + judged + state
    # A device with faults is not saved: its report does not wait for a process, and other faults may follow from these.
    process, unsaved = (None, []) if found or quick else other_process.start(subject)
    found += tried("commands", lambda: requests.faults(subject, fuzz))
    found += tried("registers", lambda: memory.faults(subject))
    found += tried("registers after power-off", lambda: flash.faults(subject))
    found += tried("garbage", lambda: garbage.faults(subject))
    found += tried("timing", lambda: timing.faults(subject))
    if not quick and not any(fault.part in ("converter", "scale") for fault in wrong) and not baseline.why:
        found += tried("order", lambda: order.faults(subject))
    found += unsaved + (tried("restart", process.faults) if process else [])
    return found, [*unpinned, *([] if judged or quick else order.undocumented(subject))], count


def _notes(subject: Subject, count: int, tried: _Parts) -> Iterator[str]:
    """Yield what neither an example nor a check can pin."""
    tried.progress("notes")
    rates = [1e9 / period for period in subject.make().periods.values() if period]
    if rates and not any(each.rate_hz is not None for each in examples.examples_with(subject)):
        yield f"the rate, {', '.join(f'{rate:.4g}' for rate in rates)} a second: no example states rate_hz"
    yield from timing.described(subject)
    yield from garbage.described(subject)


@dataclass(frozen=True)
class _Parts:
    """The parts of a check of one device, run one by one."""

    subject: Subject
    progress: Callable[[str], None]

    def __call__(self, part: str, check: Callable[[], Iterable[Fault]]) -> list[Fault]:
        """Run a part and return its faults; an exception in it is a fault of the device, too."""
        self.progress(part)
        found: list[Fault] = []
        try:
            found.extend(check())
        except AuthorError as error:
            found.append(Fault.of(part, error))
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            text = f"{type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno}: {at.line})"
            found.append(Fault(part, text, *source_line(self.subject.cls)))
        return found


def _own_fault(error: Exception, target: str) -> bool:
    """Return True if the device's file raised the error when it was imported."""
    file = Path(target.rpartition(":")[0]).resolve()
    return any(Path(call.filename).resolve() == file for call in traceback.extract_tb(error.__traceback__))


def _at_import(target: str, error: Exception) -> Fault:
    """Return the fault of a file that does not import, or contains no device."""
    calls = traceback.extract_tb(error.__traceback__)
    file = target.rpartition(":")[0]
    own = next(
        (call for call in reversed(calls) if file and Path(call.filename).resolve() == Path(file).resolve()), None
    )
    if isinstance(error, SyntaxError):
        return Fault("import", f"{error.msg}: {(error.text or '').strip()}", error.filename or file, error.lineno or 0)
    return Fault(
        "import", f"{type(error).__name__}: {error}", own.filename if own else file, (own.lineno or 0) if own else 0
    )
