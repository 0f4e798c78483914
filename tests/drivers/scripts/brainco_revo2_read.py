"""bc-stark-sdk: identity, touch 200 times, and its other touch calls: PORT INTERFACE KIND UNIT.

INTERFACE is ``serial``, or python-can's: on CAN-FD the SDK makes and takes the frames and leaves the bus to its caller.
"""

import asyncio
import json
import sys
import time

from bc_stark_sdk import main_mod as sdk

port, carrier, kind, unit = *sys.argv[1:4], int(sys.argv[4])


def on_can(channel, interface):
    import can

    bus = can.Bus(interface=interface, channel=channel, fd=True)
    returning = []
    """Requests that multicast will return."""

    def send(slave, ident, data):
        message = can.Message(arbitration_id=ident, data=bytes(data), is_fd=True, bitrate_switch=True, check=True)
        returning.append((ident, bytes(data)))
        bus.send(message)
        return True

    def receive(slave, ident, frames):
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            if (message := bus.recv(0.1)) is None:
                continue
            heard = message.arbitration_id, bytes(message.data)
            if heard not in returning:
                return heard
            returning.remove(heard)
        return None

    sdk.set_can_tx_callback(send)
    sdk.set_can_rx_callback(receive)
    return sdk.init_device_handler(sdk.StarkProtocolType.CanFd, 1)


async def main():
    hand = on_can(port, carrier) if carrier != "serial" else await sdk.modbus_open(port, sdk.Baudrate.Baud460800)
    info = await hand.get_device_info(unit)

    async def fingers():
        return [
            [f.normal_force1, f.tangential_force1, f.tangential_direction1, f.self_proximity1]
            for f in await hand.get_touch_sensor_status(unit)
        ]

    await hand.touch_sensor_setup(unit, 0x3F)
    got = {
        "type": str(info.hardware_type),
        "serial": info.serial_number,
        "firmware": info.firmware_version,
        "sku": str(info.sku_type),
        "enabled": await hand.get_touch_sensor_enabled(unit),
    }
    if kind == "capacitive":
        got["many"] = [await fingers() for _ in range(200)]
        one = [await hand.get_single_touch_sensor_status(unit, k) for k in range(5)]
        got["single"] = [
            [f.normal_force1, f.tangential_force1, f.tangential_direction1, f.self_proximity1] for f in one
        ]
        got["states"] = [str(f.description).split("status: ")[1].split()[0] for f in one]
        await hand.touch_sensor_reset(unit, 1)
    else:
        got["many"] = [list(await hand.get_modulus_touch_data(unit)) for _ in range(200)]
        got["sums"] = list(await hand.get_modulus_touch_summary(unit))
        await hand.set_modulus_touch_data_type(unit, sdk.ModulusTouchDataType.Force)
        got["force"] = str(await hand.get_modulus_touch_data_type(unit))
    await hand.touch_sensor_calibrate(unit, 1)
    print(json.dumps(got))


asyncio.run(main())
