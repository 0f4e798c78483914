"""Counts that follow from the columns."""

import numpy as np
import pytest

from firmware_protocols import Column, Device, Layout, Reading, Sense, Serial, grid_layout, points


def device(*columns: Column, senses=("force",), layout: Layout | None = None, streams=None):
    class Made(Device):
        name = "made"
        ports = (Serial(baud=9600),)

        def __init__(self):
            self.layout = layout or grid_layout(1, 2, 0.004)
            self.senses, self.columns, self.streams = senses, columns, streams or {}

    return Made()


NINE = {"low": -9, "high": 9}


def force(*rows):
    return Reading({"force": np.array(rows, float)})


def test_a_push_is_scaled_rounded_and_limited():
    made = device(Column(name="push", unit="N", counts_per_unit=100.0, low=0, high=255, rest=20, push=1))
    assert made.measure(force((0, 0, -1.004), (5, 5, 1)), 0).tolist() == [120, 0]
    assert made.counts.tolist() == [120, 0] and made.present.tolist() == [1.004, -1.0]
    made.zero = made.present
    assert made.measure(force((0, 0, -1.504), (0, 0, -9)), 0).tolist() == [70, 255]


def test_a_push_may_lower_the_counts():
    made = device(Column(name="push", assumed_per_unit=100.0, low=0, high=4095, rest=3000, push=-1))
    assert made.measure(force((0, 0, -1), (0, 0, -50)), 0).tolist() == [2900, 0]


@pytest.mark.parametrize(("push", "z"), [(1, 30), (-1, -30), (0, -30)])
def test_axes_are_those_of_the_taxel(push, z):
    columns = [Column(name=a, axis=a, unit="N", counts_per_unit=10.0, low=-128, high=127) for a in "xy"]
    made = device(*columns, Column(name="z", axis="z", unit="N", counts_per_unit=10.0, low=-128, high=127, push=push))
    assert made.measure(force((1, 2, -3), (0, 0, 0)), 0).tolist() == [[10, 20, z], [0, 0, 0]]


def test_floats_are_limited_only():
    made = device(Column(name="z", axis="z", unit="N", counts_per_unit=1.0, low=-2, high=2, is_float=True))
    counts = made.measure(force((0, 0, -1.25), (0, 0, 7)), 0)
    assert counts.dtype == np.float32 and counts.tolist() == [-1.25, 2.0]


def test_each_sense_is_converted_by_its_columns():
    chip = points({"chip": (0.0, 0.0, 0.0)})
    made = device(
        Column(name="push", unit="N", counts_per_unit=10.0, low=0, high=99, push=1),
        Column(name="T", sense="temperature", unit="degC", counts_per_unit=10.0, low=-400, high=1250, rest=250),
        *(
            Column(name=a, axis=a, sense="acceleration", unit="m/s^2", counts_per_unit=2.0, low=-9, high=9)
            for a in "xyz"
        ),
        senses=("force", *(Sense(each, at=chip) for each in ("temperature", "acceleration", "angular_velocity"))),
    )
    values = {"force": np.zeros((2, 3)), "temperature": np.array([31.26]), "acceleration": np.array([[1.0, -2.0, 9.8]])}
    counts = made.measure(Reading({**values, "angular_velocity": np.zeros((1, 3))}), 0)
    assert {key: each.tolist() for key, each in counts.items()} == {
        "force": [0, 0], "temperature": [313], "acceleration": [[2, -4, 9]],
    }  # fmt: skip


def test_a_wrench_has_its_columns_in_order():
    names = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
    columns = [
        Column(name=n, axis=n[1], unit="N", counts_per_unit=10.0, low=-999, high=999, push=n == "Fz") for n in names
    ]
    made = device(*columns, senses=(Sense("wrench", at=points({"o": (0.0, 0.0, 0.0)})),))
    assert made.measure(Reading({"wrench": np.array([[1, 2, -3, 4, 5, -6.0]])}), 0).tolist() == [
        [10, 20, 30, 40, 50, -60]
    ]


def test_a_column_without_a_scale_is_named():
    made = device(Column(name="field", low=0, high=9, push=1))
    with pytest.raises(TypeError, match="column 'field' has no scale"):
        made.measure(force((0, 0, 0), (0, 0, 0)), 0)
