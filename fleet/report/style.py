"""Style: colours and shapes of a report, for light and for dark screens."""

STYLE = """
:root { color-scheme: light dark; --paper: #ffffff; --ink: #1f2328; --quiet: #656d76; --grid: #e3e6ea; --card:
  #f6f7f9; --wall: #8b949e; --shelf: #d8c9b4; --heat: #c2410c; --heat2: #0f766e; --line: #0072b2; --warn: #b42318;
  --b0: #c5cad1; --b1: #0067a8; --b2: #6bb5e6; --b3: #1a9c74; --b4: #d9480f; --b5: #b57edc; --b6: #f2a900; --b7:
  #d6c716; --b8: #9f1239; --b9: #8a9a3b; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171c; --ink: #e6e8eb; --quiet: #98a1ab; --grid: #2c323a;
  --card: #1c2128; --wall: #56606c; --shelf: #4d4336; --heat: #fb8a4c; --heat2: #2dd4bf; --line: #5cb3ea; --warn:
  #ff8f80; --b0: #4a525c; --b1: #2f8fd6; --b2: #8fd0f7; --b3: #2fc294; --b4: #f4713a; --b5: #c79bea; --b6: #f6bb3b;
  --b7: #e5d94a; --b8: #e0527f; --b9: #a9ba54; } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif; color: var(--ink);
  background: var(--paper); max-width: 72rem; margin: 2rem auto 4rem; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin: 0; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .2rem; }
h3 { font-size: 1rem; margin: 1rem 0 .2rem; }
p { margin: .2rem 0 .8rem; }
.quiet, figcaption { color: var(--quiet); font-size: 13.5px; }
.warn { color: var(--warn); font-weight: 600; }
svg { max-width: 100%; height: auto; display: block; }
figure { margin: .4rem 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(8rem, 1fr)); gap: .7rem; margin: 1.2rem 0; }
.tile { background: var(--card); border-radius: .6rem; padding: .6rem .9rem; }
.tile b { display: block; font-size: 1.3rem; white-space: nowrap; line-height: 1.3; font-variant-numeric:
  tabular-nums; }
.tile span { color: var(--quiet); font-size: 13px; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(28rem, 100%), 1fr)); gap: .6rem 1.6rem;
  align-items: start; }
.three { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(17rem, 100%), 1fr)); gap: .6rem 1.6rem;
  align-items: start; }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin: .5rem 0; font-size: 13.5px; }
.legend i { display: inline-block; width: .8rem; height: .8rem; border-radius: .15rem; margin-right: .4rem;
  vertical-align: -1px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 13.5px; }
th, td { padding: .22rem .6rem; text-align: right; border-bottom: 1px solid var(--grid); white-space: nowrap; }
th { color: var(--quiet); font-weight: 600; vertical-align: bottom; white-space: normal; }
.l { text-align: left; }
.w { white-space: normal; }
tr.sum td { font-weight: 600; }
td.bar { width: 40%; padding-right: 0; text-align: left; }
td.bar i { display: inline-block; height: .75rem; vertical-align: middle; }
details { margin: .6rem 0; }
summary { cursor: pointer; color: var(--quiet); }
code { background: var(--card); padding: .1rem .35rem; border-radius: .2rem; }
@media print { details { display: block; } }
"""
