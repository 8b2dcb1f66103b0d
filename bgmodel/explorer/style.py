"""How the explorer's page looks: light, high contrast, one column on a phone."""

from __future__ import annotations

TABLE = """
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
table + table, .why + table { margin-top: 14px; }
th, td { text-align: left; padding: 3px 10px 3px 0; vertical-align: top; }
thead th { border-bottom: 1.5px solid #1b1b1b; }
tbody th { font-weight: 500; }
small { display: block; color: #444; font-size: 11.5px; white-space: nowrap; }
em { color: #7a3b00; font-style: normal; }
.wide { overflow-x: auto; }
.scroll { overflow: auto; max-height: 440px; border: 1px solid #d4d7dc; padding: 0 8px; }
.scroll table { width: max-content; }
.scroll td { max-width: 36em; }
.why { color: #444; font-size: 13px; }
"""
"""Tables in panels and controls."""
PANEL = (
    TABLE
    + """
:host { width: 100%; transition: opacity .12s; }
:host(.busy) { opacity: .45; }
img { width: 100%; height: auto; display: block; }
p { margin: 6px 0; font-size: 14px; line-height: 1.4; color: #1b1b1b; }
footer { font-size: 12px; color: #555; display: flex; gap: 12px; flex-wrap: wrap; }
footer a { color: #00568a; }
summary { cursor: pointer; font-size: 13px; color: #00568a; margin: 4px 0; }
.refused { border-left: 4px solid #b23b00; background: #fff4ec; padding: 8px 10px; }
.waiting { color: #555; min-height: 120px; }
code { font-family: ui-monospace, 'DejaVu Sans Mono', monospace; }
"""
)
"""Panels."""
NOTICE = """
:host { width: 100%; }
p { margin: 0 0 6px; padding: 8px 12px; font-size: 14px; line-height: 1.4; border-radius: 4px; }
.refusal { border-left: 4px solid #b23b00; background: #fff4ec; color: #5c1f00; }
.warning { border-left: 4px solid #8a6d00; background: #fffbe6; color: #4a3b00; }
.status { padding: 0; margin: 0; color: #444; }
"""
"""Refusals, warnings, and the status."""
CHIP = """
.bk-btn { text-align: left; white-space: normal; background: #eef4f9; border: 1px solid #9dbbd3; }
"""
"""A button that removes an edit."""
PAGE = """{% extends base %}
{% block postamble %}
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
  * { box-sizing: border-box; }
  html, body { height: auto; }
  body { font-family: system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif; color: #1b1b1b;
         background: #f4f5f7; }
  .skip { position: absolute; left: -9999px; }
  .skip:focus { left: 8px; top: 8px; background: #fff; padding: 8px; z-index: 9; }
  header { background: #fff; border-bottom: 1px solid #d4d7dc; padding: 10px 20px; display: flex;
           gap: 4px 24px; align-items: center; flex-wrap: wrap; position: sticky; top: 0;
           z-index: 5; }
  h1 { font-size: 19px; margin: 0; }
  .lost { flex: 1 0 100%; margin: 4px 0; padding: 8px 12px; border-left: 4px solid #b23b00;
          background: #fff4ec; color: #5c1f00; font-size: 14px; }
  h2 { font-size: 15px; margin: 0 0 8px; }
  .tools { min-width: 270px; }
  .status { flex: 1; min-width: 200px; }
  .jump { display: none; color: #00568a; font-size: 14px; }
  .page { display: grid; grid-template-columns: 340px minmax(0, 1fr); gap: 16px; padding: 16px 20px;
          max-width: 1640px; margin: 0 auto; align-items: start; }
  .card, aside details { background: #fff; border: 1px solid #d4d7dc; border-radius: 6px;
          padding: 12px 14px; margin: 0 0 12px; }
  aside summary { font-size: 15px; font-weight: 600; cursor: pointer; }
  aside details[open] summary { margin-bottom: 6px; }
  .panels { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 0 16px; }
  .panels .card { margin: 0 0 16px; }
  .hint { margin: 0 10px 8px; font-size: 13px; color: #444; }
  :focus-visible { outline: 3px solid #0072B2; outline-offset: 2px; }
  @media (max-width: 1240px) {
    .panels { display: flex; flex-direction: column; }
    .column { display: contents; }
    .times, .tradeoff { order: 1; }
    .ranking { order: 2; }
    .trial { order: 2; }
    .export { order: 3; }
  }
  @media (max-width: 860px) {
    .page { grid-template-columns: minmax(0, 1fr); padding: 10px; }
    header { position: static; padding: 10px; }
    .jump { display: inline; }
    main { order: 1; } aside { order: 2; }
  }
</style>
<script>
  /* Widgets are in shadow roots: there, focus is shown and what has no name gets one. */
  const focus = new CSSStyleSheet();
  focus.replaceSync(":focus-visible { outline: 3px solid #0072B2 !important; }");
  const tidy = (root) => {
    if (!root.adoptedStyleSheets.includes(focus)) root.adoptedStyleSheets.push(focus);
    root.querySelectorAll("button:empty").forEach((step) => {  /* arrow keys do the same */
      step.tabIndex = -1;
      step.setAttribute("aria-hidden", "true");
    });
    root.querySelectorAll("*").forEach((e) => { if (e.shadowRoot) tidy(e.shadowRoot); });
  };
  document.addEventListener("focusin", () => tidy(document));
  setInterval(() => tidy(document), 1000);
</script>
{% endblock %}
{% block contents %}
<a class="skip" href="#results">To the results</a>
<a class="skip" href="#controls">To the settings</a>
<header>
  <h1>bgmodel explorer</h1>
  <div class="tools">{{ embed(roots.tools) }}</div>
  <div class="status">{{ embed(roots.status) }}</div>
  <a class="jump" href="#controls">To the settings</a>
</header>
<div class="page">
  <aside id="controls" aria-label="Settings">
    <details open><summary>Open</summary>{{ embed(roots.open) }}</details>
    <details open><summary>Edits of the circuit</summary>
      <p class="hint">Edits add up. Together they are the manipulation, which is compared with the
        control.</p>
      {{ embed(roots.edits) }}</details>
    <details open><summary>A row of the circuit</summary>{{ embed(roots.row) }}</details>
    <details><summary>Add a pathway</summary>{{ embed(roots.pathway) }}</details>
    <details open><summary>Task and decision</summary>
      <p class="hint">Conflict: evidence also speaks for one wrong alternative, this many times as
        strongly as for the true one.</p>
      {{ embed(roots.task) }}</details>
    <details><summary>Stop signals</summary>{{ embed(roots.stop) }}</details>
  </aside>
  <main id="results" aria-label="Results">
    {{ embed(roots.notices) }}
    <div class="panels">
      {% for column in columns %}
      <div class="column">
        {% for name in column %}
        <section class="card {{ name }}" aria-label="{{ titles[name] }}">
          <h2>{{ titles[name] }}</h2>{{ embed(roots[name]) }}
        </section>
        {% endfor %}
        {% if loop.first %}
        <section class="card ranking" aria-label="Which loss slows decisions?">
          <h2>Which loss slows decisions?</h2>{{ embed(roots.ranking) }}
        </section>
        {% endif %}
        {% if loop.last %}
        <section class="card export" aria-label="Take it with you">
          <h2>Take it with you</h2>{{ embed(roots.export) }}
        </section>
        {% endif %}
      </div>
      {% endfor %}
    </div>
  </main>
</div>
{% endblock %}
"""
"""The page, as a Jinja template: each part has a heading or a label."""
