"""What SocketCAN does, in as many ways as drivers may notice: one line of JSON for each. Run where vcan0 is, as root.

The kernel's own answers, in the guest, are what those of the preload library are compared with.
"""

import errno
import fcntl
import json
import os
import select
import socket
import struct
import sys
import time

import can_filter_cases  # noqa: F401  registers the cases of filters
from can_kit import (
    CASES,
    ERR,
    NAME,
    OWN,
    RAW,
    SIOCGSTAMP,
    SO_RXQ_OVFL,
    SO_TIMESTAMP,
    SO_TIMESTAMPNS,
    VETH,
    again,
    case,
    fd_frame,
    frame,
    heard,
    ip,
    node,
    tried,
)


@case
def own_and_others():
    found = {}
    for own in (0, 1):
        for loopback in (0, 1):
            with node(OWN=own, LOOPBACK=loopback) as one, node() as other:
                one.send(frame(0x1))
                other.send(frame(0x2))
                found[f"own {own}, loopback {loopback}"] = [_flags(one), _flags(other)]
    with node(OWN=1) as one, node(OWN=1) as other:
        one.send(frame(0x1))
        other.send(frame(0x2))
        one.send(frame(0x3))
        found["both own"] = [_flags(one), _flags(other)]
        one.setsockopt(RAW, OWN, 0)
        one.send(frame(0x4))
        other.send(frame(0x5))
        found["own no more"] = [_flags(one), _flags(other)]
    with node() as one:
        copy = one.dup()
        copy.setblocking(False)
        one.send(frame(0x1))
        found["a copy is the same socket"] = [heard(copy), heard(one)]
        with node() as other:
            other.send(frame(0x2))
            found["and hears the same"] = [heard(copy), heard(one)]
        copy.close()
    return found


def _flags(sock):
    found = []
    while isinstance(got := tried(sock.recvmsg, 100, 100), tuple):
        data, _, flags, address = got
        found.append([data[0], bool(flags & socket.MSG_DONTROUTE), bool(flags & 0x800), address])
    return found


@case
def fd_frames():
    found = {}
    for of_writer in (0, 1):
        with node(FD=of_writer) as writer, node(FD=1) as both, node() as classic:
            found[f"fd {of_writer}"] = [
                tried(writer.send, fd_frame(0x1)), tried(writer.send, frame(0x2)),
                tried(writer.send, fd_frame(0x3, flags=1)),
                tried(writer.send, fd_frame(0x4, bytes(64))), tried(writer.send, fd_frame(0x5, length=65)),
                heard(both), heard(classic),
            ]  # fmt: skip
    with node(FD=1) as writer, node(FD=1) as reader:
        writer.send(fd_frame(0x7, bytes(range(64)), flags=1))
        found["whole"] = reader.recv(72).hex()
    return found


@case
def mtu():
    with node() as one:
        asked = struct.pack("16s24x", NAME.encode())
        told = {name: struct.unpack("16xi20x", fcntl.ioctl(one, code, asked))[0] for name, code in
                (("index is there", 0x8933), ("mtu", 0x8921))}  # fmt: skip
        told["index is there"] = told["index is there"] == socket.if_nametoindex(NAME)
        told["type"] = struct.unpack("16xH22x", fcntl.ioctl(one, 0x8927, asked))[0]
        ip("set", NAME, "down")
        ip("set", NAME, "mtu", "68" if VETH else "16")
        ip("set", NAME, "up")
        told["classic"] = struct.unpack("16xi20x", fcntl.ioctl(one, 0x8921, asked))[0]
        with node(FD=1) as writer:
            told["sent"] = [tried(writer.send, fd_frame(1)), tried(writer.send, frame(1))]
        ip("set", NAME, "down")
        ip("set", NAME, "mtu", "72")
        ip("set", NAME, "up")
        return told


@case
def bad_frames():
    with node() as one:
        return [
            tried(one.send, frame(1, bytes(8), length=9)), tried(one.send, frame(1, bytes(8), length=8)),
            tried(one.send, b""), tried(one.send, bytes(15)), tried(one.send, bytes(17)), tried(one.send, bytes(72)),
            tried(one.send, bytes(100)), tried(os.write, one.fileno(), frame(2)),
            tried(os.write, one.fileno(), bytes(3)),
        ]  # fmt: skip


