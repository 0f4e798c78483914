import copy

import numpy as np
import pytest

from firmware_protocols import Frame, TableError
from tests.kit.saving import restored, saved

IMAGE = Frame("""
    image, row by row
    0   AA 55           marker
    2   u1 x taxels     touch     the 10-bit ADC, shifted right by 2
""")
REQUEST = Frame("""
    request
    0     55 AA      head
    2     <u2        length = total - 5
    4     u1         device
    5     00         reserved
    6     u1         function             FB read, 79 write
    7     <u4        address
    11    <u2        count
    13    bytes      data                 writes
    last  lrc8       check
""")
MIXED = Frame("""
    mixed
    0   u1              kind
    1   >i2 x 3         acceleration
    7   <i2 clip        warmth
    9   >u4 wrap        time
    13  <f4             ratio
    17  bytes x 2       tag
    19  00 x 3          reserved
    22  <crc16_modbus from 1    sum
""")
HEAD = Frame("""
    head, id 100 bbbb tttt (b board, t triangle), pads 0 to 6
    0   40          kind
    1   u1 x 7      pads
""")
TAIL = Frame("""
    tail, id 100 bbbb tttt (b board, t triangle)
    0   C0          kind
    1   u1 x 5      pads
    6   >u2         status
""")
ORDER = [5, 3, 1, 4, 2, 0]


def test_taxels_leave_in_wire_order_and_are_read_in_layout_order():
    image = IMAGE.bind(ORDER)
    touch = np.arange(10, 16)
    assert image.pack(touch=touch) == b"\xaa\x55" + bytes(touch[ORDER].tolist())
    assert image.unpack(image.pack(touch=touch))["touch"].tolist() == touch.tolist()


def test_several_values_per_taxel_move_together():
    frame = Frame("""
        taxels
        0   >i2 x taxels x 3    force
        ..  u1                  end
    """).bind([1, 0])
    data = frame.pack(force=np.array([[1, 2, 3], [4, 5, 6]]), end=9)
    assert data == bytes.fromhex("0004 0005 0006 0001 0002 0003 09")
    assert frame.unpack(data)["force"].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_the_captured_request_of_a_paxini_board():
    data = bytes.fromhex("55 AA 0A 00 03 00 79 03 00 00 00 01 00 01 76")
    fields = {"device": 3, "function": 0x79, "address": 3, "count": 1, "data": b"\x01"}
    assert REQUEST.pack(**fields) == data
    assert REQUEST.unpack(data) == {**fields, "length": 10}


@pytest.mark.parametrize("at", range(15))
def test_a_changed_byte_of_constants_length_or_data_is_no_frame(at):
    data = bytearray.fromhex("55 AA 0A 00 03 00 79 03 00 00 00 01 00 01 76")
    data[at] ^= 0x20
    assert REQUEST.unpack(bytes(data)) is None


@pytest.mark.parametrize("size", [0, 5, 13])
def test_half_a_frame_is_none(size):
    assert REQUEST.unpack(bytes.fromhex("55 AA 0A 00 03 00 79 03 00 00 00 01 00 01 76")[:size]) is None


def mixed(**changes):
    values = {"kind": 1, "acceleration": [1, -2, 3], "warmth": -5, "time": 7, "ratio": 0.5, "tag": b"ok"}
    return {**values, **changes}


def test_mixed_byte_orders_floats_and_sums():
    data = MIXED.pack(**mixed())
    assert data[:22].hex() == "010001fffe0003fbff000000070000003f6f6b000000"
    out = MIXED.unpack(data)
    assert out.pop("acceleration").tolist() == [1, -2, 3]
    assert out == {"kind": 1, "warmth": -5, "time": 7, "ratio": 0.5, "tag": b"ok"}


def test_wrap_and_clip_do_what_the_firmware_does():
    out = MIXED.unpack(MIXED.pack(**mixed(warmth=40_000, time=(1 << 32) + 3)))
    assert (out["warmth"], out["time"]) == (0x7FFF, 3)
    assert MIXED.unpack(MIXED.pack(**mixed(warmth=-40_000)))["warmth"] == -0x8000


