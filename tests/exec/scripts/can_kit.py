"""Sockets, frames and interfaces for :mod:`can_behaviour`, and the list of its cases."""

import errno
import os
import select
import socket
import struct
import subprocess
import time

NAME = "vcan0"
RAW = socket.SOL_CAN_RAW
FRAME, FD_FRAME = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")
FILTER, LOOPBACK, OWN, FD, ERRORS, JOIN = 1, 3, 4, 5, 2, 6
EFF, RTR, ERR = 1 << 31, 1 << 30, 1 << 29
SO_TIMESTAMP, SO_TIMESTAMPNS, SO_RXQ_OVFL, SIOCGSTAMP = 29, 35, 40, 0x8906
VETH = os.environ.get("CAN_LINK") == "veth"

CASES = []


def case(function):
    CASES.append(function)
    return function


def frame(ident, data=b"\1\2", length=None):
    return FRAME.pack(ident, len(data) if length is None else length, data)


def fd_frame(ident, data=bytes(12), length=None, flags=0):
    return FD_FRAME.pack(ident, len(data) if length is None else length, flags, data)


def node(name=NAME, **options):
    made = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    for option, value in options.items():
        made.setsockopt(RAW, globals()[option], value)
    made.bind((name,))
    made.setblocking(False)
    return made


def tried(call, *args):
    try:
        return call(*args)
    except OSError as error:
        return errno.errorcode[error.errno]


def heard(sock, wait=0.0):
    """Identifiers of all that waits, with the length of what was read."""
    select.select([sock], [], [], wait)
    found = []
    while isinstance(got := tried(sock.recv, 100), bytes):
        found.append([hex(struct.unpack("=I", got[:4])[0]), len(got)])
    return found if got == "EAGAIN" else [*found, got]


def filters(*pairs):
    return b"".join(struct.pack("=II", *pair) for pair in pairs)


def ip(*words):
    subprocess.run(["ip", "link", *words], check=True)


def again():
    if VETH:
        ip("add", NAME, "type", "veth", "peer", "name", f"far.{NAME}")
        ip("set", f"far.{NAME}", "up")
    else:
        ip("add", NAME, "type", "vcan")
    ip("set", NAME, "mtu", "72", "up")
    time.sleep(0.1)