@case
def addresses():
    found = {}
    one = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    one.setblocking(False)
    index = socket.if_nametoindex(NAME)
    found["unbound"] = [one.getsockname(), tried(one.send, frame(1)), tried(one.recv, 16)]
    found["unbound, to somewhere"] = tried(one.sendto, frame(1), (NAME,))
    with node() as other:
        one.sendto(frame(0x9), (NAME,))
        found["arrives"] = heard(other, 1)
        one.bind(("",))
        found["bound to any"] = [one.getsockname(), tried(one.send, frame(1))]
        other.send(frame(0x8))
        select.select([one], [], [], 1)
        found["hears from"] = list(one.recvfrom(16)[1])
    found["to nowhere"] = tried(one.sendto, frame(1), ("",))
    one.bind((NAME,))
    found["bound"] = [one.getsockname(), tried(one.bind, (NAME,)), tried(one.send, frame(1))]
    found["to lo"] = tried(one.bind, ("lo",))
    found["family"] = [one.getsockopt(socket.SOL_SOCKET, 39), one.getsockopt(socket.SOL_SOCKET, 38), one.family == 29]
    found["type"] = one.getsockopt(socket.SOL_SOCKET, 3)
    found["connect"] = tried(one.connect, (NAME,))
    one.close()
    assert index
    return found


@case
def kinds_of_socket():
    found = []
    for kind, protocol in ((3, 1), (2, 1), (1, 1), (3, 0), (3, 99), (5, 1)):
        made = tried(socket.socket, socket.AF_CAN, kind, protocol)
        found.append(made if isinstance(made, str) else "made")
        if not isinstance(made, str):
            made.close()
    return found


@case
def scattered():
    with node() as writer, node() as reader:
        whole = frame(0x321, b"abcdefgh")
        found = [writer.sendmsg([whole[:3], whole[3:9], whole[9:]]), tried(writer.sendmsg, [whole, b"x"])]
        first, second = bytearray(5), bytearray(20)
        size, _, _, address = reader.recvmsg_into([first, second])
        found += [size, bytes(first).hex(), bytes(second[:11]).hex(), address]
        found += [writer.sendmsg([whole], [], 0, (NAME,)), os.writev(writer.fileno(), [whole[:8], whole[8:]])]
        parts = [bytearray(8), bytearray(8)]
        found += [os.readv(reader.fileno(), parts), bytes(parts[1]).decode()]
        data, _, flags, _ = reader.recvmsg(4)
        found += [data.hex(), bool(flags & socket.MSG_TRUNC), tried(reader.recv, 16)]
        writer.send(whole)
        found += [len(reader.recv(16, socket.MSG_PEEK)), len(reader.recv(4)), tried(reader.recv, 16)]
        return found


@case
def timestamps():
    found = {}
    with node() as writer, node() as reader:
        before = time.time()
        writer.send(frame(1))
        reader.recv(16)
        seconds, micros = struct.unpack("ll", fcntl.ioctl(reader, SIOCGSTAMP, bytes(16)))
        found["SIOCGSTAMP"] = -1 < seconds + micros / 1e6 - before < 1
    for name, option in (("SO_TIMESTAMP", SO_TIMESTAMP), ("SO_TIMESTAMPNS", SO_TIMESTAMPNS)):
        with node() as writer, node() as reader:
            reader.setsockopt(socket.SOL_SOCKET, option, 1)
            before = time.time()
            writer.send(frame(1))
            writer.send(frame(2))
            stamps = []
            for _ in range(2):
                (level, kind, data), *_ = reader.recvmsg(16, 64)[1]
                seconds, part = struct.unpack("ll", data)
                stamps.append(seconds + part / (1e6 if option == SO_TIMESTAMP else 1e9))
            found[name] = [level, kind, -0.001 < stamps[0] - before < 1, stamps[0] <= stamps[1]]
    return found


@case
def overflow():
    with node() as writer, node() as reader:
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        reader.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        for k in range(200):
            writer.send(frame(k))
        data = reader.recv(16)
        while isinstance(tried(reader.recv, 16), bytes):
            pass
        writer.send(frame(0x700))
        _, beside, _, _ = reader.recvmsg(16, 64)
        told = [kind for _, kind, data in beside if kind == SO_RXQ_OVFL and struct.unpack("=I", data)[0] > 0]
        return [data[0], told]