@pytest.mark.parametrize(
    "changes, error, message",
    [
        ({"kind": 256}, OverflowError, "mixed: kind: 256..256 does not fit 0..255"),
        ({"kind": -1}, OverflowError, "mixed: kind: -1..-1 does not fit 0..255"),
        ({"acceleration": [0, 40_000, 0]}, OverflowError, "mixed: acceleration: 0..40000 does not fit -32768..32767"),
        ({"kind": 1.5}, TypeError, "mixed: kind: expected integers, got float64"),
        ({"acceleration": np.zeros(3)}, TypeError, "mixed: acceleration: expected integers, got float64"),
        ({"acceleration": [1, 2]}, ValueError, r"mixed: acceleration: expected shape \(3,\), got \(2,\)"),
        ({"tag": b"long"}, ValueError, "mixed: tag: expected 2 bytes, got 4"),
        ({"other": 1}, TypeError, r"mixed: .* no field for the values \['other'\]"),
    ],
)
def test_values_that_do_not_fit_are_named(changes, error, message):
    with pytest.raises(error, match=message):
        MIXED.pack(**mixed(**changes))


def test_a_missing_value_is_named():
    with pytest.raises(TypeError, match=r"request: .*fields \['count'\]"):
        REQUEST.pack(device=1, function=2, address=3)


@pytest.mark.parametrize("counts", [[0, 256], [-1, 3], [1 << 60, 0]])
def test_a_lost_clip_is_an_error_in_arrays_of_any_size(counts):
    for n in (1, 200):
        with pytest.raises(OverflowError, match="image: touch"):
            IMAGE.bind(taxels=2 * n).pack(touch=np.array(counts * n))


def test_counts_must_be_bound_and_are_named():
    with pytest.raises(ValueError, match=r"image: .*bind\(taxels=\.\.\.\)"):
        IMAGE.pack(touch=[1])
    with pytest.raises(TableError, match=r"image: cannot bind taxel: the table has \['taxels'\]"):
        IMAGE.bind(taxel=3)
    with pytest.raises(TableError, match=r"image: wire_order must hold each of 0\.\.1 once"):
        IMAGE.bind([1, 1])


def test_a_bound_field_is_a_constant():
    frame = MIXED.bind(kind=0x14)
    values = mixed()
    del values["kind"]
    assert frame.pack(**values) == MIXED.pack(**mixed(kind=0x14))
    assert frame.unpack(MIXED.pack(**mixed(kind=0x15))) is None
    with pytest.raises(OverflowError, match=r"kind: 256\.\.256"):
        MIXED.bind(kind=256)


def test_lengths_of_fixed_frames_are_constants():
    frame = Frame("""
        packet
        0   9A              start
        1   u1              n = len(touch)
        2   u1 x taxels     touch
    """).bind(taxels=3)
    assert frame.head == b"\x9a" and frame.size == 5
    assert frame.pack(touch=[1, 2, 3]) == b"\x9a\x03\x01\x02\x03"
    assert frame.unpack(b"\x9a\x04\x01\x02\x03") is None


def test_what_the_firmware_ignores_is_read_over():
    start = Frame("""
        start
        0   07      op
        1   u1      stop
        2   ignored
    """)
    assert start.unpack(b"\x07\x01\xff\xff") == start.unpack(b"\x07\x01") == {"stop": 1}
    assert start.pack(stop=0) == b"\x07\x00"


def test_rows_are_the_frames_one_by_one():
    frame = Frame("""
        row
        0   C0              kind
        1   u1 x taxels     pads
        ..  >u2             status
        ..  bytes x 1       tag
        ..  <i2 clip        warmth
        last  sum8 from 1   sum
    """).bind(ORDER)
    pads, status, warmth = np.arange(24).reshape(4, 6), np.arange(4) * 300, np.array([0, 40_000, -40_000, 5])
    rows = frame.pack_many(4, pads=pads, status=status, tag=b"x", warmth=warmth)
    assert rows == [frame.pack(pads=pads[k], status=status[k], tag=b"x", warmth=warmth[k]) for k in range(4)]
    assert frame.pack_many(2, pads=pads[:2], status=7, tag=b"x", warmth=0)[1][7:9] == b"\x00\x07"
    with pytest.raises(ValueError, match=r"row: pads: expected shape \(4, 6\), got \(6, 4\)"):
        frame.pack_many(4, pads=pads.T, status=0, tag=b"x", warmth=0)
    with pytest.raises(OverflowError, match="row: status"):
        frame.pack_many(4, pads=pads, status=status * 1000, tag=b"x", warmth=warmth)


