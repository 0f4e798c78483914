"""Every planted difference is named, and nothing else; a sensor with its own rest, gain and noise agrees."""

import functools

import pytest

import firmware_protocols as fp
from firmware_protocols import Dds, WebSocket
from tests.judge.compare.captures import compared, model_of
from tests.judge.compare.sensors import PLANTS, SPECIMEN
from tests.judging import ports_of

model = functools.cache(model_of)

COMPARABLE = [name for name in fp.names() if not issubclass(ports_of(name)[0], Dds | WebSocket)]


@pytest.mark.parametrize("name", PLANTS)
def test_a_planted_difference_is_named_and_nothing_else(name):
    plant = PLANTS[name]
    found = compared(model(plant.device), plant.make, SPECIMEN, presses=plant.presses).verdicts.protocol
    assert [each.kind for each in found] == [plant.kind], list(map(str, found))
    assert plant.words in str(found[0])


@pytest.mark.each_device
@pytest.mark.parametrize("name", COMPARABLE)
def test_another_specimen_of_a_device_agrees(name):
    result = compared(model_of(name), lambda: fp.create(name), SPECIMEN)
    assert result.verdicts.protocol == []
