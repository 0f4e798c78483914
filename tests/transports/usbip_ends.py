"""A ``usbip:`` port that a thread polls, and requests that wait in it, by a client that is not ours."""

import threading
import time

import usbip

from tactemu import transports


class Polled:
    """A port with a thread that polls it, as the loop would."""

    def __init__(self, location, connector, scheme="usbip"):
        self.port = transports.create(f"{scheme}:{location}")
        self.port.set_connector(connector)
        self.events, self._stop = [], threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._stop.is_set():
            with self._lock:
                self.events += self.port.poll()
            time.sleep(0.001)

    def __enter__(self):
        self.port.open()
        self.number = int(self.port.address.split("--tcp-port ")[1].split()[0])
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self.port.close()

    def write(self, data):
        with self._lock:
            return self.port.write(data)

    def wait(self, kind, seconds=5.0, **fields):
        """Return the last event of a kind with these fields, once there is one."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            found = [event for event in list(self.events) if isinstance(event, kind)]
            if found := [each for each in found if all(getattr(each, key) == fields[key] for key in fields)]:
                return found[-1]
            time.sleep(0.002)
        raise AssertionError(f"no {kind.__name__} among {self.events}")

    def client(self):
        return usbip.attach("127.0.0.1", self.port.address.split()[-1], port=self.number)


def asks(handle, address, length, got):
    """Ask for data in another thread, as a driver's request waits in the device."""
    thread = threading.Thread(target=lambda: got.append(handle.bulk_in(address, length)))
    thread.start()
    return thread
