"""``planted.py KIND VARIANT PORT...``: drivers with one defect each, and clean ones, for the judge to find.

KIND is ``stream`` (optoforce), ``two`` (two of them), ``polled`` (weiss_wts), ``modbus`` (dfrobot_tactile),
``tcp`` (inspire_rh56dftp) or ``can`` (xela_uskin). They print one JSON line for each reading, and what is wrong
on stderr.
"""

import json
import socket
import struct
import sys
import time


def hand_out(**row):
    print(json.dumps(row), flush=True)


def say(text):
    print(text, file=sys.stderr, flush=True)


# -- a stream: 16 bytes, a counter, a sum ------------------------------------------------------------------------------

HEAD = bytes.fromhex("aa07080a")


def stream(variant, port):
    import serial

    line = serial.Serial(port, 1_000_000, timeout=0.4)
    data, last, kept, count, old, smooth = b"", None, [], 0, None, (0, 0, 0)
    while True:
        try:
            more = line.read(max(1, min(512, line.in_waiting)))
        except serial.SerialException as error:
            if variant == "stale" and old:
                for _ in range(60):  # "it will come back": and until then the last reading is handed out
                    hand_out(**old)
                    time.sleep(0.01)
            say(f"port lost: {error}")
            sys.exit(1)
        if not more:
            if variant == "stale" and old:
                hand_out(**old)
            elif variant != "blocks":
                say("nothing comes")
            continue
        data += more
        while len(data) >= 16:
            if data[:4] != HEAD:
                if variant == "noresync":
                    data = data[16:]
                    continue
                at = data.find(HEAD, 1)
                data = data[at:] if at > 0 else data[-3:]
                continue
            packet, data = data[:16], data[16:]
            if variant != "nosum" and sum(packet[:14]) & 0xFFFF != int.from_bytes(packet[14:], "big"):
                say("bad sum")
                data = packet[4:] + data  # a frame may have been cut: the next one's head may be in it
                continue
            number, status, x, y, z = struct.unpack(">HHhhh", packet[4:14])
            if variant == "dies" and last is not None and number != (last + 1) & 0xFFFF:
                raise RuntimeError("a packet is missing")
            if variant == "wrap" and last is not None and number < last:
                continue  # "an old packet"
            last = number
            count += 1
            if variant == "hundredth" and count % 100 == 0:
                continue
            if variant == "endian":
                z = struct.unpack("<h", struct.pack(">h", z))[0]
            if variant == "unsigned":
                z &= 0xFFFF
            if variant == "swapped":
                x, y = y, x
            if variant == "leak":
                kept.append(bytearray(10_000))
            if variant == "slow":
                time.sleep(0.02)
            if variant == "filter":
                x, y, z = (round(0.6 * was + 0.4 * now, 2) for was, now in zip(smooth, (x, y, z)))
                smooth = (x, y, z)
            old = {"n": number, "status": status, "fx": x, "fy": y, "fz": z}
            hand_out(**old)


def two(variant, *ports):
    """Two of them, each on a port of its own."""
    import serial

    lines = [serial.Serial(port, 1_000_000, timeout=1) for port in ports]
    while True:
        row = {}
        for name, line in zip("lr", lines):
            row[name] = None
            while row[name] is None:
                line.read_until(HEAD)
                packet = HEAD + line.read(12)
                if len(packet) == 16 and sum(packet[:14]) & 0xFFFF == int.from_bytes(packet[14:], "big"):
                    row[name] = struct.unpack(">3h", packet[8:14])
                else:
                    say("bad sum")
        hand_out(**row)


# -- polled: a message with an id, a length and a CRC ------------------------------------------------------------------


def quiet(line, wait=True):
    """What is still coming belongs to the question that failed."""
    while wait and line.read(1):
        line.reset_input_buffer()


def table_of(byte):
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


TABLE = [table_of(byte) for byte in range(256)]


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc


def polled(variant, port):
    import serial

    line = serial.Serial(port, 115200, timeout=0.15)
    ask, old = bytes.fromhex("aaaaaa200100008f83"), None
    while True:
        if variant not in ("late", "deaf"):
            line.reset_input_buffer()
        line.write(ask)
        asked = time.monotonic()
        while True:
            head = line.read(6)
            if variant == "deaf" and len(head) < 6:
                continue  # it waits for the answer, for ever
            if len(head) < 6:
                payload = None
                break
            size = int.from_bytes(head[4:6], "little")
            if head[:3] != b"\xaa\xaa\xaa" or size > 1024:
                payload = None
                break
            rest = line.read(size + 2)
            payload = rest[:-2]
            sound = len(rest) == size + 2 and crc16(head + payload) == int.from_bytes(rest[-2:], "little")
            if not sound and variant != "nocrc":
                payload = None
            if variant != "anyreply" and payload is not None and (head[3] != 0x20 or payload[:2] != b"\0\0"):
                payload = None
            if variant not in ("late", "deaf", "anyreply") and time.monotonic() - asked < 0.0005:
                payload = None  # no controller answers so soon: this one was on its way before the question
            break
        if payload is None:
            if variant in ("late", "deaf", "timeout"):
                time.sleep(0.005)
            if variant == "timeout" and old is not None:
                hand_out(v=old)
            else:
                say("no good answer")
                quiet(line, variant not in ("late", "deaf"))
            continue
        values = payload[7 : 7 + 168].ljust(168, b"\0")
        old = list(struct.unpack("<84H", values))
        if variant == "mask":
            old = [value & 0x7FF for value in old]
        if variant == "clip":
            old = [min(value, 1600) for value in old]
        hand_out(v=old)
        time.sleep(0.008)


