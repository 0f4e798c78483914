"""The style sheet of the page's panels, light and dark, and where they lie on a phone.

The classes are those that :mod:`panel`, :mod:`pictures`, :mod:`numbers`, :mod:`curves` and :mod:`wire` write. What
belongs to viser has its own names (``mantine-``); its colours are changed only where its text has too little contrast.
"""

from __future__ import annotations

from tactemu.base.style import THEMES


def _variables(k: int) -> str:
    """Return the colours as variables; 0: of a light page, 1: of a dark one."""
    names = {
        "text": "text", "dim": "muted", "line": "line", "link": "link", "question": "link", "answer": "good",
        "fault": "bad", "lost": "odd", "fill": "key",
    }  # fmt: skip
    return " ".join(f"--tt-{name}: {THEMES[theme][k]};" for name, theme in names.items())


_VISER = """
  --mantine-color-dimmed: var(--tt-dim) !important; --mantine-color-placeholder: var(--tt-dim) !important;
  --mantine-color-text: var(--tt-text) !important; --mantine-color-blue-outline: var(--tt-link) !important;
  --mantine-primary-color-filled: var(--tt-link) !important;
"""

_SHEET = '.mantine-Paper-root[style*="position: fixed"]'
"""The sheet in which viser shows all panels on a phone."""
_SECTIONS = f"{_SHEET} div:has(> div > .mantine-Tabs-root)"
"""The parts of the sheet: the controls, then each panel with its tabs."""

PHONE_PX = 576
"""The width up to which viser shows all panels in one sheet."""

