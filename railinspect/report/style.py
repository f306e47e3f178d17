"""The report's style sheet; the colours of types, statuses and actions are the overlay's."""

from __future__ import annotations

from typing import Final

from railinspect.sinks.overlay import ACTION_RGB, STATUS_RGB, TYPE_RGB, Colour

_BASE: Final = """
:root { --ink:#1c2430; --soft:#5b6675; --line:#dde3ea; --paper:#fff; --ground:#f3f5f8; }
* { box-sizing:border-box; }
body { margin:0; background:var(--ground); color:var(--ink);
  font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif; }
main { max-width:1180px; margin:0 auto; padding:28px 24px 60px; }
header h1 { font-size:26px; margin:0; letter-spacing:-.01em; overflow-wrap:anywhere; }
header p { margin:4px 0 0; color:var(--soft); }
h2 { font-size:18px; margin:0 0 12px; }
h3 { font-size:15px; margin:18px 0 8px; overflow-wrap:anywhere; }
section { background:var(--paper); border:1px solid var(--line); border-radius:10px;
  padding:18px 20px; margin-top:18px; }
.verdict { border-left:6px solid #46c878; font-size:16px; }
.verdict.attention { border-left-color:#ff783c; }
.verdict.doubt { border-left-color:#8a93a3; }
.verdict ul { margin:6px 0 0; padding-left:20px; font-size:14px; }
.cards { display:grid; grid-template-columns:repeat(auto-fit,minmax(140px,1fr)); gap:12px;
  margin-top:18px; }
.card { background:var(--paper); border:1px solid var(--line); border-radius:10px;
  padding:12px 16px; }
.card b { display:block; font-size:24px; line-height:1.2; font-variant-numeric:tabular-nums; }
.card span { color:var(--soft); font-size:13px; }
table { border-collapse:collapse; width:100%; font-size:14px; }
th { text-align:left; color:var(--soft); font-weight:600; font-size:12.5px;
  border-bottom:2px solid var(--line); padding:6px 10px; vertical-align:bottom; }
td { border-bottom:1px solid var(--line); padding:8px 10px; vertical-align:top;
  font-variant-numeric:tabular-nums; overflow-wrap:anywhere; }
tr:last-child td { border-bottom:0; }
#events td:first-child { font-weight:600; }
#events td { min-width:40px; }
#events td:nth-last-child(-n+6):not(:nth-last-child(-n+2)) { white-space:nowrap; }
#events td:nth-last-child(2) { min-width:118px; overflow-wrap:normal; }
#events td:last-child { min-width:150px; }
tr:target td { background:#fff7e6; }
td small { color:var(--soft); display:block; font-size:12.5px; }
td img { display:block; width:150px; height:auto; border-radius:6px; }
.clips { display:grid; grid-template-columns:repeat(auto-fill,minmax(260px,1fr)); gap:14px; }
.clips figure { margin:0; }
.clips video, .clips img { display:block; width:100%; height:auto; border-radius:8px; }
.clips figcaption { font-size:13px; color:var(--soft); margin-top:4px; overflow-wrap:anywhere; }
.columns { display:grid; grid-template-columns:repeat(auto-fit,minmax(330px,1fr)); gap:6px 28px; }
td .bar { display:flex; height:11px; border-radius:3px; overflow:hidden; background:#eef1f5;
  min-width:90px; }
td .bar i { display:block; height:100%; }
td.late, td span.late { color:#b3261e; font-weight:600; }
.scroll { overflow-x:auto; }
.badge { display:inline-block; border-radius:999px; padding:1px 10px; font-weight:600;
  font-size:13px; color:#191c20; white-space:nowrap; }
.legend { display:flex; flex-wrap:wrap; gap:6px 16px; font-size:13px; color:var(--soft);
  margin:8px 0 0; }
.legend i { display:inline-block; width:11px; height:11px; border-radius:3px; margin-right:6px; }
.legend i.mark { border-radius:0; width:13px; clip-path:polygon(0 0,100% 0,50% 100%); }
td small.late { color:#b3261e; font-weight:600; }
dl { display:grid; grid-template-columns:max-content 1fr; gap:4px 18px; margin:0; font-size:14px; }
dt { color:var(--soft); } dd { margin:0; overflow-wrap:anywhere; }
.alert { background:#fdecec; border:1px solid #f3b9b9; border-radius:8px; padding:10px 14px;
  margin:10px 0 0; }
.alert ul { margin:4px 0 0; padding-left:20px; }
svg.timeline { display:block; width:100%; height:auto; }
svg.timeline text { font:11.5px system-ui,-apple-system,"Segoe UI",Roboto,Arial,sans-serif;
  fill:#5b6675; }
svg.timeline text.label { font-weight:600; fill:#333d4a; }
svg.timeline .grid { stroke:#e4e9ef; stroke-width:1; }
svg.timeline .none { fill:#fff; stroke:#c9d1da; stroke-dasharray:3 3; }
svg.timeline line.lead { stroke-width:1; stroke-dasharray:2 2; }
svg.timeline .break line { stroke:#d02a2a; stroke-width:2; stroke-dasharray:5 3; }
footer { color:var(--soft); font-size:13px; margin-top:22px; }
@media print { body { background:#fff; } section,.card { break-inside:avoid; } }
"""


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def style_sheet() -> str:
    """The whole style sheet, with a class per type, status and action."""
    rules = [_BASE]
    for name, colour in TYPE_RGB.items():
        rules.append(f".t-{name} {{ fill:{_hex(colour)}; background:{_hex(colour)}; }}")
    for name, colour in STATUS_RGB.items():
        rules.append(f".s-{name} {{ fill:{_hex(colour)}; background:{_hex(colour)}; }}")
    for name, colour in ACTION_RGB.items():
        rules.append(f".a-{name} {{ background:{_hex(colour)}; }}")
        rules.append(f".m-{name} {{ fill:{_hex(colour)}; stroke:{_hex(colour)}; stroke-width:2; }}")
    return "\n".join(rules)
