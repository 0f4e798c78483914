"""feetech-servo-sdk: pings six servos, calibrates and moves them, then reads their loads in groups 200 times."""

import json
import sys
import time

import scservo_sdk as sdk

port, handler = sdk.PortHandler(sys.argv[1]), sdk.PacketHandler(0)
assert port.openPort() and port.setBaudRate(1_000_000)
IDS = range(1, 7)


def wait_longer(bytes_):
    """The SDK's own limit, made for an idle host, is too short for a busy one."""
    port.packet_start_time, port.packet_timeout = port.getCurrentTime(), 500.0


port.setPacketTimeout = wait_longer


def read(address, n):
    group = sdk.GroupSyncRead(port, handler, address, n)
    assert all(group.addParam(ident) for ident in IDS)
    assert group.txRxPacket() == sdk.COMM_SUCCESS
    return [group.getData(ident, address, n) for ident in IDS]


def write(address, n, values):
    group = sdk.GroupSyncWrite(port, handler, address, n)
    assert all(group.addParam(ident, list(value.to_bytes(n, "little"))) for ident, value in zip(IDS, values))
    assert group.txPacket() == sdk.COMM_SUCCESS


got = {"models": [handler.ping(port, ident)[0] for ident in IDS]}
for ident in IDS:
    assert handler.write1ByteTxRx(port, ident, 55, 0)[0] == sdk.COMM_SUCCESS  # unlock
    assert handler.write2ByteTxRx(port, ident, 31, 340 | 1 << 11)[0] == sdk.COMM_SUCCESS
got["offset"] = read(56, 2)
write(40, 1, [1] * 6)
write(42, 2, [1000 + 100 * ident for ident in IDS])
assert handler.regWriteTxRx(port, 6, 42, 2, [0, 8])[0] == sdk.COMM_SUCCESS
got["waiting"] = read(64, 1)
assert handler.action(port, 0xFE) == sdk.COMM_SUCCESS
time.sleep(1.0)
got["there"] = read(56, 2)
got["loads"] = [read(60, 2) for _ in range(200)]
assert handler.write1ByteTxRx(port, 2, 36, 0)[0] == sdk.COMM_SUCCESS  # any load is an overload, at once
assert handler.write1ByteTxRx(port, 2, 35, 0)[0] == sdk.COMM_SUCCESS
time.sleep(0.1)
got["error"] = handler.read2ByteTxRx(port, 2, 56)[2]
assert handler.write1ByteTxRx(port, 1, 6, 1)[0] == sdk.COMM_SUCCESS
print(json.dumps(got))
