"""The unmodified drivers of the matrix: what each reads, from which device, and what a right reading is."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import firmware_protocols as fp
from tests.drivers.test_ability_hand import documented_force
from tests.drivers.test_flexitac_optoforce import SCALE
from tests.drivers.test_inspire_rh56dftp import INDEX_TOP, PALM

Parts = Sequence[np.ndarray]

FORCE = np.array([documented_force(count) for count in range(4096)])
FINGERS = [patch.taxels for patch in fp.create("linker_hand_l6").layout.patches]


@dataclass(frozen=True, kw_only=True)
class Driver:
    """One driver and the device that it reads."""

    package: str
    """What is imported; the tests skip where it is not installed."""
    device: str
    version: str
    parts: Callable[[np.ndarray], Parts] = lambda counts: [counts.reshape(-1)]
    """What a perfect driver reports for a sample's counts."""
    rate_hz: float = 100
    noise: float = 0.1
    """White noise on every taxel, so that a reading names its sample."""
    more: str = ""
    """More lines of the skin's table in the scene."""
    port: str | None = None
    asks: bool = False
    """It polls, or keeps sending commands; the others listen to a stream."""
    share: str = "10%"
    """Of its frames that faults hit: less where many frames make a reading."""
    seconds: float = 1.5
    """How long such faults last."""
    patience_s: float = 5.0
    """How long it is given to recover: longer than its own time-outs with all retries."""
    judge_again: bool = True
    """Whether the same sample twice is worth a word; not where it is read faster than it samples."""
    notes: tuple[str, ...] = ()
    """What its code says to the figures."""
    wrong_baud: int | None = None
    """Another rate than the device's; ``None``: USB, TCP and CAN do not care."""

    @property
    def installed(self) -> bool:
        """Found, not imported: drivers leave files and loggers behind."""
        return importlib.util.find_spec(self.package) is not None

    @property
    def kind(self) -> str:
        """Of the wire: serial, can, tcp."""
        return "can" if "linker" in self.device else "tcp" if self.port else "serial"


MODBUS_NOTES = (
    "The CRC lets no wrong register through; each bad or missing answer is one exception, after the time-out (here "
    "0.5 s) where bytes are missing.",
    "An RTU answer has no number: one that comes twice, late or unasked is taken for the answer to the next request.",
)
MAGNETIC_NOTES = (
    "No checksum: 82 bytes are a frame if they end in `0D 0A`. A flipped bit is a wrong field or temperature, and one "
    "in an exponent an absurd one.",
    "A frame that is too short or too long costs itself and, as a rule, the next.",
    "No time-out: it waits for ever, in a loop that takes a whole core. A pulled cable raises at once.",
)

DRIVERS = {
    "anyskin": Driver(package="anyskin", version="1.0.0", device="anyskin", notes=MAGNETIC_NOTES),
    "reskin-sensor": Driver(package="reskin_sensor", version="2.0.2", device="anyskin", notes=MAGNETIC_NOTES),
    "pyrobotiqtactile": Driver(
        package="pyrobotiqtactile", version="0.1.2", device="robotiq_tsf85", judge_again=False,
        notes=(
            "The checksum in the header is used by nobody: flipped bits become pressures.",
            "`read_frame()` returns on any bytes at all, so that every other reading is the one before; when its "
            "time-out passes it returns the last reading once more and raises nothing. Of packets that come together "
            "it keeps the last.",
            "A sensor that restarts has forgotten to stream. The driver has asked once and does not ask again: the "
            "last reading stays for ever.",
        ),
    ),
    "flexitac": Driver(
        package="flexitac", version="0.3.1", device="flexitac", wrong_baud=1_000_000,
        notes=(
            "It waits for 1024 bytes and takes one image of 386 from them: it falls behind, is 1.3 s late when 50 000 "
            "bytes wait, and then drops images itself, faults or not. `read_latest()` does not.",
            "No checksum, no length: an image that lacks bytes is filled up with the next one.",
        ),
    ),
    "optoforce": Driver(
        package="optoforce", version="0.3.0", device="optoforce", noise=20.0,
        parts=lambda counts: [(counts * SCALE).reshape(-1)],
        notes=(
            "Every fault shows, as often as it was injected: in `valid_checksum`, which the driver leaves to its user, "
            "and in `count`, where lost, repeated and old packets show.",
            "No time-out: `read()` waits for ever.",
        ),
    ),
    "ability-hand": Driver(
        package="ah_wrapper", version="0.2.2", device="ability_hand", rate_hz=250, noise=1.0, asks=True,
        parts=lambda counts: [FORCE[counts]], wrong_baud=921_600, judge_again=False,
        notes=(
            "Its packet loss (`n_writes` less `n_reads`) is what was injected; failed checksums are in its log file "
            "only, and again as many as were injected.",
            "When the port goes, its read thread logs the exception and goes on with the dead handle, for ever. "
            "Nothing is raised: the hand's last state stays.",
        ),
    ),
    "pymodbus": Driver(
        package="pymodbus", version="3.11", device="inspire_rh56dftp", noise=0.5, asks=True,
        parts=lambda counts: [counts[PALM]], wrong_baud=57_600, judge_again=False,
        notes=(
            *MODBUS_NOTES,
            "Its synchronous client never forgets a failure: with no retries, from the fifth on each one closes the "
            "port, and the next request opens it again.",
        ),
    ),
    "modbus_tk": Driver(
        package="modbus_tk", version="1.1.5", device="inspire_rh56dftp", noise=0.5, asks=True,
        parts=lambda counts: [counts[INDEX_TOP]], wrong_baud=57_600, judge_again=False, notes=MODBUS_NOTES,
    ),
    "plusml-rh56dftp": Driver(
        package="RH56DFTP", version="0.1.7", device="inspire_rh56dftp", noise=0.5, asks=True,
        parts=lambda counts: [counts[INDEX_TOP]], port="tcp:127.0.0.1:0", share="5%", seconds=3.0, patience_s=15.0,
        judge_again=False,
        notes=(
            "Modbus TCP has no CRC of its own: a bit that flips in a gateway is a wrong reading.",
            "A lost answer raises nothing: the driver waits 3 s, which cannot be set, and asks again, up to three "
            "times. Readings pause for seconds.",
        ),
    ),
    "linkerbot": Driver(
        package="linkerbot", version="0.5.4", device="linker_hand_l6", noise=0.2, asks=True,
        parts=lambda counts: [counts[taxels] for taxels in FINGERS], share="0.5%", seconds=3.0,
        judge_again=False,
        notes=(
            "A row says which row it is but not of which sample: one that is late, repeated or old can end up in "
            "another matrix, which then mixes two moments. These are the wrong readings beside changed bytes.",
            "A lost row costs the whole hand's reading, after the time-out (here 0.5 s): one `TimeoutError` each.",
        ),
    ),
}  # fmt: skip
