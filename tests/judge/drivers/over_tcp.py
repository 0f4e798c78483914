"""``over_tcp.py VARIANT PORT``: drivers of inspire_rh56dftp (Modbus TCP)."""

import socket
import struct
import sys
import time

from planted_defects import hand_out, say


def main(variant, port):
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


if __name__ == "__main__":
    main(*sys.argv[1:])
