"""A live page of a running emulator: ``tactemu see``, ``tactemu run --web``.

A process of its own, which is a client of the control channel like any other: it watches
(:mod:`tactemu.view.page.feed`), draws with viser, and has done what viewers do by hand. Only
:mod:`tactemu.view.page.guard` knows how viser serves.
"""
