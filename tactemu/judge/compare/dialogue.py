"""The dialogue with a real sensor: it is listened to, asked, and pressed; all of it ends up in the capture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from firmware_protocols import CanFrame, Command, Device
from firmware_protocols.frames import payload
from tactemu.judge.compare.asking import CAN_HEAD_BYTES, stages_of
from tactemu.judge.compare.link import Link
from tactemu.judge.compare.model import Answer, Model
from tactemu.judge.compare.presses import Press, place_of

ROUNDS = 6
"""Number of times that each command is sent, in turn, so that a busy moment hits none of them each time."""
READING_ROUNDS = 30
"""Number of further times that commands with readings are sent."""
LATE_ROUNDS = 4
"""Number of times that commands with late answers are looked for."""
LATE_TRIES = 8
"""Number of times that each of them is then sent."""
MAX_LATE = 20
"""Largest number of such commands."""
MAX_ASKING_S = 90.0
"""Longest time for all commands; further rounds are left out [s]."""
SILENCE_S = 0.15
"""Time for an answer where the model is silent [s]."""
PATIENCE_S = 0.6
"""Time for an answer beyond the model's, for a busy machine [s]."""
LAST_PATIENCE_S = 2.0
"""The same in the last try of a command that was not answered yet [s]."""
QUIET_S = 0.02
"""Time after an answer for what may follow it [s]."""


@dataclass
class Dialogue:
    """A dialogue over one link.

    Args:
        link: the line.
        model: the model; its answers say how long to wait.
        progress: is called with what is being done.
    """

    link: Link
    model: Model
    progress: Callable[[str], object] = lambda text: None

    def listen(self, seconds: float) -> None:
        """Receive without sending anything."""
        begun_ns = self.link.now_ns
        end_ns = begun_ns + round(seconds * 1e9)
        while self.link.now_ns < end_ns and not self.link.is_over:
            self.link.receive(min(end_ns, self.link.now_ns + 250_000_000))
            passed_s = (self.link.now_ns - begun_ns) * 1e-9
            self.progress(f"listening: {passed_s:.0f} of {seconds:g} s, {self.link.kept_bytes} bytes")

    def ask_all(self, commands: Sequence[Command]) -> None:
        """Send all commands in rounds, and those with readings more often."""
        end_ns = self.link.now_ns + round(MAX_ASKING_S * 1e9)
        answered: set[str] = set()
        for k in range(ROUNDS):
            for command in commands:
                is_last = k == ROUNDS - 1 and command.name not in answered
                if (self.link.now_ns > end_ns and k > 1) or self.link.is_over:
                    return
                self.progress(f"asking, round {k + 1} of {ROUNDS}: {command.name}")
                if self.ask(command, LAST_PATIENCE_S if is_last else PATIENCE_S):
                    answered.add(command.name)
        readings = [each for each in commands if self._reads(each) and each.name in answered]
        for k in range(READING_ROUNDS):
            for command in readings:
                if self.link.now_ns > end_ns or self.link.is_over:
                    return
                self.progress(f"reading, {k + 1} of {READING_ROUNDS}: {command.name}")
                self.ask(command, PATIENCE_S)

    def ask_again(self, late: Callable[[], Sequence[Command]]) -> None:
        """Send commands again whose answers were all late: a busy machine delays some, a late sensor all."""
        for k in range(LATE_ROUNDS):
            commands = late()
            if not commands:
                return
            for _ in range(LATE_TRIES):
                for command in commands[:MAX_LATE]:
                    if self.link.is_over:
                        return
                    self.progress(f"asking again, {k + 1} of {LATE_ROUNDS}: {command.name}")
                    self.ask(command, PATIENCE_S)

    def _reads(self, command: Command) -> bool:
        made = self.model.answers[command.name].made
        return made is not None and bool(made.numbers)

    def ask(self, command: Command, patience_s: float) -> bool:
        """Send a command once, wait for its answer, and return True if anything came."""
        answer = self.model.answers[command.name]
        before, last = stages_of(command)
        for request in before:
            self.link.send(request)
            self.link.receive(self.link.now_ns + round((QUIET_S + 0.05) * 1e9))
        at = len(self.link.entries) + 1
        sent_ns = self.link.now_ns
        self.link.send(last)
        if answer.made is None:
            self.link.receive(sent_ns + round(SILENCE_S * 1e9))
        elif self.model.unasked:
            self.link.receive(sent_ns + round((answer.wait_s[1] + 0.06) * 1e9))
        else:
            wanted = self._size_of(answer)
            until_ns = sent_ns + round((answer.wait_s[1] + patience_s) * 1e9)
            self.link.receive(until_ns, lambda: self._received(at) >= wanted)
        self.link.receive(self.link.now_ns + round(QUIET_S * 1e9))
        return len(self.link.entries) > at

    @staticmethod
    def _size_of(answer: Answer) -> int:
        """Return the least number of bytes of an answer without the heads of CAN frames."""
        assert answer.made is not None
        heads = CAN_HEAD_BYTES * answer.frames if isinstance(answer.command.frame, CanFrame) else 0
        return answer.made.sizes[0] - heads

    def _received(self, at: int) -> int:
        return sum(len(payload(entry.frame)) for entry in self.link.entries[at:])

    def press(self, device: Device, taxels: Sequence[int], seconds: float, say: Callable[[str], object]) -> list[Press]:
        """Have the user press taxels one after the other, each for some seconds, and return when."""
        presses = []
        readings = [each for each in (a.command for a in self.model.answers.values()) if self._reads(each)]
        for k, taxel in enumerate(taxels):
            if self.link.is_over:
                break
            say(f"{k + 1} of {len(taxels)}: press {place_of(device, taxel)}, and hold it for {seconds:g} s")
            begin_ns = self.link.now_ns
            self._read_for(seconds, readings)
            presses.append(Press(taxel, begin_ns * 1e-9, self.link.now_ns * 1e-9))
            say("   let go")
            self._read_for(seconds / 2, readings)
        return presses

    def _read_for(self, seconds: float, readings: Sequence[Command]) -> None:
        """Receive for some time, and ask for readings where the sensor sends none by itself."""
        end_ns = self.link.now_ns + round(seconds * 1e9)
        while self.link.now_ns < end_ns and not self.link.is_over:
            if self.model.unasked or not readings:
                self.link.receive(end_ns)
            for command in [] if self.model.unasked else readings:
                if self.link.now_ns < end_ns:
                    self.ask(command, PATIENCE_S)
