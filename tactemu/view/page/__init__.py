"""A live page of a running emulator: ``tactemu see``, ``tactemu run --web``.

The page is a process of its own and a client of the control channel like any other: it watches the emulator
(:mod:`tactemu.view.page.feed`), draws with viser, and sends the commands of viewers. Only
:mod:`tactemu.view.page.guard` depends on how viser serves.
"""
