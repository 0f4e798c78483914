"""Commands that are declared safe: on no model do they write, move, restart, or change a rate or a line."""

from copy import deepcopy

from firmware_protocols.check.host import Host, Subject
from firmware_protocols.registry import device_class, names


def lasting(device):
    """Return the parts of a device's state that a request that only reads must leave alone."""
    goals = getattr(getattr(device, "motors", None), "goals", None)
    return deepcopy((device.flash, device.periods, device.ports, None if goals is None else goals.tolist()))


def safe_commands_of(subject):
    """Send each safe command to a device that has just started, and return their names."""
    safe = [command for command in subject.commands if command.safe]
    for command in safe:
        where, host = f"{subject.target}: {command.name}", Host(subject.make(), pushes=0.5)
        before = lasting(host.device)
        host.ask(command)
        assert lasting(host.device) == before, where
        assert host.restarts == 0, where
    return [command.name for command in safe]


def test_safe_commands_change_nothing_that_lasts_and_most_polled_devices_have_some():
    documented = [name for name in names() if safe_commands_of(Subject(name, device_class(name)))]
    assert len(documented) >= 30
