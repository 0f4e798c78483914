"""``tactemu exec``: a driver in a view of the machine in which the emulated sensors are hardware."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tactemu.base.errors import TactemuError, TransportError
from tactemu.base.gc_tuning import no_full_collections
from tactemu.cli.datasheet import options_of
from tactemu.cli.forwarding import Forwarding
from tactemu.cli.reports import nobody_came, not_understood
from tactemu.cli.running import ports_of, rate_of
from tactemu.cli.socket import control_socket
from tactemu.exec.enter import FAILED, NOT_EXECUTABLE, NOT_FOUND
from tactemu.exec.environment import ExecEnvironment, exec_environment
from tactemu.exec.reach import out_of_reach
from tactemu.session.serving import Served, serve

_LOOK_S = 0.1
"""How often the emulator is looked after while the driver runs."""


def run_command(
    target: str,
    command: Sequence[str],
    *,
    options: Sequence[str] = (),
    nodes: Sequence[str] = (),
    ports: Sequence[str] = (),
    rates: Sequence[str] = (),
    seed: int | None = None,
    compute: str | None = None,
    faults: Sequence[str] = (),
    truth: Path | None = None,
    keep: str | None = None,
    quiet: bool = False,
    way: str = "",
    expose: Sequence[str] = (),
    name: str | None = None,
    measured: bool = False,
    signals: Forwarding,
) -> int:
    """Run ``command`` with ``target`` plugged in; returns the exit status, 128 + n after signal n.

    Raises:
        TactemuError: own failures.
    """
    if way == "guest":
        _go_into_guest()
    if not command:
        raise TactemuError(f"which program? name it after --, as in `tactemu exec {target} -- python driver.py`")
    if status := _unfit(command[0]):
        return status
    dev = serve(
        target, port=_network_ports(ports), rate_hz=rate_of(rates), faults=tuple(faults), seed=seed, compute=compute,
        truth=truth, keep=keep, device_options=options_of(options), by_hand=False, measured=measured,
    )  # fmt: skip
    dev.use_usual_network_ports()
    env = exec_environment(dev, nodes=nodes_of(nodes), way=way, expose=expose)
    with no_full_collections(), env, control_socket(dev.control, name, target):
        if not quiet:
            _announce(env, command[0])
        driver = signals.start(partial(env.popen, command))
        failure = _watch(driver, dev, env)
    status = driver.returncode
    if failure is not None:
        _say(str(failure))
        return FAILED
    signals.say_what_ended(status)
    if not quiet:
        _sum_up(dev)
    return status if status >= 0 else 128 - status


_RUNNERS = tuple(Path(__file__).parents[up] / "scripts" / "vcan-run" for up in (1, 2))
"""What brings up a kernel with CAN: in the installed package, and in a source tree."""


def _go_into_guest() -> None:
    """Start again in a kernel that has CAN, emulator and driver; does not return.

    Raises:
        TactemuError: there is no way in.
    """
    runner = next((path for path in _RUNNERS if path.exists()), None)
    if runner is None:
        raise TactemuError(f"--way guest needs a program that this installation has lost: {_RUNNERS[0]}")
    at = next(k for k, word in enumerate(sys.argv) if word in ("--way", "--way=guest"))
    rest = [*sys.argv[1:at], "--way", "native", *sys.argv[at + (1 if sys.argv[at] == "--way=guest" else 2) :]]
    os.execvp("bash", ["bash", str(runner), "-u", "--", sys.executable, "-m", "tactemu", *rest])


def _watch(driver: subprocess.Popen[bytes], dev: Served, env: ExecEnvironment) -> BaseException | None:
    """Until the driver has ended. An emulator that fails meanwhile is unplugged; returns what went wrong in it."""
    failure = None
    while True:
        try:
            driver.wait(_LOOK_S)
            return failure
        except subprocess.TimeoutExpired:
            if failure is None and not dev.running:
                try:
                    env.stop()
                except Exception as error:
                    failure = error
                failure = failure or TactemuError("the emulator has stopped")


def _unfit(program: str) -> int:
    """Exit status for a program that cannot be started, before anything is built; 0 where there is nothing to say."""
    if shutil.which(program):
        return 0
    if os.sep in program and Path(program).exists():
        _say(f"{program}: not executable")
        return NOT_EXECUTABLE
    _say(f"{program}: not found")
    return NOT_FOUND


def _announce(env: ExecEnvironment, program: str) -> None:
    for title, node in env.nodes.items():
        _say(f"{title} is {node}")
    if env.network:
        _say(env.network)
    missed = "modem lines, break, parity, low latency and udev's events"
    if env.missing:
        _say(f"{env.missing}. Names, sysfs, reading and writing work; nobody answers {missed}")
    elif why := out_of_reach(program):
        _say(f"{why}: it finds the ports, reads and writes; what it does not get are {missed}")


def _sum_up(dev: Served) -> None:
    """Say what was not understood, and who was not found."""
    for channel, entry in zip(dev.emulator.channels, dev.emulator.summary()):
        if text := not_understood(entry):
            _say(f"{channel.name} did not understand all that it was sent: {text}")
        if text := nobody_came(channel):
            _say(f"{channel.name}: {text}")


def _say(text: str) -> None:
    print(f"tactemu: {text}", file=sys.stderr, flush=True)


def _network_ports(words: Sequence[str]) -> str | dict[str, str] | None:
    """Return the ports asked for with ``--port``, as for `tactemu run`.

    Raises:
        TransportError: one that is not on the network: it has a node.
    """
    ports = ports_of(words)
    for port in ports.values() if isinstance(ports, dict) else filter(None, [ports]):
        if port.partition(":")[0] not in ("tcp", "udp", "ws", "dds"):
            raise TransportError(
                f"--port {port}: here it is for tcp:, udp:, ws: and dds:; a serial port or a CAN bus has a node, --node"
            )
    return ports


def nodes_of(words: Sequence[str]) -> str | dict[str, str]:
    """``["ttyUSB0"]`` as it is, ``["thumb=ttyUSB0", "palm=ttyUSB1"]`` by skin or ``SKIN/CONNECTOR``.

    Raises:
        TransportError: several nodes of which one does not say whose it is.
    """
    if len(words) == 1 and "=" not in words[0]:
        return words[0]
    nodes = {}
    for word in words:
        owner, given, node = word.partition("=")
        if not given:
            raise TransportError(f"--node {word}: of several nodes each needs its skin, --node SKIN={word}")
        nodes[owner] = node
    return nodes