# -- Modbus on a line --------------------------------------------------------------------------------------------------


def crc_modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def modbus(variant, port):
    import serial

    line = serial.Serial(port, 115200, timeout=0.15)
    ask = bytes([1, 4, 0, 7, 0, 32])
    ask += crc_modbus(ask)
    old = None
    while True:
        line.reset_input_buffer()
        line.write(ask)
        answer = line.read(3)
        if len(answer) == 3:
            answer += line.read(2 if answer[1] & 0x80 else answer[2] + 2)
        good = len(answer) >= 5 and answer[-2:] == crc_modbus(answer[:-2])
        if variant == "nocrc":
            good = len(answer) >= 5
        good &= answer[:1] == b"\1" or variant == "unit"
        if good and answer[1] == 0x84:
            if variant == "exception" and old is not None:
                hand_out(v=old)
            else:
                say("the device says that it failed")
            time.sleep(0.01)
            continue
        if not good or answer[1] != 4 or (answer[2] != 64 and variant != "short"):
            if variant == "timeout" and old is not None:
                hand_out(v=old)
            else:
                say("no good answer")
                quiet(line)
            continue
        old = list(struct.unpack(">32H", answer[3:-2].ljust(64, b"\0")[:64]))
        hand_out(v=old)
        time.sleep(0.008)


def tcp(variant, port):
    host, _, number = port.rpartition("//")[2].rpartition(":")
    line = socket.create_connection((host, int(number)), timeout=0.3)
    transaction = 0
    while True:
        transaction = transaction + 1 & 0xFFFF
        line.sendall(struct.pack(">HHHBBHH", transaction, 0, 6, 1, 3, 4128, 48))
        try:
            answer = b""
            while len(answer) < 9 or len(answer) < 6 + int.from_bytes(answer[4:6], "big"):
                more = line.recv(4096)
                if not more:
                    say("closed")
                    sys.exit(1)
                answer += more
        except TimeoutError:
            say("no answer")
            continue
        number, _, _size, unit, function, count = struct.unpack(">HHHBBB", answer[:9])
        if (number != transaction and variant != "transaction") or unit != 1 or function != 3 or count != 96:
            say("not the answer to this question")
            continue
        hand_out(v=list(struct.unpack(">48H", answer[9:105])))
        time.sleep(0.008)


# -- CAN: sixteen frames make a scan -----------------------------------------------------------------------------------


def can(variant, port):
    import can as python_can

    interface, _, channel = port.partition(":")
    bus = python_can.Bus(interface=interface, channel=channel)
    start = python_can.Message(arbitration_id=0x201, data=[7, 0], is_extended_id=False)
    bus.send(start)
    rows, got, begun = {}, 0, 0.0
    while True:
        message = bus.recv(0.5)
        if message is None:
            say("nothing comes")
            bus.send(start)  # it may have restarted, and waits to be asked
            continue
        ident, data = message.arbitration_id, bytes(message.data)
        if message.is_error_frame or message.is_extended_id or (ident & 0x7F0 != 0x710 and variant != "foreign"):
            continue
        taxel = ident & 0x0F
        if len(data) != 8 and variant != "short":
            say("a short frame")
            rows, got = {}, 0
            continue
        if taxel == 0 and variant not in ("mixed", "oldrow"):
            if rows and len(rows) < 16:
                say("a scan is not whole")
            rows, begun = {}, message.timestamp
        if message.timestamp - begun > 0.006 and variant not in ("mixed", "oldrow"):
            continue  # rows have no number: those of the next scan come a period later
        values = struct.unpack(">3H", data.ljust(8, b"\0")[1:7])
        if variant == "bytes" and taxel == 5:
            values = (values[0], (values[1] & 0xFF) << 8 | values[1] >> 8, values[2])
        if variant not in ("mixed", "oldrow") and rows.get(taxel, values) != values:
            say("two of one taxel in a scan")
            begun = 0.0  # nobody can tell which is which: wait for the next
        rows[taxel] = values
        got += 1
        whole = len(rows) == 16 and taxel == 15 and begun > 0
        if variant == "mixed":
            whole = got == 16
        if variant == "oldrow":
            whole = taxel == 15 and len(rows) == 16
        if whole:
            hand_out(**{f"t{k}": rows.get(k, (0, 0, 0)) for k in range(16)})
            got = 0
            if variant != "oldrow":
                rows = {}


KINDS = {"stream": stream, "two": two, "polled": polled, "modbus": modbus, "tcp": tcp, "can": can}

if __name__ == "__main__":
    KINDS[sys.argv[1]](*sys.argv[2:])
