"""``tactemu judge``: what a driver does when the wire goes wrong, with every sample known.

::

    excitation ─▶ serve() ─▶ exact faults ─▶ port ═══ driver ─▶ rows
         │            │                                           │
         └─ truth ────┴────────────▶ tape ◀───────────────────────┘
                                      │
                      columns ─▶ matching ─▶ verdicts ─▶ smallest case, reports, baseline

What a trial saw is a :class:`~tactemu.judge.tape.TrialRecord`, one JSONL file; its verdicts are a pure function of
it. The observer shares no decoder with the devices: which column holds which channel it learns from a clean run.
"""
