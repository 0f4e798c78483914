"""BrainCo Revo2 Touch: a hand with capacitive fingertips, pressure sensors or three-axis points.

Wire: RS-485, 460800 8N1, Modbus RTU, unit 7E of a left hand, 7F of a right one; functions 03, 04, 06, 16. Or CAN-FD,
1 and 5 Mbit/s (``brainco_revo2_canfd``): the same Modbus frame, CRC included, is the data of a CAN frame, padded with
zeros; its extended id is unit << 16 | host << 8 | bytes of the Modbus frame. An answer has the host's number and its
own length; more than 29 registers do not fit. Five values are thumb, index, middle, ring, little finger:

    register    numbers  about
    901         1        1 right, 2 left, 3 small right, 4 small left
    904         3        LED, buzzer, vibration: on or off
    910, 920    10, 10   factory key, and the serial number that may be written after it
    930..944             protected currents; unit; limits of a finger: its number and a value
    970         1        kind of touch: 1 capacitive, 2 pressure, 4 three-axis points
    1000, 1001  1, 1     unit and line: 0 115200, 1 57600, 2 19200, 3 460800, 4 1 M ... 9 3 M; then the hand restarts
    1002        1        CAN-FD's data rate: 10 is 5 Mbit/s
    1009        1        order: restart
    1010, 1022  12, 12   goals of six motors 0..1000 and times [ms], or speeds
    1034..1046  6 each   speeds, currents, duties -1000..1000
    1052..1062           the same of one motor, its number 1..6 first
    2000..2018  6 each   positions, speeds, currents, states (1 runs)
    3000, 3010  10, 10   firmware, serial number: two characters in a register; BCXT begins a touch hand's

    capacitive
    4000        5        on or off
    4005, 4010  5, 5     order: update the baseline, calibrate
    4100        5 x 10   firmware of each
    4200        5 x 3    normal, tangential, direction
    4215        5 x 2    proximity, 32 bits, high word first
    4225        5        state, 0 is normal
    4250        5 x 6    the same, finger by finger: normal, tangential, direction, proximity, state

    pressure, six being the fingers and the palm
    6000        1        values: 0 raw, 1 calibrated, 2 force
    6001        6        sums
    6010        91       points: 9 of each finger, 46 of the palm
    6110, 6240  6 x 10   firmware, serial number of each
    6200        6        on or off
    6310        6        order: calibrate

    three-axis points, four being index, middle, ring and little finger
    7001        4        on or off
    7006        4        order: calibrate
    7100        4 x 2    sums: x and y, signed bytes; z
    7200..7500  31 x 2   points of a finger, likewise

The vendor's SDK reads the proximities at 4250 with the low byte of all four first, against its own reading of 4215
(option ``single_proximity=big`` for a hand that sends both alike). Its get_single_modulus_touch_data(k) reads from 6010
+ k, not from the points of part k. In its list of registers 3000 is the firmware and 3010 the serial number.

Try it: ``tactemu run brainco_revo2``, then ``bc_stark_sdk.main_mod.modbus_open(port, Baudrate.Baud460800)`` and
``await client.get_touch_sensor_status(0x7E)``.
"""

from firmware_protocols import CanFrame, Rs485, Transmissions, command_table
from firmware_protocols.devices import brainco_canfd
from firmware_protocols.devices.brainco_revo2_hand import BAUDS, Revo2
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns


