"""bc-revo3-sdk: identity, 200 snapshots of all modules, and what else its touch calls do: PORT KIND."""

import asyncio
import json
import sys

import bc_revo3_sdk.main_mod as sdk


async def main(port, kind):
    async with sdk.Manager() as manager:
        hand = await manager.connect_auto(
            port=port, protocol=sdk.ProtocolType.Modbus, slave_id=0x7E, modbus_baudrate=sdk.Rs485Baudrate.Baud5Mbps
        )
        touch = hand.touch

        async def points():
            frame = await touch.snapshot()
            return [module.points for module in frame.modules]

        got = {
            "model": str(hand.device_info.model),
            "serial": hand.device_info.serial_number,
            "firmware": hand.firmware_info.controller_firmware_version,
            "counts": await touch.point_counts(),
            "mask": await touch.enabled_mask(),
            "many": [await points() for _ in range(200)],
        }
        await touch.set_value_mode(sdk.TouchValueMode.Force)
        got["mode"] = str(await touch.value_mode())
        got["force"] = [await points() for _ in range(20)]
        await touch.set_module_enabled(2, False)
        got["partly"] = await touch.enabled_mask()
        if kind == "array":
            await touch.set_read_mode(sdk.TouchReadMode.LegacyForceSummary)
            frame = await touch.snapshot()
            got["regions"] = [module.regional_forces_mn for module in frame.modules]
        else:
            await touch.tare(3)
            got["tared"] = [str(await touch.tare_status(k)) for k in (3, 4)]
            await touch.cancel_tare(3)
            got["tared"].append(str(await touch.tare_status(3)))
            await touch.restart()
    print(json.dumps(got))


asyncio.run(main(*sys.argv[1:]))
