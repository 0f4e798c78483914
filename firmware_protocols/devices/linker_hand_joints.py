"""The joint commands of LinkerHands: the joints that each command sets and shows, by model.

The datasheet of the hands is :mod:`firmware_protocols.devices.linker_hand`.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

from firmware_protocols.devices.linker_hand_touch import FINGERS

MAX_JOINTS = 30
"""The number of joints in a state, as in the vendor's table: six for each finger."""
VALUES_OF_ONE_PART = 5
"""The number of joints in one of several commands for a quantity; a larger one covers all joints."""
AT_POWER_UP = {"angles": 0x80, "torques": 0xFF, "speeds": 0xFF, "temperatures": 0x1E}
"""The values at power-up, by quantity; others are 0."""
MOTION = ("speeds", "torques")
"""The quantities with limits to set; the hands in the vendor's table answer their present values."""


class View(NamedTuple):
    """The joints that one command sets and shows."""

    name: str
    quantity: str
    groups: tuple[tuple[int, ...], ...]
    """The joints of each byte: it sets all of them, and shows their mean, or the faults of any."""
    access: Literal["", "set", "clear"] = ""
    answers: bool = True
    least: int = 0
    """The number of bytes that suffices to set the first joints; 0 if all are needed."""

    def answer(self, code: int) -> str:
        """Return the pattern of the answer to its command."""
        return f"{code:02X} ..{{{len(self.groups)}}}"

    def commands(self, code: int) -> list[str]:
        """Return the rows of its query and its setting in a table of commands."""
        answer = self.answer(code) if self.answers else ""
        rows = [f"{'? ' if answer else ''}{self.name}  {code:02X}  {answer}"]
        if self.access:
            byte = " 40" if self.access == "set" else " 01"
            rows.append(f"{self.access} {self.name} by {code:02X}  {code:02X}{len(self.groups) * byte}  {answer}")
        return rows


Views = Mapping[int, View]


def joint_view(quantity: str, n: int, first: int = 0, access: Literal["", "set", "clear"] = "", **more: bool) -> View:
    """Return a view with one byte for each of ``n`` successive joints."""
    name = quantity if not first and n > VALUES_OF_ONE_PART else f"{quantity} {first + 1} to {first + n}"
    return View(name, quantity, tuple((first + k,) for k in range(n)), access, **more)


SIX_JOINTS: Views = {
    0x01: joint_view("angles", 6, access="set"),
    0x02: joint_view("torques", 6, access="set"),
    0x05: joint_view("speeds", 6, access="set"),
    0x33: joint_view("temperatures", 6),
    0x35: joint_view("faults", 6),
    0x36: joint_view("currents", 6),
}
SEVEN_JOINTS: Views = {
    **{
        code: joint_view(quantity, 7, access="set") for code, quantity in ((1, "angles"), (2, "torques"), (5, "speeds"))
    },
    **{code: joint_view(quantity, 7) for code, quantity in ((0x33, "temperatures"), (0x35, "faults"))},
}
TEN_JOINTS: Views = {
    0x01: joint_view("angles", 6, access="set"),
    0x04: joint_view("angles", 4, 6, "set"),
    **{0x02 + k: joint_view("torques", 5, 5 * k, "set") for k in range(2)},
    **{0x05 + k: joint_view("speeds", 5, 5 * k, "set") for k in range(2)},
    **{0x33 + k: joint_view("temperatures", 5, 5 * k) for k in range(2)},
    **{0x35 + k: joint_view("faults", 5, 5 * k) for k in range(2)},
}


def _twenty() -> dict[int, View]:
    """Return the views of pitch, yaw, roll and tip of five fingers; those from 11 on have no answer."""
    named = [
        (0x01 + k, f"{joint} angles", joint_view("angles", 5, 5 * k, "set")) for k, joint in enumerate(JOINTS_OF_L20)
    ]
    named += [
        (0x05, "speeds", joint_view("speeds", 5, access="set")),
        (0x06, "currents", joint_view("currents", 5, access="set")),
    ]
    named += [(0x07, "faults", joint_view("faults", 5, access="clear"))]
    views = {code: view._replace(name=name) for code, name, view in named}
    views |= {code + 0x10: view._replace(name=f"{name}, silent", answers=False) for code, name, view in named}
    for k, (code, joint) in enumerate(zip((0x09, 0x0B, 0x0C, 0x0D), JOINTS_OF_L20)):
        views[code] = joint_view("temperatures", 5, 5 * k)._replace(name=f"{joint} temperatures")
    return views


JOINTS_OF_L20 = ("pitch", "yaw", "roll", "tip")
TWENTY_JOINTS: Views = _twenty()
JOINTS_OF_FINGER = ("yaw", "roll", "root 1", "root 2", "root 3", "tip")
JOINTS_OF_TABLE = ("roll", "yaw", "root 1", "root 2", "root 3", "tip")
"""The joints of the vendor's table, in the order of their commands."""
USED_JOINTS = tuple(6 * f + k for f in range(5) for k in (0, 1, 2, 5) if f == 0 or k != 1)


def _by_table() -> dict[int, View]:
    """Return the views of the vendor's table: one joint of all fingers, one finger, merged fingers."""
    views = {}
    accesses: dict[str, Literal["", "set", "clear"]] = {"faults": "clear", "temperatures": ""}
    for quantity, joint, finger, merged in (
        ("angles", 0x01, 0x41, 0),
        ("speeds", 0x09, 0x49, 0x81),
        ("torques", 0x11, 0x51, 0x82),
        ("faults", 0x19, 0x59, 0x83),
        ("temperatures", 0x21, 0x61, 0x84),
    ):
        access = accesses.get(quantity, "set")
        for k, name in enumerate(JOINTS_OF_TABLE):
            one_each = tuple((6 * f + JOINTS_OF_FINGER.index(name),) for f in range(5))
            least = 1 if name == "roll" else 0  # only the thumb has such a joint
            views[joint + k] = View(f"{name} {quantity}", quantity, one_each, access, least=least)
        for f, name in enumerate(FINGERS):
            views[finger + f] = joint_view(quantity, 6, 6 * f, access)._replace(name=f"{quantity} of the {name}")
        if merged:
            by_finger = tuple(tuple(k for k in USED_JOINTS if k // 6 == f) for f in range(5))
            views[merged] = View(f"{quantity} of whole fingers", quantity, by_finger, access)
    return views


BY_TABLE: Views = _by_table()
