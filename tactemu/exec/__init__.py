"""A private view of the machine in which emulated sensors are hardware: ``tactemu exec``.

Two processes and a library make it. The *keeper* (:mod:`~tactemu.exec.keeper`) runs in namespaces of its own, in which
``/dev``, ``/sys`` and ``/run/udev`` have the emulated devices beside those of the machine; it acts as the view's kernel
and udev. The emulator plugs devices in (:mod:`~tactemu.exec.port`). The driver is started inside
(:mod:`~tactemu.exec.enter`) with a preload library (``preload/``), which answers the requests that a pseudo terminal
refuses, and reports changes to the emulator.

::

    emulator ──plug, unplug──▶ keeper ──nodes, sysfs, udev's events──▶ driver
        ▲                                                                 │
        └──────── pseudo terminal; modem lines, parity, break ────────────┘
"""
