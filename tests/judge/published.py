"""Program that runs a published driver, unmodified, as a user's program would: ``published.py NAME PORT [BAUD]``.

Each reading is printed as a line of JSON, each exception on stderr. When the driver reports that the connection is
lost, or fails five times in a row, it is closed and opened anew; it gets no other help.
"""

import contextlib
import json
import logging
import os
import queue
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

OUT = sys.stdout
PAUSE_S = 0.02
"""Pause before a lost port is opened again [s]."""


class AnySkin:
    def __init__(self, port, baud):
        from anyskin.sensor import AnySkinBase

        self.driver = AnySkinBase(num_mags=5, port=port, temp_filtered=False, baudrate=baud or 115200)

    def read(self):
        return self.driver.get_sample()[1].tolist()

    def close(self):
        self.driver.close()


class ReSkin(AnySkin):
    def __init__(self, port, baud):
        from reskin_sensor.sensor import ReSkinBase

        self.driver = ReSkinBase(num_mags=5, port=port, baudrate=baud or 115200)

    def read(self):
        return [float(value) for value in self.driver.get_sample()[2]]


class Robotiq:
    def __init__(self, port, baud):
        from pyrobotiqtactile import RobotiqTactileSensor

        self.driver = RobotiqTactileSensor(port=port, baud_rate=baud or 115200)
        self.driver.connect()
        self.driver.configure(update_period_ms=10)
        while not self.driver.read_frame(timeout=1.0).timestamp.any():
            pass

    def read(self):
        return self.driver.read_frame(timeout=1.0).pressure.reshape(-1).tolist()

    def close(self):
        self.driver.close()


class AbilityHand:
    def __init__(self, port, baud):
        from ah_wrapper import AHSerialClient, Observer

        readings = self.readings = queue.Queue()

        class Log(Observer):
            def update_fsr(self, fsr):
                readings.put(list(fsr))

            def update_pos(self, position):
                pass

            update_vel = update_cur = update_hot_cold = update_pos

        self.driver = AHSerialClient(port=port, baud_rate=baud or 460800, rate_hz=100, auto_start_threads=False)
        logging.getLogger().handlers[:] = [logging.StreamHandler()]  # its own messages, unformatted
        self.driver.hand._first_fsr = False  # report what the hand sends, not the change since the first frame
        self.driver.hand.add_observer(Log())
        self.driver.start_threads()

    def read(self):
        return self.readings.get()

    def close(self):
        self.driver.close()


class FlexiTac:
    def __init__(self, port, baud):
        from flexitac.sensor import FlexiTacSensor

        self.driver = FlexiTacSensor(port, baseline=20.0, read_timeout_s=1.0, baud=baud or 2_000_000)
        self.driver.open()

    def read(self):
        return self.driver.read().raw.reshape(-1).tolist()

    def close(self):
        self.driver.close()


class OptoForce:
    def __init__(self, port, baud):
        import optoforce

        self.driver = optoforce.OptoForce16(port=port, speed_hz=100, filter_hz="none")
        self.driver.connect()

    def read(self):
        packet = self.driver.read(only_latest_data=False)
        return {"fx": packet.Fx, "fy": packet.Fy, "fz": packet.Fz, "n": packet.count, "valid": packet.valid_checksum}

    def close(self):
        self.driver.close()


class PyModbus:
    def __init__(self, port, baud):
        from pymodbus.client import ModbusSerialClient

        logging.disable(logging.CRITICAL)
        self.driver = ModbusSerialClient(port, baudrate=baud or 115200, timeout=0.5, retries=0)
        if not self.driver.connect():
            raise ConnectionError("not connected")

    def read(self):
        answer = self.driver.read_holding_registers(4900, count=112, device_id=1)
        if answer.isError():
            raise RuntimeError(str(answer))
        return answer.registers

    def close(self):
        self.driver.close()


class ModbusTk:
    def __init__(self, port, baud):
        import serial
        from modbus_tk import modbus_rtu

        self.port = serial.Serial(port, baud or 115200)
        self.driver = modbus_rtu.RtuMaster(self.port)
        self.driver.set_timeout(0.5)

    def read(self):
        return self.driver.execute(1, 3, 4128, 96)

    def close(self):
        self.port.close()


class InspireTcp:
    def __init__(self, port, baud):
        from RH56DFTP.RH56DFTP_TCP import RH56DFTP_TCP

        logging.disable(logging.CRITICAL)
        url = urlsplit(port)
        self.driver = RH56DFTP_TCP(host=url.hostname, port=url.port)

    def read(self):
        return self.driver.get("TACTILE_INDEX_FINGER_TIP_12x8")[:96]

    def close(self):
        self.driver.close()


class LinkerHand:
    def __init__(self, port, baud):
        import linkerbot

        interface, _, channel = port.partition(":")
        self.driver = linkerbot.L6("left", channel, interface)
        self.driver.stop_polling()

    def read(self):
        data = self.driver.force_sensor.get_blocking(timeout_ms=500)
        return {finger: getattr(data, finger).values.reshape(-1).tolist() for finger in FINGERS}

    def close(self):
        self.driver.close()


class PaxiniCamera:
    """The camera of LeRobot: a fingertip as an image, one pixel for each taxel, read thirty times a second."""

    def __init__(self, port, baud):
        from lerobot_camera_paxini import PaxiniCamera as Camera
        from lerobot_camera_paxini import PaxiniCameraConfig

        config = PaxiniCameraConfig(port=port, width=64, height=96, fps=30, splat_sigma_px=0.0, force_max_n=25.0)
        self.driver = Camera(config)
        self.driver.connect()
        self.taxels = self.driver._raster._weights.any(axis=1)

    def read(self):
        time.sleep(1 / 30)
        return self.driver.async_read().reshape(-1, 3)[self.taxels].ravel().tolist()

    def close(self):
        self.driver.disconnect()


FINGERS = ("thumb", "index", "middle", "ring", "pinky")
READERS = {
    "anyskin": AnySkin, "reskin-sensor": ReSkin, "pyrobotiqtactile": Robotiq, "ability-hand": AbilityHand,
    "flexitac": FlexiTac, "optoforce": OptoForce, "pymodbus": PyModbus, "modbus_tk": ModbusTk,
    "plusml-rh56dftp": InspireTcp, "linkerbot": LinkerHand, "lerobot-camera-paxini": PaxiniCamera,
}  # fmt: skip


def lost(error):
    """Return True if an exception reports a lost connection, rather than a missing or bad answer."""
    return type(error).__name__ == "ConnectionException" or (
        isinstance(error, OSError) and not isinstance(error, TimeoutError)
    )


def run_driver(kind, port, baud):
    driver, failures = None, 0
    while True:
        try:
            driver = driver or kind(port, baud)
            reading = driver.read()
        except (Exception, SystemExit) as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            failures += 1
            if driver is None or lost(error) or failures == 5:
                if driver is not None:
                    with contextlib.suppress(Exception):
                        driver.close()
                driver, failures = None, 0
                time.sleep(PAUSE_S)
        else:
            failures = 0
            print(json.dumps(reading), file=OUT, flush=True)


if __name__ == "__main__":
    folder = Path(tempfile.gettempdir()) / f"tactemu-published-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    os.chdir(folder)  # one driver writes a configuration and a log to its working folder
    sys.stdout = sys.stderr  # drivers print their own messages
    run_driver(READERS[sys.argv[1]], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else None)
