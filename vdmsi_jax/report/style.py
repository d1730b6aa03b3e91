"""The look of reports: one column, legible on paper and on a telephone."""

STYLE = """
:root { color-scheme: light; --ink: #1b1f24; --muted: #667080; --line: #e1e5ea; --tint: #f6f8fa;
  --accent: #0072b2; --warm: #d55e00; }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; }
body { margin: 0; background: var(--tint); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 0 1.25rem 3rem; }
header { padding: 2.5rem 0 1rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .4rem; letter-spacing: -.01em; }
header p { color: var(--muted); margin: 0 0 1rem; }
nav { display: flex; flex-wrap: wrap; gap: .4rem .5rem; }
nav a { color: var(--accent); text-decoration: none; font-size: .88rem; background: white;
  border: 1px solid var(--line); border-radius: 1rem; padding: .15rem .75rem; }
nav a:hover { border-color: var(--accent); }
section { background: white; border: 1px solid var(--line); border-radius: .6rem;
  padding: 1.4rem 1.6rem 1.6rem; margin: 1.25rem 0; }
h2 { font-size: 1.25rem; margin: 0 0 .8rem; }
p { margin: .5rem 0; }
p.caption, figcaption { color: var(--muted); font-size: .88rem; margin: 1rem 0 .3rem; }
p.note, p.warning { border-left: 4px solid var(--accent); background: var(--tint);
  padding: .5rem .9rem; border-radius: 0 .3rem .3rem 0; }
p.warning { border-color: var(--warm); background: #fdf3ec; }
figure { margin: 1.2rem 0 .6rem; break-inside: avoid; }
figure svg { width: 100%; height: auto; display: block; }
figcaption { margin: .3rem 0 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .92rem; margin: .3rem 0 .8rem; }
th { text-align: left; color: var(--muted); font-weight: 600; font-size: .82rem; }
th, td { padding: .32rem .8rem .32rem 0; border-bottom: 1px solid var(--line); vertical-align: top;
} td.number { font-variant-numeric: tabular-nums; white-space: nowrap; } tr.strong td { font-weight:
650; background: #eef6fb; } details { margin: .8rem 0; } summary { cursor: pointer; color:
var(--accent); font-size: .92rem; } .tiles { display: grid; grid-template-columns: repeat(auto-fit,
minmax(11rem, 1fr)); gap: .8rem;
  margin: .4rem 0 1rem; }
.tiles div { background: var(--tint); border-radius: .5rem; padding: .7rem .9rem; }
.tiles b { display: block; font-size: 1.5rem; line-height: 1.3; font-variant-numeric: tabular-nums;
} .tiles span { display: block; font-size: .82rem; color: var(--muted); } .formula { font-family:
Cambria, "Times New Roman", serif; font-size: 1.1rem; margin: 1rem 0; } .fraction { display:
inline-flex; flex-direction: column; vertical-align: middle; text-align: center; } .fraction
span:first-child { border-bottom: 1px solid var(--ink); padding: 0 .5rem .1rem; } .fraction
span:last-child { padding: .1rem .5rem 0; } footer { color: var(--muted); font-size: .82rem;
text-align: center; padding-top: 1rem; } @media print { body { background: white; font-size: 11px; }
nav { display: none; }
  section { border: 0; padding: 0; } main { max-width: none; } }
"""
