"""Commands on the methods that answer them, in tables, and in stages."""

from typing import Annotated

import pytest

import firmware_protocols as fp
from firmware_protocols import (
    Command,
    Device,
    Frame,
    Lines,
    Option,
    Packets,
    Serial,
    Stage,
    command,
    command_table,
    grid_layout,
)

MESSAGE = Frame("""
    message
    0     C1               start
    1     u1               command
    2     u1               size = len(data)
    3     bytes            data
    last  xor8             check
""")


class Panel(Device):
    """A device with commands of every kind."""

    name = "panel"
    ports = (Serial(baud=9600),)
    columns = (fp.Column(name="push", unit="N", counts_per_unit=10.0, low=0, high=255, push=1),)
    documented = command_table("broken  C1 00 00 C0", origin="manual")

    def __init__(self, *, number: Annotated[int, Option(low=0)] = 7):
        self.layout = grid_layout(2, 2, 0.004)
        self.packets = Packets(MESSAGE, by="command", counters=self.counters)
        self.number, self.period_ms, self.loads = number, 0, []

    @command("C1 01 00 C0", "C1 01 01 07 C6", origin="manual, page 1")
    def read_number(self, request):
        return bytes([self.number])

    @command("C1 02 02 64 00 A5", "C1 02 00 C3", name="100 ms", data="<H")
    def set_period(self, request):
        self.period_ms = request.value

    @command("C1 03 00 C2")
    @command("C1 03 01 05 C6", name="with a byte")
    def be_silent(self, request):
        return ()

    @command("C1 04 03 61 62 63 A6", "C1 04 03 61 62 63 A6", data="*")
    def echo(self, request):
        return request.data

    @command(["C1 05 01 03 C6", "01 02 03"], ["C1 05 00 C4", "C1 05 01 06 C3"], data="B")
    def load(self, request):
        self.packets.expect(request.value)

    def staged(self, request):
        self.loads.append(bytes(request.packet))
        return [MESSAGE.pack(command=5, data=bytes([sum(request.packet)]))]

    def reply(self, request, content):
        return [MESSAGE.pack(command=request.command, data=content)]

    def refused(self, request, why):
        return [MESSAGE.pack(command=0x7F, data=why.encode())]


def received(device, *chunks):
    return [out for chunk in chunks for out in device.receive(bytes.fromhex(chunk), 0, "")]


def test_the_method_that_declares_a_command_answers_it():
    device = Panel()
    assert received(device, "C10100C0") == [bytes.fromhex("C1010107C6")]
    assert received(device, "C102", "026400", "A5") == [bytes.fromhex("C10200C3")] and device.period_ms == 100
    assert received(device, "C10300C2", "C1030109CA") == []
    assert received(device, "C1040178BC") == [bytes.fromhex("C1040178BC")]


def test_what_no_method_declares_is_counted_and_refused():
    device = Panel()
    unknown, length = received(device, "C10900C8", "C103020101C0")
    assert [MESSAGE.unpack(each)["data"] for each in (unknown, length)] == [b"unknown_command", b"bad_length"]
    assert received(device, "C10100C1") == []
    assert device.counters == {
        "requests": 2,
        "unknown_command": 1,
        "bad_length": 1,
        "bad_checksum": 1,
        "skipped_bytes": 2,
    }


def test_methods_and_tables_are_the_list_of_commands():
    listed = {each.name: each for each in Panel().commands}
    assert list(listed) == ["broken", "read number", "100 ms", "be silent", "with a byte", "echo", "load"]
    assert listed["read number"].origin == "manual, page 1" and listed["be silent"].reply is None
    assert Panel(number=8).commands == (), "an option may change what is documented"


