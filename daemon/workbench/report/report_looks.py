"""How a report's page looks: its style sheet, in words that every browser knows."""

from typing import Final

PAGE_STYLE: Final = """\
:root { --ink: #1f2933; --muted: #616e7c; --line: #e4e7eb; --soft: #f5f7fa; --accent: #0b6bcb;
  --warning: #9a5b0f; --warning-soft: #fdf3e3; --alarm: #a32020; --alarm-soft: #fcebeb;
  --good: #1d7a49; --good-soft: #e8f6ee; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--soft); color: var(--ink); line-height: 1.45;
  font: 15px/1.45 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 28px 20px 60px; }
header { margin-bottom: 18px; }
h1 { font-size: 26px; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 17px; margin: 0 0 10px; }
p { margin: 0 0 10px; }
.about { color: var(--muted); }
.badge { display: inline-block; padding: 2px 10px; margin-left: 6px; border-radius: 999px;
  font-size: 12px; font-weight: 600; letter-spacing: 0.04em; vertical-align: 4px;
  background: var(--line); color: var(--muted); }
.badge.good { background: var(--good-soft); color: var(--good); }
.badge.warning { background: var(--warning-soft); color: var(--warning); }
.badge.alarm { background: var(--alarm-soft); color: var(--alarm); }
section { background: #fff; border: 1px solid var(--line); border-radius: 10px;
  padding: 18px 20px; margin: 0 0 16px; }
.notice { border-left: 4px solid var(--warning); background: var(--warning-soft);
  color: var(--warning); padding: 10px 14px; margin: 0 0 16px; border-radius: 6px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px;
  margin: 0 0 16px; }
.tile { background: #fff; border: 1px solid var(--line); border-radius: 10px; padding: 12px 16px; }
.tile b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; }
.tile span { color: var(--muted); font-size: 13px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { color: var(--muted); font-weight: 600; font-size: 13px; white-space: nowrap; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.bar { width: 34%; padding-left: 12px; vertical-align: middle; }
td.bar i { display: block; height: 10px; border-radius: 3px; background: var(--accent); }
tr.state td { background: #eef5fc; font-weight: 600; }
tr.warning td { background: var(--warning-soft); }
tr.alarm td { background: var(--alarm-soft); }
.facts { width: auto; }
.facts td { border: 0; padding: 2px 18px 2px 0; overflow-wrap: anywhere; }
.facts td:first-child { color: var(--muted); white-space: nowrap; }
figure { margin: 0; }
figure img { width: 100%; height: auto; display: block; }
figcaption, .note { color: var(--muted); font-size: 13px; margin-top: 8px; }
details summary { cursor: pointer; color: var(--accent); }
pre { overflow: auto; font-size: 12px; background: var(--soft); padding: 12px; }
@media print { body { background: #fff; } section, .tile { break-inside: avoid; } }
"""