@case
def error_frames():
    with node(ERRORS=struct.pack("=I", 0x1FFFFFFF)) as all_errors, node(ERRORS=struct.pack("=I", 0x40)) as off:
        with node() as none, node() as writer:
            for kind in (0x40, 0x100, 0x4, 0x8):  # bus off, restarted, controller, protocol
                writer.send(frame(ERR | kind, bytes(8)))
            return [heard(all_errors), heard(off), heard(none)]


@case
def down_and_up():
    found = {}
    with node() as reader, node() as writer:
        ip("set", NAME, "down")
        poll = select.poll()
        poll.register(reader)
        found["polled"] = poll.poll(1000)[0][1]
        found["down"] = [tried(writer.send, frame(1)), tried(reader.recv, 16), tried(reader.recv, 16)]
        late = node()
        found["bound while down"] = [tried(late.recv, 16), tried(late.recv, 16)]
        ip("set", NAME, "up")
        time.sleep(0.1)
        found["up"] = [tried(writer.recv, 16), tried(writer.send, frame(2)), heard(reader, 1), heard(late, 1)]
        late.close()
    return found


@case
def unplugged_and_back():
    found = {}
    with node() as reader, node() as writer:
        before = reader.getsockname()
        ip("del", NAME)
        time.sleep(0.1)
        found["gone"] = [tried(reader.recv, 16), tried(reader.recv, 16), tried(writer.recv, 16)]
        found["send"] = [tried(writer.send, frame(1)), tried(writer.send, frame(1))]
        found["name"] = [before, reader.getsockname()]
        found["bind"] = tried(node)
        again()
        found["old sockets"] = [tried(writer.send, frame(1)), tried(reader.recv, 16)]
        writer.bind((NAME,))
        with node() as fresh:
            found["new ones"] = [tried(fresh.send, frame(5)), heard(writer, 1), heard(reader)]
    return found


@case
def many_at_once():
    """recvmmsg and sendmmsg, as programs in C use them."""
    import ctypes

    class Vector(ctypes.Structure):
        _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]

    class Message(ctypes.Structure):
        _fields_ = [
            ("name", ctypes.c_void_p), ("name_length", ctypes.c_uint), ("vectors", ctypes.POINTER(Vector)),
            ("count", ctypes.c_size_t), ("control", ctypes.c_void_p), ("control_length", ctypes.c_size_t),
            ("flags", ctypes.c_int), ("_", ctypes.c_int), ("length", ctypes.c_uint), ("_1", ctypes.c_int),
        ]  # fmt: skip

    libc = ctypes.CDLL(None, use_errno=True)

    def messages(count, contents):
        buffers = [ctypes.create_string_buffer(text, 16) for text in contents]
        names = [ctypes.create_string_buffer(24) for _ in range(count)]
        vectors = (Vector * count)(*[Vector(ctypes.addressof(each), 16) for each in buffers])
        made = (Message * count)()
        for k in range(count):
            made[k].vectors, made[k].count = ctypes.pointer(vectors[k]), 1
            made[k].name, made[k].name_length = ctypes.addressof(names[k]), 24
        return made, buffers, names, vectors

    with node() as writer, node() as reader:
        made, *_kept = messages(5, [frame(k) if k != 3 else frame(k, bytes(8), length=9) for k in range(5)])
        for each in made:
            each.name, each.name_length = None, 0
        sent = [libc.sendmmsg(writer.fileno(), made, 5, 0), made[0].length]
        made, buffers, names, *_kept = messages(6, [bytes(16)] * 6)
        got = libc.recvmmsg(reader.fileno(), made, 6, 0, None)
        told = [
            [made[k].length, buffers[k].raw[0], made[k].name_length, names[k].raw[0], made[k].flags] for k in range(got)
        ]
        again = libc.recvmmsg(reader.fileno(), made, 6, 0, None), errno.errorcode[ctypes.get_errno()]
        return [sent, got, told, again]


def main(wanted):
    for each in CASES:
        if not wanted or each.__name__ in wanted:
            time.sleep(0.05)  # what the case before has sent arrives
            try:
                answer = each()
            except Exception as error:
                answer = f"{type(error).__name__}: {error}"
            print(json.dumps({each.__name__: answer}, default=bytes.hex), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
