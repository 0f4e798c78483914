"""The faults of the matrix."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactemu.wire.faults import KINDS, parse
from tests.drivers.matrix.drivers import Driver


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One fault for a while."""

    about: str
    fault: str = ""
    """Text of a fault of the wire; otherwise ``name`` says what is done to the device."""
    """``{share}`` stands for the driver's."""
    seconds: float | None = None
    """``None``: the driver's."""

    def against(self, driver: Driver) -> Trial:
        """The trial as this driver gets it."""
        return replace(self, fault=self.fault.format(share=driver.share), seconds=self.seconds or driver.seconds)

    def fits(self, driver: Driver) -> bool:
        """Whether this driver's wire can have it, and whether it could matter."""
        if not self.fault:
            return True
        fault = parse(self.against(driver).fault)
        if fault.direction != "to_driver" and not driver.asks:
            return False
        return driver.kind in KINDS[fault.kind].wires and not (fault.kind == "unplug" and driver.kind == "can")


TRIALS = {
    "none": Trial(about="nothing, for comparison", fault="drop 0%"),
    "drop": Trial(about="some of the frames are lost", fault="drop {share}"),
    "flip": Trial(about="one bit of some of the frames is wrong", fault="flip {share}"),
    "truncate": Trial(about="the end of some of the frames is missing", fault="truncate {share}"),
    "length": Trial(about="some of the frames have a byte too many (CAN: too few)", fault="length {share}"),
    "checksum": Trial(about="the last two bytes of some of the frames are wrong", fault="checksum {share} bytes 2"),
    "duplicate": Trial(about="some of the frames come twice", fault="duplicate {share}"),
    "reorder": Trial(about="some of the frames come after the next one", fault="reorder {share}"),
    "stray": Trial(about="after some of the frames an old one comes again", fault="stray {share}"),
    "garbage": Trial(about="1 to 16 random bytes before some of the frames", fault="garbage {share}"),
    "split": Trial(about="some of the frames come in two pieces 5 ms apart", fault="split {share} by 5ms"),
    "merge": Trial(about="some of the frames come in one piece with the next", fault="merge {share}"),
    "late": Trial(about="some of the frames come 30 ms late", fault="late {share} by 30ms"),
    "latency": Trial(about="a USB-serial chip with a 16 ms timer in between", fault="latency 16ms"),
    "request lost": Trial(about="some of what the driver sends is lost", fault="drop {share} from_driver"),
    "request flipped": Trial(
        about="one bit of some of what the driver sends is wrong", fault="flip {share} from_driver"
    ),
    "error": Trial(about="some of the frames are broken by an error frame and sent again", fault="error {share}"),
    "load": Trial(about="other nodes take 60 % of the bus", fault="load 60%"),
    "babble": Trial(about="a node fills the bus with the highest priority", fault="babble"),
    "busoff": Trial(about="the hand leaves the bus for half a second", fault="busoff", seconds=0.5),
    "silence": Trial(about="nothing passes for half a second", fault="silence", seconds=0.5),
    "unplug": Trial(about="the port is gone for half a second", fault="unplug", seconds=0.5),
    "hang": Trial(about="the device neither samples nor hears for half a second", seconds=0.5),
    "reset": Trial(about="the device restarts", seconds=0.5),
}