def test_can_identifiers_are_made_filtered_and_read():
    assert TAIL.id.of(board=1, triangle=12) == 0x41C
    assert TAIL.id.of(board=np.array([1, 2]), triangle=np.array([0, 15])).tolist() == [0x410, 0x42F]
    assert TAIL.id.filter() == (0x400, 0x700)
    assert TAIL.id.filter(board=3) == (0x430, 0x7F0)
    assert TAIL.id.read(0x41C) == {"board": 1, "triangle": 12}
    assert TAIL.id.read(0x51C) is None
    assert not TAIL.id.extended
    with pytest.raises(OverflowError, match="board: 16 does not fit 4 bits"):
        TAIL.id.of(board=16, triangle=0)
    with pytest.raises(TypeError, match="has the parts"):
        TAIL.id.of(board=1)


def test_cantools_decodes_what_the_tables_encode():
    cantools = pytest.importorskip("cantools")
    from firmware_protocols.dbc import dbc

    database = cantools.database.load_string(dbc((f, {"board": 1, "triangle": 2}) for f in (HEAD, TAIL)), "dbc")
    decoded = database.decode_message(0x412, TAIL.pack(pads=[1, 2, 3, 4, 5], status=0x1234))
    assert decoded == {"kind": 0xC0, "pads_0": 1, "pads_1": 2, "pads_2": 3, "pads_3": 4, "pads_4": 5, "status": 0x1234}
    assert database.decode_message(0x412, HEAD.pack(pads=range(7)))["pads_6"] == 6


def test_a_table_prints_itself_with_what_is_bound():
    assert str(IMAGE.bind(taxels=384)) == (
        "image, row by row\n  0  AA 55     marker\n  2  u1 x 384  touch   the 10-bit ADC, shifted right by 2"
    )
    assert "  0   14" in str(MIXED.bind(kind=0x14))
    assert str(TAIL).startswith("tail, id 100bbbbtttt (b board, t triangle)\n  0  C0")
    assert Frame(str(TAIL)).id == TAIL.id
    assert Frame(str(REQUEST)).pack(device=1, function=2, address=3, count=4)


@pytest.mark.parametrize(
    "lines, message",
    [
        ("0  AA 55  marker\n1  u1  touch", "'touch' is at 1, but the fields before it end at 2"),
        ("0  u1  a\n..  u1  b", "'b' is at `..`, but the fields before it end at 1"),
        ("0  u1 x n  a\n1  u1  b", "'b' is at 1, but the size of the fields before it is not fixed"),
        ("0  u2  a", "line '0  u2  a': u2 needs a byte order, <u2 or >u2"),
        ("0  >u3  a", "unknown type '>u3': types are"),
        ("0  <i2 round  a", "unknown type '<i2 round'"),
        ("0  u1", "'' is no name"),
        ("0 u1 a", "expected `offset  type  name  about`, in columns two spaces apart"),
        ("x  u1  a", "offset 'x': expected a decimal number"),
        ("0  u1  a\n1  u1  a", "'a' occurs twice"),
        ("0  bytes  a\n..  bytes  b", "more than one field of open length"),
        ("0  u1  n = len(b)\n1  u1  a", "'n' is the length of 'b', which is no field"),
        ("0  u1  n = a | 4\n1  u1  a", "only lengths"),
        ("0  u1 x 2  n = total", "a length is one integer"),
        ("0  u1  a\nlast  sum8  s\n2  u1  b", "'s' is at `last`, but 'b' comes after it"),
        ("0  u1  a\n1  sum16  s", "sum16 needs a byte order"),
        ("0  u1  a\n1  sum8 from 2  s", "'s' sums from 2, but is at 1"),
        ("0  u1  a\n1  sum8 of 2  s", "expected `from N`"),
        ("0  u1 x 3 x taxels  a", "taxels come first"),
        ("", "broken: no fields"),
    ],
)
def test_a_wrong_line_does_not_import_and_is_named(lines, message):
    with pytest.raises(TableError) as error:
        Frame("broken\n" + lines)
    assert str(error.value).startswith("broken: ") and message in str(error.value)


