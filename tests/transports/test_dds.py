"""DDS: another process at the other end, bounds, forks, and what is said where it cannot be."""

import os
import subprocess
import sys
import time

import pytest

from tactemu import transports
from tactemu.base.errors import TransportError, TransportUnavailable
from tactemu.transports.transport import Closed, Opened, Received
from tests.transports.driver_ends import DdsEnd, create
from tests.transports.test_contract import look

pytest.importorskip("cyclonedds", reason="DDS needs it: pip install 'tactemu[dds]'")
END = """
import sys, time
from tests.transports.driver_ends import DdsEnd
from cyclonedds.domain import Domain
domain = Domain(int(sys.argv[1]), "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
                "</General></Domain></CycloneDDS>")
end = DdsEnd(None, f"dds:{sys.argv[1]}")
end.open([])
until = time.monotonic() + float(sys.argv[2])
while time.monotonic() < until:
    end.write(end.request)
end.close()
"""


def other_process(domain, seconds):
    return subprocess.Popen([sys.executable, "-c", END, str(domain), str(seconds)])


def test_a_writer_without_pause_in_another_process_is_read_in_small_pieces():
    with create("dds:81") as port, other_process(81, 4) as end:
        events = look(port, [], Opened, seconds=10)
        looks = []
        for _ in range(100):
            time.sleep(0.01)
            looks.append([event.data for event in port.poll() if isinstance(event, Received)])
        assert Opened() in events and sum(map(len, looks)) > 1000 and max(map(len, looks)) <= 32
        assert {data for each in looks for data in each} == {DdsEnd.request}
        assert Closed() in look(port, [], Closed, seconds=10)
        end.wait()


def test_nobody_is_waited_for():
    began = time.monotonic()
    with create("dds:82") as port:
        assert not port.write(DdsEnd.frame) and port.poll() == []
    assert time.monotonic() - began < 10


def test_what_is_no_sample_is_not_sent():
    with create("dds:83") as port:
        end = DdsEnd(port, port.address)
        end.open([])
        look(port, [], Opened)
        assert not port.write(b"\1") and port.write(DdsEnd.frame)
        assert end.read(DdsEnd.frame) == DdsEnd.frame
        end.close()


def test_a_child_does_not_take_the_port_away():
    with create("dds:84") as port:
        end = DdsEnd(port, port.address)
        end.open([])
        look(port, [], Opened)
        if not (child := os.fork()):
            port.close()
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert port.write(DdsEnd.frame) and end.read(DdsEnd.frame) == DdsEnd.frame
        end.close()


def test_errors_name_the_fix(monkeypatch):
    with pytest.raises(TransportError, match="cannot join on 'nosuch0'"):
        create("dds:nosuch0:85").open()
    with create("dds:86"), pytest.raises(TransportError, match="on 'lo'; take another"):
        create("dds:eth0:86").open()
    monkeypatch.delitem(sys.modules, "tactemu.transports.dds", raising=False)
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    with pytest.raises(TransportUnavailable, match=r"pip install 'tactemu\[dds\]'"):
        transports.create("dds:0")
