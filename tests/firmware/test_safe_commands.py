"""Commands that are declared safe: on no model do they write, move, restart, or change a rate or a line."""

from copy import deepcopy

import pytest

from firmware_protocols.check.host import Host, Subject
from firmware_protocols.registry import device_class, names

DOCUMENTED = [name for name in names() if any(command.safe for command in Subject(name, device_class(name)).commands)]


def lasting(device):
    """Return the parts of a device's state that a request that only reads must leave alone."""
    goals = getattr(getattr(device, "motors", None), "goals", None)
    return deepcopy((device.flash, device.periods, device.ports, None if goals is None else goals.tolist()))


@pytest.mark.parametrize("name", DOCUMENTED)
def test_safe_commands_change_nothing_that_lasts(name):
    subject = Subject(name, device_class(name))
    for command in subject.commands:
        if not command.safe:
            continue
        host = Host(subject.make(), pushes=0.5)
        before = lasting(host.device)
        host.ask(command)
        assert lasting(host.device) == before, command.name
        assert host.restarts == 0, command.name


def test_most_polled_devices_have_safe_commands():
    assert len(DOCUMENTED) >= 30
