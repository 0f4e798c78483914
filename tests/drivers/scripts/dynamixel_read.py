"""dynamixel-sdk: finds the hand, moves a finger, and reads the pressures of five tips 200 times, five ways in turn."""

import json
import sys
import time

import dynamixel_sdk as sdk

port, handler = sdk.PortHandler(sys.argv[1]), sdk.PacketHandler(2.0)
assert port.openPort() and port.setBaudRate(4_000_000)
HAND, TIPS = 110, (1102, 1300, 1498, 1696, 1894)
SPAN = TIPS[-1] + 9 - TIPS[0]


def wait_longer(bytes_):
    """The SDK's own limit, made for an idle host, is too short for a busy one."""
    port.setPacketTimeoutMillis(500.0)


port.setPacketTimeout = wait_longer


def tips(data):
    return [value for tip in TIPS for value in data[tip - TIPS[0] : tip - TIPS[0] + 9]]


def in_a_group(group, ask):
    assert ask() == sdk.COMM_SUCCESS
    return [group.getData(HAND, TIPS[0] + k, 1) for k in range(SPAN)]


sync, bulk = sdk.GroupSyncRead(port, handler, TIPS[0], SPAN), sdk.GroupBulkRead(port, handler)
assert sync.addParam(HAND) and bulk.addParam(HAND, TIPS[0], SPAN)
WAYS = (
    lambda: handler.readTxRx(port, HAND, TIPS[0], SPAN)[0],
    lambda: in_a_group(sync, sync.txRxPacket),
    lambda: in_a_group(sync, sync.fastSyncRead),
    lambda: in_a_group(bulk, bulk.txRxPacket),
    lambda: in_a_group(bulk, bulk.fastBulkRead),
)

got = {"model": handler.ping(port, HAND)[0], "found": sorted(handler.broadcastPing(port)[0])}
for enable in (0, 1):
    assert handler.write1ByteTxRx(port, HAND, 70, enable) == (sdk.COMM_SUCCESS, 0)
assert handler.write2ByteTxRx(port, HAND, 1152, 3000) == (sdk.COMM_SUCCESS, 0)
got["many"] = [tips(WAYS[k % len(WAYS)]()) for k in range(220)]
time.sleep(1.0)
got["position"] = handler.read2ByteTxRx(port, HAND, 1082)[0]
got["refused"] = handler.write1ByteTxRx(port, HAND, 0, 1)[1]
print(json.dumps(got))
