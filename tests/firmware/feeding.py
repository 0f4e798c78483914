"""Short ways to feed a device, for tests of what one device alone does."""

from firmware_protocols import CanFrame, Convert, Device, Restart, Sent
from firmware_protocols.check.readings import reading_of
from firmware_protocols.frames import frame_of


def frames(outs) -> list:
    """The frames among what a method returned."""
    bare = [out.frame if isinstance(out, Sent) else out for out in outs]
    return [out for out in bare if not isinstance(out, Convert | Restart)]


def sample(device: Device, pushes=0.0, t_ns: int = 0, **values) -> list:
    """One conversion of every stream, as the runner does it: feel, then what leaves."""
    sent = []
    for stream in device.periods:
        device.measure(reading_of(device, pushes, stream, **values), t_ns)
        sent += frames(device.stream(t_ns, stream))
    return sent


def send(device: Device, data: bytes | CanFrame | str, t_ns: int = 0, port: str | None = None) -> list:
    """The frames that answer; text is hex or candump notation; a firmware that restarts itself does."""
    return _obeyed(device, device.receive(frame_of(data), t_ns, device.ports[0].name if port is None else port))


def _obeyed(device: Device, outs) -> list:
    if any(isinstance(out, Restart) for out in outs):
        device.power_cycle()
        for stream in device.periods:
            device.measure(reading_of(device, stream=stream), 0)
    return frames(outs)