def test_a_stage_of_a_request_arrives_as_it_comes():
    device = Panel()
    assert received(device, "C10501") == []
    assert received(device, "03C60102") == [bytes.fromhex("C10500C4")]
    assert received(device, "03C10100C0") == [bytes.fromhex("C1050106C3"), bytes.fromhex("C1010107C6")]
    assert device.loads == [b"\1\2\3"]
    command = next(each for each in device.commands if each.name == "load")
    assert command.frame == bytes.fromhex("C1050103C6010203") and len(command.stages) == 2


def test_a_stage_survives_a_save_and_not_a_reset():
    device = Panel()
    received(device, "C1050103C601")
    again = Panel()
    again.restore(device.snapshot())
    assert received(again, "0203") == received(device, "0203") != []
    received(device, "C1050103C601")
    device.packets.reset()
    assert received(device, "C10100C0") == [bytes.fromhex("C1010107C6")]


class Console(Device):
    """A device that takes lines."""

    name = "console"
    ports = (Serial(baud=9600),)

    def __init__(self):
        self.layout = grid_layout(1, 1, 0.004)
        self.packets = Lines(counters=self.counters)
        self.rate = 0

    @command(b"rate 100\n", b"OK\r\n", pattern=rb"rate (\d{1,3})")
    def set_rate(self, request):
        self.rate = int(request.value)

    @command(b"version\r\n", b"1.0\r\n")
    @command(b"ver\r\n", b"1.0\r\n")
    def version(self, request):
        return b"1.0\r\n"

    def reply(self, request, content):
        return [content or b"OK\r\n"]


def test_lines_go_to_the_method_with_the_line_or_the_pattern():
    device = Console()
    assert device.receive(b"version\rver\nrate 20\nrate\n", 0, "") == [b"1.0\r\n", b"1.0\r\n", b"OK\r\n"]
    assert device.rate == 20 and device.counters["unknown_command"] == 1


def test_a_device_without_commands_ignores_what_comes():
    class Mute(Device):
        name = "mute"

        def __init__(self):
            self.layout = grid_layout(1, 1, 0.004)

    assert Mute().receive(b"abc", 0, "") == () and Mute().commands == ()


def test_a_table_of_commands():
    table = command_table(
        r"""
        version       E3 00         E3 05 *
        stop          58 00         -          no answer
        unit 2        06 02         =
        two           61 00
            61 10 ..{2}, 61 14 ..{2}
        text          'V\n'         '1.0\r\n'
        """,
        head="9A",
        tail="55",
        origin="page 2",
    )
    assert table[0] == Command(name="version", request="9A E3 00 55", reply="9A E3 05 * 55", origin="page 2")
    assert table[1].reply is None and table[1].about == "no answer"
    assert table[2].reply == table[2].request == "9A 06 02 55"
    assert table[3].reply == ["9A 61 10 ..{2} 55", "9A 61 14 ..{2} 55"]
    assert table[4].frame == b"V\n" and table[4].agrees([b"1.0\r\n"])
    with pytest.raises(ValueError, match="in columns two spaces apart"):
        command_table("version")


def test_packets_need_a_table_or_a_size():
    with pytest.raises(TypeError, match="give the table of a packet"):
        Packets(b"\xaa", counters=Device.__new__(Console).counters)
    assert issubclass(Stage, bytes)


class Stick(Device):
    """A device that answers broken requests, and says why it refuses others."""

    name = "stick"
    ports = (Serial(baud=9600),)

    def __init__(self):
        self.layout = grid_layout(1, 1, 0.004)
        self.packets = Packets(MESSAGE, by="command", counters=self.counters, broken=True)

    @command(on=1, data="<H")
    def jump(self, request):
        raise fp.Refused("value")

    def refused(self, request, why):
        return [f"{why} {request.why} {request.wanted}".encode()]


def test_a_refused_request_has_its_reason():
    said = received(Stick(), "C1 01 02 00 00 C2", "C1 01 00 C0", "C1 09 00 C8", "C1 01 00 FF")
    assert said == [b"refused value 0", b"bad_length  2", b"unknown_command  0", b"bad_checksum  0"]
