"""``tactemu://anyskin`` for pyserial: a serial port with a simulated device on it, in this process.

pyserial finds this module after ``serial.protocol_handler_packages.append("tactemu.integrations")``. Options follow a
question mark (:func:`tactemu.integrations.target.device_for`). With ``by_hand=yes`` nothing moves until you move it by
``port.served`` (:class:`tactemu.session.serving.Served`).
"""

from __future__ import annotations

import serial

from tactemu.base.errors import TactemuError
from tactemu.integrations.target import device_for
from tactemu.session.serving import Served


class Serial(serial.Serial):
    """A port of pyserial on a pseudo terminal, with the modem lines that such a terminal does not have.

    The device is powered on by :meth:`open` and off by :meth:`close`.
    """

    def __init__(self, *args, **kwargs):
        self.served: Served | None = None
        """The device while the port is open."""
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Start the device and open its port.

        Raises:
            SerialException: there is no such device or scene, or an option has a wrong value.
        """
        url = self.portstr
        if url is None or self.is_open:
            super().open()  # raises what pyserial raises
            return
        try:
            self.served = device_for(url).start()
            self.portstr = self.served.port
            super().open()
        except TactemuError as error:
            raise serial.SerialException(f"could not open port {url}: {error}") from error
        finally:
            self.portstr = url
            if not self.is_open:
                self._stop()

    def close(self) -> None:
        """Close the port and stop the device.

        Raises:
            SerialException: the device had failed before.
        """
        super().close()
        self._stop()

    def _stop(self) -> None:
        device, self.served = self.served, None
        if device is not None:
            try:
                device.stop()
            except TactemuError as error:
                raise serial.SerialException(f"{self.portstr}: the device has failed: {error}") from error

    def _update_dtr_state(self) -> None:
        self._set_lines()

    def _update_rts_state(self) -> None:
        self._set_lines()

    def _set_lines(self) -> None:
        if self.served is not None:
            self.served.set_lines(dtr=bool(self.dtr), rts=bool(self.rts))

    @property
    def cts(self) -> bool:
        """The line "clear to send", always raised."""
        return True

    @property
    def dsr(self) -> bool:
        """The line "data set ready", always raised."""
        return True

    @property
    def ri(self) -> bool:
        """The line "ring indicator", never raised."""
        return False

    @property
    def cd(self) -> bool:
        """The line "carrier detect", always raised."""
        return True
