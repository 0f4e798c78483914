"""The fields of messages that no frame table writes, from the datasheets of the devices, to judge `tactemu infer`.

A truth returns the places of a message's numbers, or ``None`` if the tables that packed it say enough. Bytes that no
place covers are constants, text, or not counted.
"""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.infer_corpus import Span

Truth = Callable[[bytes, bytes, "int | None"], "list[Span] | None"]
"""A function of message, question and identifier."""

SIZES = {"12": 1.5}
NOT_COUNTED = {
    "seed_fts3": "lines of text",
    "vitac_3d": "lines of text",
    "dynpick": "lines of text",
    "osmo_glove": "protobuf: fields have no fixed place",
    "weiss_dsacon32m": "run-length coded: values have no fixed place",
}
"""Devices whose framing is judged, but not their fields."""


def numbers(code: str, at: int, n: int = 1, kind: str = "field") -> list[Span]:
    """Return ``n`` neighbouring numbers of one type."""
    size = int(code[-1])
    return [(at + k * size, size, kind, code, "") for k in range(n)]


def twelve(at: int, n: int, order: str = "<", nibbles: int = 0) -> list[Span]:
    """Return ``n`` values of 12 bits from a byte on, behind some nibbles; the name holds the place in nibbles."""
    return [(at + (3 * k + nibbles) // 2, 2, "field", f"{order}12", str(2 * at + 3 * k + nibbles)) for k in range(n)]


def modbus(code_of: Callable[[int, int, int], list[Span]]) -> Truth:
    """Return the truth of Modbus answers, from the places of registers."""

    def truth(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
        if len(question) < 8 or len(data) < 5 or data[1] not in (3, 4) or question[1] != data[1]:
            end = 3 if data[1] & 0x80 else 6
            return [(end, 2, "sum", "<crc16_modbus", "")] if len(data) == end + 2 else []
        end = 3 + data[2]
        found = code_of(int.from_bytes(question[2:4], "big"), data[2] // 2, 3)
        return [*found, (end, 2, "sum", "<crc16_modbus", "")]

    return truth


def words(register: int, n: int, at: int) -> list[Span]:
    """Return registers as unsigned numbers."""
    return numbers(">u2", at, n)


def _revo2(register: int, n: int, at: int) -> list[Span]:
    found, k = [], 0
    while k < n:
        r = register + k
        is_pair = (4215 <= r < 4225 and (r - 4215) % 2 == 0) or (4250 <= r < 4280 and (r - 4250) % 6 == 3)
        size = 2 if is_pair and k + 1 < n else 1
        found += numbers(("<u4" if r >= 4250 else ">u4") if size == 2 else ">u2", at + 2 * k)
        k += size
    return found


def _bytes_from(first: int) -> Callable[[int, int, int], list[Span]]:
    return lambda register, n, at: numbers("u1", at, 2 * n) if register >= first else numbers(">u2", at, n)


def _ghand5(register: int, n: int, at: int) -> list[Span]:
    found = []
    for k in range(2 * n):
        b = 2 * register + k
        if b < 8450:
            continue
        if b < 8480:
            code = ("i1", "", "i1", "", "u1", "")[(b - 8450) % 6]
        elif b < 8594:
            code = ("i1", "i1", "u1")[(b - 8480) % 3]
        else:
            code = "" if (b - 8594) % 94 == 93 else ("i1", "i1", "u1")[(b - 8594) % 94 % 3]
        found += numbers(code, at + k) if code else []
    return found


def _points(at: int, size: int) -> list[Span]:
    return [each for k in range(at, at + size - 2, 3) for each in (*numbers("i1", k, 2), *numbers("u1", k + 2))]


def _pushes(name: str) -> Truth:
    sizes: list[int] = []

    def truth(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
        if data[:2] != b"\xaa\x56":
            return None
        if not sizes:
            from firmware_protocols import create

            layout = create(name).layout
            sizes.extend(len(range(*patch.taxels.indices(len(layout)))) for patch in layout.patches)
        found, at = [], 6
        has_resultants = len(data) >= 7 + sum(3 * n + 6 for n in sizes)  # register 0016 leaves them out
        for n in sizes:
            if has_resultants:
                found += numbers("<i2", at, 3)
                at += 6
            found += _points(at, 3 * n)
            at += 3 * n
        return [*found, (len(data) - 1, 1, "sum", "lrc8", "")]

    return truth


def _robotiq_tsf85(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if data[:1] != b"\x9a" or data[2] not in (0x58, 0x59, 0x61):
        return None
    kinds = {1: (">u2", 28), 2: (">i2", 1), 3: (">i2", 3), 4: (">i2", 3), 5: (">i2", 3), 6: (">i2", 1), 7: (">u8", 1)}
    found, at = [], 4
    while at < len(data):
        code, n = kinds[data[at] >> 4]
        found += numbers(code, at + 1, n)
        at += 1 + n * int(code[-1])
    return found


def _paxini_gen2(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if data[:4] != b"\x55\xaa\x7b\x7b" or data[6] != 0x70 or len(data) < 40:
        return None
    n = int.from_bytes(data[10:12], "little")
    return [*_points(12 + n % 3, n - n % 3), (12 + n, 1, "sum", "lrc8", "")]


def _paxini_px6ax(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if data[6] != 0xFB:
        return None
    address, n = int.from_bytes(data[7:11], "little"), int.from_bytes(data[11:13], "little")
    is_points = address == 0x40E or (address == 0x3F0 and n == 3)
    body = _points(14, n) if is_points else [*_points(14, 3), *_points(44, n - 30)]
    return [*body, (14 + n, 1, "sum", "lrc8", "")]


def _robotera(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if data[:2] != b"\x55\xaa" or len(data) < 2000:
        return None
    found, at = [], 7
    for _ in range(12):
        found += [*numbers("<f4", at + 2), *numbers("<u2", at + 10)]
        at += 24
    for _ in range(5):
        z = "u1"
        found += [*numbers("i1", at, 2), *numbers(z, at + 2), *_points(at + 3, 360), *numbers("u1", at + 363, 20)]
        at += 384
    return [*found, (len(data) - 2, 2, "sum", "<crc16_xmodem", "")]


def _inspire(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
    if data[:2] != b"\x90\xeb":
        return []
    address = int.from_bytes(data[5:7], "little")
    body = numbers("<i2", 7, (len(data) - 8) // 2) if address >= 3000 else []
    return [*body, (len(data) - 1, 1, "sum", "sum8", "")]


_FT300 = modbus(lambda register, n, at: numbers(">i2", at, n) if 180 <= register < 200 else [])


def _robotiq_ft300(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    return None if data[:2] == b"\x20\x4e" else _FT300(data, question, identifier)


def _robotis(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    crc: list[Span] = [(len(data) - 2, 2, "sum", "<crc16_umts", "")]
    if len(data) == 177:  # five fingers through a bulk or indirect read: four motors of 6 bytes, nine pressures
        return [*numbers("u1", 9), *numbers("<i2", 10, 60), *numbers("u1", 130, 45), *crc]
    return crc


def _ability_hand(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if len(data) != 74:
        return None
    return [*numbers("<i2", 2, 12), *twelve(26, 30), (72, 1, "sum", "lrc8", "")]


def _barrett(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
    if identifier is not None and identifier & 0x1F in (0x09,) and len(data) == 8:
        return twelve(0, 5, ">", 1) if data[0] >> 4 < 4 else twelve(0, 4, ">", 1)
    if identifier is not None and identifier & 0x1F == 0x08 and len(data) == 8:
        return []  # a map of bits, and nibbles
    return []


def _linker(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
    if 0xB0 <= data[0] < 0xB8:
        return [] if len(data) < 4 else numbers("u1", 2, len(data) - 2)
    return numbers("u1", 1, len(data) - 1)


def _nibotics(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if len(data) != 230:
        return [(len(data) - 1, 1, "sum", "crc8", "")]
    n = (len(data) - 8 - 11 - 7 - 12) // 8
    at = 7 + 8 * n
    crc: Span = (len(data) - 1, 1, "sum", "crc8", "")
    return [*numbers("<f4", 7, 2 * n), *twelve(at, 7), *numbers("u1", at + 11, 7), *numbers("<i2", at + 18, 6), crc]


def _sensel(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if len(data) < 14 or data[1] != 0x26 or data[2]:
        return None
    found, at = [*numbers("u1", 0), *numbers("u1", 6), *numbers("<u4", 7)], 11
    if data[5] & 4:
        n = data[12]
        for k in range(n):
            found += [*numbers("u1", 13 + 10 * k, 2), *numbers("<u2", 15 + 10 * k, 4)]
        at = 13 + 10 * n
    if data[5] & 8:
        found += numbers("<i2", at, 3)
    return [*found, (len(data) - 1, 1, "sum", "sum8", "")]


def _sensing_tex_mat(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
    points = range(6, len(data) - 3, 4)
    return [each for at in points for each in (*numbers("u1", at, 2), *numbers(">u2", at + 2))]


def _singletact(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    if len(data) != 22:
        return None
    return [*numbers("u1", 6), *numbers(">u4", 7), *numbers(">u2", 12, 3)]


def _weiss_wts(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    crc: Span = (len(data) - 2, 2, "sum", "<crc16_weiss", "")
    if data[3] == 0x20 and len(data) == 79:
        return [*numbers("<u4", 8), *numbers(">u2", 13, 32), crc]
    return [*numbers("<u2", 8), crc] if data[3] == 0x46 else [crc]


def _synria(data: bytes, question: bytes, identifier: int | None) -> list[Span]:
    crc: Span = (len(data) - 2, 2, "sum", "<crc16_modbus", "")
    if data[1] == 0x42 and len(data) == 126:
        return [*numbers("<u2", 4, 60), crc]
    return [crc]


def _dexrobot(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    return numbers("<i2", 0, 8) if len(data) == 16 else None if len(data) > 16 else []


def _allegro(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    return numbers("<i2", 0, 4) if identifier in (0x80, 0x84, 0x88, 0x8C) else None


def _ati(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    kinds = {0x200: [*numbers(">u2", 0), *numbers(">i2", 2, 3)], 0x201: numbers(">i2", 0, 3)}
    return kinds.get(identifier or 0) if len(data) >= 6 else []


def _contactile(data: bytes, question: bytes, identifier: int | None) -> list[Span] | None:
    return None


TRUTHS: dict[str, Truth] = {
    "ability_hand": _ability_hand,
    "allegro_v5_sense": _allegro,
    "anyskin": lambda data, question, identifier: numbers("<f4", 0, 20),
    "ati_netcanoem": _ati,
    "barrett_bh8": _barrett,
    "brainco_revo2": modbus(_revo2),
    "brainco_revo2_canfd": modbus(_revo2),
    "brainco_revo3": modbus(_bytes_from(5240)),
    "dexrobot_dexhand": _dexrobot,
    "dfrobot_tactile": modbus(words),
    "flexitac": lambda data, question, identifier: numbers("u1", 2, len(data) - 2),
    "ghand5": modbus(_ghand5),
    "icub_skin": lambda data, question, identifier: numbers("u1", 1, 7 if data[0] == 0x40 else 5),
    "inspire_rh56dftp": _inspire,
    "linker_hand_l10_rs485": modbus(words),
    **{f"linker_hand_{name}": _linker for name in ("l6", "l10", "l20", "l25", "g20", "o6")},
    "matsense": lambda data, question, identifier: [*numbers("u1", 1, 256), *numbers("<i2", 257, 6)],
    "nibotics_prvs01": _nibotics,
    "orca_touch": _pushes("orca_touch"),
    "paxini_gen2": _paxini_gen2,
    "paxini_high_speed": _pushes("paxini_high_speed"),
    "paxini_px6ax": _paxini_px6ax,
    "robotera_xhand": _robotera,
    "robotiq_ft300": _robotiq_ft300,
    "robotiq_tsf85": _robotiq_tsf85,
    "robotis_hx5": _robotis,
    "rohand": modbus(_bytes_from(2000)),
    "sensel_morph": _sensel,
    "sensing_tex_mat": _sensing_tex_mat,
    "singletact": _singletact,
    "synria_60": _synria,
    "weiss_wts": _weiss_wts,
}
