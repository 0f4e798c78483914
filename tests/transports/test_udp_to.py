"""Datagrams to a driver that sends none."""

import socket

import pytest

from tactemu.base.errors import TransportError
from tactemu.transports import create
from tactemu.transports.udp_to import UdpToTransport


@pytest.mark.parametrize("host", ["", "[::1]:"])
def test_datagrams_go_to_a_driver_that_listens_and_says_nothing(host):
    with UdpToTransport(f"{host}0") as port:
        assert port.write(b"into the void") and port.has_reader and port.poll() == []
        with socket.socket(socket.AF_INET6 if host else socket.AF_INET, socket.SOCK_DGRAM) as driver:
            driver.settimeout(2)
            driver.bind((port.host, port.port))
            for frame in (b"\1\2", b"\3"):
                assert port.write(frame)
                data, there = driver.recvfrom(100)
                assert data == frame
                driver.sendto(b"back", there)
            assert port.poll() == []
        assert port.write(b"after it went")
    assert not port.write(b"closed") and not port.has_reader and port.filenos() == []


def test_a_wrong_address_says_so():
    with pytest.raises(TransportError, match=r"cannot send to no\.such\.host\.invalid:1"):
        create("udpto:no.such.host.invalid:1").open()
    with pytest.raises(TransportError, match="expected udpto:PORT"):
        create("udpto:x")
