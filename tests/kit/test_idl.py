"""IDL: types and their places in CDR; Cyclone DDS is the judge of both."""

import numpy as np
import pytest

from firmware_protocols.idl import Member, layout, structs

TEXT = """
module a { module b_ {
    struct Inner { uint8 kind; int16 pair[2]; };
    struct Outer { int8 first; sequence<Inner> inner; a::b_::Inner one; float values[3]; uint16 last; };
}; };
struct Plain { uint32 number; };
"""


def test_structs_with_their_modules():
    found = structs(TEXT)
    assert list(found) == ["a::b_::Inner", "a::b_::Outer", "Plain"]
    assert found["a::b_::Inner"] == (Member("kind", "uint8"), Member("pair", "int16", count=2))
    assert found["a::b_::Outer"][1:3] == (Member("inner", "a::b_::Inner", sequence=True), Member("one", "a::b_::Inner"))


def test_a_type_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="Other x: declare the type Other"):
        structs("struct A { Other x; };")
    with pytest.raises(KeyError, match="inner"):
        layout(TEXT, "Outer")


@pytest.mark.parametrize("count", [1, 2, 5])
def test_places_are_those_of_cyclone_dds(count):
    pytest.importorskip("cyclonedds")
    from dataclasses import dataclass

    from cyclonedds.idl import IdlStruct, annotations, types

    @dataclass
    @annotations.final
    class Inner(IdlStruct, typename="a.b_.Inner"):
        kind: types.uint8
        pair: types.array[types.int16, 2]

    @dataclass
    @annotations.final
    class Outer(IdlStruct, typename="a.b_.Outer"):
        first: types.int8
        inner: types.sequence[Inner]
        one: Inner
        values: types.array[types.float32, 3]
        last: types.uint16

    inner = [Inner(k + 1, [300 * k, -k]) for k in range(count)]
    sent = Outer(-3, inner, Inner(9, [7, -8]), [0.5, -1.0, 2.25], 65_535).serialize(use_version_2=False)
    kind = layout(TEXT, "Outer", inner=count)
    data = sent[4:].ljust(kind.itemsize, b"\0")
    assert 0 <= kind.itemsize - len(sent[4:]) < 4, "the end may be padded"
    got = np.frombuffer(data, kind)[0]
    assert (got["first"], got["n_inner"], got["last"]) == (-3, count, 65_535)
    assert got["inner"]["kind"].tolist() == list(range(1, count + 1)) and got["inner"]["pair"][-1, 0] == 300 * (
        count - 1
    )
    assert got["one"]["pair"].tolist() == [7, -8] and got["values"].tolist() == [0.5, -1.0, 2.25]