@pytest.mark.parametrize(
    "header, message",
    [
        ("x, id 100 bbbb (b board)", "11 or 29 bits, got 7"),
        ("x, id 100 bbbb tttt (b board)", "name its letters"),
        ("x, id 100 bbtt ttbb (b board, t triangle)", "the bits of b must stand together"),
    ],
)
def test_a_wrong_identifier_does_not_import(header, message):
    with pytest.raises(TableError, match=message):
        Frame(header + "\n0  u1  a")


def test_a_frame_is_saved_as_its_text_and_bindings():
    image = IMAGE.bind(ORDER)
    assert copy.deepcopy(image) is image
    other = restored(saved(image))
    assert other.pack(touch=range(6)) == image.pack(touch=range(6))


def test_a_field_that_clips_keeps_its_byte_order_beside_another():
    frame = Frame("""
        two
        0   <u2         first
        2   >u2 clip    second
    """)
    assert frame.pack(first=1, second=2) == b"\x01\x00\x00\x02" and frame.pack(first=1, second=-5)[2:] == b"\x00\x00"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0  <i2 x 3 gyro  [1 / 131 deg/s]", "put two spaces between the type '<i2 x 3' and the name 'gyro'"),
        ("0  u1 n = len(d)  of what follows", "put two spaces between the type 'u1' and the name 'n = len(d)'"),
        ("0 u1  a", "put two spaces between the offset '0' and the type 'u1'"),
        ("0  u1  a of all", "'a of all' is no name: letters, digits and _; put two spaces behind 'a'"),
        ("0  RECORD  a", "expected `RECORD x n`"),
    ],
)
def test_a_missing_space_is_named_with_its_column(line, message):
    with pytest.raises(TableError) as error:
        Frame("broken\n" + line, RECORD=Frame("record\n0  u1  a"))
    assert message in str(error.value)


CONTACT = Frame("""
    contact
    0     u1     id
    1     <i2    x
""")
CONTACTS = Frame(
    """
    contacts
    0     A5             head
    1     u1             n = count(contacts)
    2     <u2            size = total - 4
    4     CONTACT x n    contacts
    last  sum8           sum
    """,
    CONTACT=CONTACT,
)


def test_records_are_counted_packed_and_unpacked():
    contacts = [{"id": 1, "x": -2}, {"id": 7, "x": 300}]
    frame = CONTACTS.pack(contacts=contacts)
    assert frame[:4] == bytes([0xA5, 2, 7, 0]) and frame[4:-1] == bytes([1, 0xFE, 0xFF, 7, 0x2C, 1])
    assert CONTACTS.unpack(frame) == {"n": 2, "size": 7, "contacts": contacts}
    assert CONTACTS.length_of(frame[:3]) == CONTACTS.length_of(frame[:4]) == 11
    assert CONTACTS.unpack(frame[:4] + frame[5:]) is None
    assert copy.deepcopy(CONTACTS) is CONTACTS and CONTACTS.pack(contacts=[])[1] == 0
    again = Frame.__new__(Frame)
    again.__setstate__(CONTACTS.__getstate__())
    assert again.pack(contacts=contacts) == frame


def test_a_frame_states_its_length_and_its_flaw():
    frame = MESSAGE.pack(command=5, data=b"abc")
    assert [MESSAGE.length_of(frame[:n]) for n in (2, 3)] == [0, len(frame)]
    assert MESSAGE.length_of(frame, 2) == "bad_length"
    assert MESSAGE.read(frame) == ({"command": 5, "size": 3, "data": b"abc"}, "")
    assert MESSAGE.read(frame[:-3] + b"x" + frame[-2:]) == (None, "bad_checksum")
    assert MESSAGE.read(frame[:-1] + b"x") == (None, "bad_tail")
    longer = frame[:2] + b"\x04" + frame[3:-2] + bytes([frame[-2] + 1]) + frame[-1:]
    assert MESSAGE.read(longer) == (None, ""), "the cutter finds a wrong length"
    with pytest.raises(TypeError, match="no field states its length"):
        Frame("open\n0  bytes  data").length_of(b"abc")


MESSAGE = Frame("""
    message
    0     A5       head
    1     u1       command
    2     u1       size = len(data)
    3     bytes    data
    ..    sum8     sum
    ..    5A       tail
""")
