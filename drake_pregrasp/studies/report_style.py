"""How the study's report looks."""

STYLE = """
:root { --ink: #1f2328; --muted: #656d76; --line: #d8dee4; --bar: #d6e6f2; }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); max-width: 84rem;
       margin: 2.5rem auto 5rem; padding: 0 1.5rem; }
h1 { font-size: 2rem; line-height: 1.2; margin-bottom: .5rem; }
h2 { line-height: 1.2; margin: 3rem 0 .8rem; padding-top: .8rem;
     border-top: 1px solid var(--line); }
h3 { margin: 0; font-size: 1.05rem; }
.lead { max-width: 56rem; } .muted { color: var(--muted); margin: .1rem 0 .4rem; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(24rem, 1fr)); gap: 1rem;
         margin-top: 1.5rem; }
.card { border: 1px solid var(--line); border-radius: .5rem; padding: .9rem 1.1rem; }
.card ul { margin: 0; padding-left: 1.1rem; font-size: .92rem; } .card li { margin: .25rem 0; }
.scroll { overflow-x: auto; margin: 1rem 0 1.8rem; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; text-align: left; color: var(--muted); padding-bottom: .4rem; }
th, td { padding: .3rem .55rem; text-align: right; vertical-align: top; white-space: nowrap;
         border-bottom: 1px solid var(--line); }
thead th { border-bottom: 2px solid #8c959f; vertical-align: bottom; white-space: normal; }
th:first-child, td.arm, td.name, th.name { text-align: left; }
tr:has(> td.arm) td { border-top: 1px solid #8c959f; }
td.arm { font-weight: 600; } td.name { white-space: normal; }
td small, th small { display: block; color: var(--muted); font-weight: 400; }
td.beside small { display: inline-block; min-width: 4.2rem; margin-left: .3em; }
td.bar { background: linear-gradient(to right, var(--bar) var(--share), transparent var(--share)); }
td.weak { color: #9aa1a9; } td.weak small { color: inherit; }
.ahead { color: #00664b; font-weight: 600; } td.ahead { background: #e3f4ee; }
.behind { color: #a34700; font-weight: 600; } td.behind { background: #fbe9de; }
.swatch { display: inline-block; width: .7em; height: .7em; border-radius: 50%;
          margin-right: .5em; }
figure { margin: 1rem 0 2rem; } img { max-width: 100%; }
figcaption { color: var(--muted); font-size: .9rem; }
pre { background: #f6f8fa; padding: .8rem; overflow-x: auto; font-size: .8rem; }
"""
"""Style sheet of the page."""
