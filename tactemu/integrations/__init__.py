"""Doors that pyserial and python-can open by themselves: the device starts with the port and ends with it.

``protocol_tactemu`` is ``serial.serial_for_url("tactemu://anyskin")``, ``can_bus`` is
``can.Bus(interface="tactemu", channel="linker_hand_l6")``. Both run the device in the driver's own process, on
:func:`tactemu.serve`; its default scene moves as under ``tactemu run``.
"""