class BraincoRevo2(Revo2):
    """A Revo2 on RS-485."""

    name = "brainco_revo2"
    title = "BrainCo Revo2 Touch hand"
    ports = (Rs485(baud=460800),)
    documented = command_table(
        """
        ? side                                         03 03 85 00 01 9E 68  03 02 00 02 2C 4F
        ? kind of touch                                03 03 CA 00 01 AF BF  03 02 00 01 6C 4E
        ? firmware                                     04 0B B8 00 0A F9 C3  04 14 ..{20} ..{2}
        ? serial number                                04 0B C2 00 0A D8 1A  04 14 ..{20} ..{2}
        ? which are on                                 03 0F A0 00 05 8D 30  03 0A ..{10} ..{2}
        ? forces, proximities, all but the last state  04 10 68 00 1D BE D0  04 3A ..{58} ..{2}
        ? last state                                   04 10 85 00 01 2F 2C  04 02 ..{2} ..{2}
        ? forces, proximities, states                  04 10 68 00 1E FE D1  04 3C ..{60} ..{2}
        ? thumb                                        04 10 9A 00 06 5F 28  04 0C ..{12} ..{2}
        ? little finger                                04 10 B2 00 06 DF 20  04 0C ..{12} ..{2}
        all on                                         10 0F A0 00 05 0A 00 01 00 01 00 01 00 01 00 01 4E E4
            10 0F A0 00 05 08 F3
        new baseline of two                            10 0F A5 00 05 0A 00 01 00 01 00 00 00 00 00 00 E6 21
            10 0F A5 00 05 18 F2
        calibrate the thumb                            10 0F AA 00 05 0A 00 01 00 00 00 00 00 00 00 00 F9 EE
            10 0F AA 00 05 28 F1
        ring finger off                                06 0F A3 00 00 71 33  =
        ? beyond the map: illegal address              03 23 28 00 01 04 49  83 02 F1 29
        write a force: illegal address                 06 10 68 00 01 C6 D9  86 02 F2 79
        on is 2: illegal value                         06 0F A0 00 02 00 F2  86 03 33 B9
        read coils: illegal function                   01 00 00 00 01 F6 05  81 01 B0 48
        """,
        head="7E",
        origin=Revo2.sources[0],
    )

    def _plug(self) -> None:
        baud = BAUDS[self.registers["baud"]]
        self.ports = (Rs485(baud=baud),)
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(baud))

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        banks = Banks(holding=self, inputs=self, functions=brainco_canfd.FUNCTIONS)
        return self._restarted(self.rtu.answers(data, t_ns, {self.unit: banks}))


class BraincoRevo2CanFd(Revo2):
    """A Revo2 on CAN-FD."""

    name = "brainco_revo2_canfd"
    title = "BrainCo Revo2 Touch hand on CAN-FD"
    documented = command_table(
        """
        ? side                      007E0108##1 7E 03 03 85 00 01 9E 68  007E0107##1 7E 03 02 00 02 2C 4F
        ? kind of touch             007E0108##1 7E 03 03 CA 00 01 AF BF  007E0107##1 7E 03 02 00 01 6C 4E
        ? firmware                  007E0108##1 7E 04 0B B8 00 0A F9 C3  007E0119##1 7E 04 14 ..{20} ..{2} 00{7}
        ? serial number             007E0108##1 7E 04 0B C2 00 0A D8 1A  007E0119##1 7E 04 14 ..{20} ..{2} 00{7}
        ? which are on              007E0108##1 7E 03 0F A0 00 05 8D 30  007E010F##1 7E 03 0A ..{10} ..{2} 00{1}
        ? forces, proximities, all but the last state  007E0108##1 7E 04 10 68 00 1D BE D0
            007E013F##1 7E 04 3A ..{58} ..{2} 00{1}
        ? last state                007E0108##1 7E 04 10 85 00 01 2F 2C  007E0107##1 7E 04 02 ..{2} ..{2}
        ? thumb                     007E0108##1 7E 04 10 9A 00 06 5F 28  007E0111##1 7E 04 0C ..{12} ..{2} 00{3}
        ? little finger             007E0108##1 7E 04 10 B2 00 06 DF 20  007E0111##1 7E 04 0C ..{12} ..{2} 00{3}
        all on                      007E0113##1 7E 10 0F A0 00 05 0A 00 01 00 01 00 01 00 01 00 01 4E E4 00
            007E0108##1 7E 10 0F A0 00 05 08 F3
        new baseline of two         007E0113##1 7E 10 0F A5 00 05 0A 00 01 00 01 00 00 00 00 00 00 E6 21 00
            007E0108##1 7E 10 0F A5 00 05 18 F2
        calibrate the thumb         007E0113##1 7E 10 0F AA 00 05 0A 00 01 00 00 00 00 00 00 00 00 F9 EE 00
            007E0108##1 7E 10 0F AA 00 05 28 F1
        ring finger off             007E0108##1 7E 06 0F A3 00 00 71 33  =
        ? beyond the map: illegal address  007E0108##1 7E 03 23 28 00 01 04 49  007E0105##1 7E 83 02 F1 29
        write a force: illegal address  007E0108##1 7E 06 10 68 00 01 C6 D9  007E0105##1 7E 86 02 F2 79
        on is 2: illegal value      007E0108##1 7E 06 0F A0 00 02 00 F2  007E0105##1 7E 86 03 33 B9
        read coils: illegal function  007E0108##1 7E 01 00 00 00 01 F6 05  007E0105##1 7E 81 01 B0 48
        ? too much for one frame: illegal value  007E0108##1 7E 04 10 68 00 1E FE D1  007E0105##1 7E 84 03 32 D9
        """,
        origin="; ".join(Revo2.sources[:2]),
    )

    def _plug(self) -> None:
        brainco_canfd.plug(self)

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Answer the request in one frame."""
        return self._restarted(brainco_canfd.answers(self, data, t_ns))