STYLE = f"""
:root[data-mantine-color-scheme="light"] {{ {_variables(0)}{_VISER} }}
:root[data-mantine-color-scheme="dark"] {{ {_variables(1)}{_VISER} }}
.tt {{ color: var(--tt-text); font-size: 12px; line-height: 1.4; padding: 4px 10px 8px; }}
.tt p {{ margin: 4px 0; }}
.tt h4 {{ font-size: 12px; font-weight: 600; margin: 0; }}
.tt kbd {{ border: 1px solid var(--tt-line); border-radius: 3px; padding: 0 5px; background: var(--tt-fill);
  font-family: inherit; font-size: 11px; }}
.tt-dim {{ color: var(--tt-dim); }}
.tt-wrong {{ color: var(--tt-fault); font-weight: 600; }}
.tt-wide {{ overflow-x: auto; }}
.tt table {{ border-collapse: collapse; width: 100%; }}
.tt th {{ font-weight: 600; text-align: left; }}
.tt-keys td {{ padding: 1px 6px 1px 0; vertical-align: top; }}
.tt-keys td:first-child {{ white-space: nowrap; }}
.tt-status {{ font-size: 13px; min-height: 50px; }}
.tt-answer {{ border-left: 3px solid var(--tt-answer); padding-left: 6px; }}

.tt-kinds {{ display: flex; flex-direction: column; gap: 10px; }}
.tt-kinds.tt-beside {{ flex-direction: row; gap: 10px; }}
.tt-beside > .tt-kind {{ flex: 1 1 0; min-width: 0; }}
.tt-kind header {{ margin-bottom: 4px; display: flex; gap: 2px 8px; align-items: baseline; flex-wrap: wrap; }}
.tt-beside header {{ flex-direction: column; align-items: stretch; }}
.tt-bar {{ display: flex; align-items: center; gap: 4px; font-variant-numeric: tabular-nums; font-size: 11px;
  flex: 1 1 auto; max-width: 240px; white-space: nowrap; }}
.tt-ramp {{ flex: 1 1 0; min-width: 16px; height: 8px; border-radius: 2px; }}
.tt-patches {{ display: flex; flex-wrap: wrap; gap: 8px; align-items: flex-end; }}
.tt-rows {{ display: flex; flex-direction: column; gap: 10px; }}
.tt-finger {{ display: flex; flex-direction: column; gap: 4px; flex: 0 0 auto; max-width: 100%; }}
.tt-patch {{ margin: 0; min-width: 0; }}
.tt-patch img {{ display: block; width: 100%; object-fit: contain; object-position: left;
  image-rendering: pixelated; }}
.tt-patch figcaption {{ font-size: 11px; line-height: 1.2; color: var(--tt-dim); overflow-wrap: anywhere; }}

.tt-numbers {{ font-variant-numeric: tabular-nums; font-size: 11px; }}
.tt-numbers th, .tt-numbers td {{ text-align: right; padding: 1px 4px; white-space: nowrap; }}
.tt-numbers thead th {{ border-bottom: 1px solid var(--tt-line); }}
.tt-numbers small {{ font-weight: 400; color: var(--tt-dim); }}
.tt-numbers .tt-chosen {{ background: var(--tt-fill); font-weight: 600; }}
.tt-pairs td {{ padding: 1px 0; }}
.tt-pairs td:last-child {{ text-align: right; font-variant-numeric: tabular-nums; }}
.tt-pairs th {{ padding-top: 6px; }}

.tt-legend {{ display: flex; flex-wrap: wrap; gap: 2px 12px; font-size: 11px; font-variant-numeric: tabular-nums; }}
.tt-legend span {{ white-space: nowrap; }}
.tt-legend svg {{ vertical-align: middle; margin-right: 4px; }}

.uplot-container {{ margin-top: 2px !important; margin-bottom: 4px !important; }}

.tt-frame {{ display: grid; grid-template-columns: 72px minmax(0, 1fr); grid-template-rows: auto 1fr; gap: 0 6px;
  padding: 3px 0;  border-bottom: 1px solid var(--tt-line); font-size: 11px; }}
.tt-frame time {{ grid-column: 1; grid-row: 2; font-variant-numeric: tabular-nums; color: var(--tt-dim); }}
.tt-frame .tt-mark {{ font-weight: 600; white-space: nowrap; }}
.tt-frame code {{ font-size: 10.5px; color: var(--tt-dim); overflow-wrap: anywhere; word-break: normal; }}
.tt-frame .tt-what {{ grid-column: 2; grid-row: 1 / span 2; overflow-wrap: anywhere; }}
.tt-question .tt-mark {{ color: var(--tt-question); }}
.tt-sent .tt-mark {{ color: var(--tt-answer); }}
.tt-fault .tt-mark {{ color: var(--tt-fault); }}
.tt-lost .tt-mark {{ color: var(--tt-lost); }}
.tt-fault {{ border-left: 3px solid var(--tt-fault); padding-left: 4px; margin-left: -7px; }}
.tt-event .tt-mark, .tt-event .tt-what {{ color: var(--tt-dim); }}

pre.tt-sheet {{ font-size: 11px; line-height: 1.35; white-space: pre; width: max-content; margin: 0;
  color: var(--tt-text); }}
.mantine-Notification-description {{ color: var(--tt-text) !important; }}
.mantine-Tabs-tab {{ color: var(--tt-text); }}

.mantine-Button-root[data-size="compact-xs"] {{ padding-inline: 5px; }}
div:has(> .mantine-Text-root > label) {{ width: 5.4em !important; }}
.mantine-Notification-root[style*="orange"] {{ animation: tt-away 0.4s 6s forwards; }}
@keyframes tt-away {{ to {{ opacity: 0; visibility: hidden; max-height: 0; padding: 0; margin: 0; border-width: 0; }} }}

@media (min-width: {PHONE_PX + 1}px) {{
  :root .mantine-Notifications-root {{ max-width: min(20em, max(13em, 100vw - 690px - 2em)); }}
}}
@media (max-width: {PHONE_PX}px) {{
  div:has(> {_SHEET}) {{ flex-direction: column; }}
  {_SHEET} {{ position: static !important; width: 100% !important; max-height: 50vh !important; flex: 0 0 auto; }}
  {_SHEET} div[style*="width: 20em"] {{ width: 100vw !important; }}
  {_SECTIONS} {{ display: flex; flex-direction: column; }}
  {_SECTIONS} > div:has(> .mantine-Tabs-root) {{ display: contents; }}
  {_SECTIONS} > div:has(.tt-status) {{ order: 1; }}
  {_SECTIONS} .mantine-Tabs-root ~ .mantine-Tabs-root {{ order: 2; }}
}}
"""
"""The style sheet, which the page's head contains.

The warning of software WebGL, which viser leaves over the scene for ever, goes after six seconds. On a phone the panels
lie below the scene instead of over it, and the pictures of the taxels come first: above the controls and the wire.
"""
