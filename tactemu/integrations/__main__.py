"""``python -m tactemu.integrations`` prints the folder that makes ``can.Bus(interface="socketcan")`` a door.

::

    PYTHONPATH=$(python -m tactemu.integrations) TACTEMU_SOCKETCAN=can0=linker_hand_l6 python driver.py
"""

from pathlib import Path

if __name__ == "__main__":
    print(Path(__file__).parent / "socketcan")
