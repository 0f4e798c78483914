"""``tactemu judge``: tests of a driver under faults of the wire and the device, with every sample known.

::

    excitation ─▶ serve() ─▶ exact faults ─▶ port ═══ driver ─▶ rows
         │            │                                           │
         └─ truth ────┴───────────▶ record ◀──────────────────────┘
                                      │
                      columns ─▶ matching ─▶ verdicts ─▶ smallest case, reports, baseline

Each trial gives a :class:`~tactemu.judge.trial_record.TrialRecord`, one JSONL file; its verdicts are a pure function of
it. The judge shares no decoder with the devices: it learns from a clean run which column holds which channel.
"""
