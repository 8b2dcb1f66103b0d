// What the page shows: sliders in, drawings out. The numbers come from model.js.
"use strict";

// Where nuclei stand; those of other names stand below, in the free column nearest to what they connect.
const PLACES = { ctx: [20, 110], D1: [150, 30], D2: [150, 190], STN: [280, 110], GPe: [410, 190], SNr: [540, 110] };
const LABELS = { ctx: "cortex", D1: "striatum, D1", D2: "striatum, D2", SNr: "SNr, output" };
const COLUMNS = [20, 150, 280, 410, 540], BELOW = 310, ROW = 110;
const COLOURS = ["var(--one)", "var(--two)", "var(--three)", "var(--four)"];
const TASK = { seed: 2024, trials: 300, readings: 40 };
const STEP_MS = 50, WIDTH = 84, HEIGHT = 70, MOST_HZ = 120, APART = 8, COMMON = "#888";
// Accuracy and time are drawn where at least this share of trials is decided.
const SHARE_DRAWN = 0.5;

const byId = (id) => document.getElementById(id);
const number = (id) => Number(byId(id).value);

function settings() {
  const lesions = {};
  for (const name of ["STN", "GPe", "D1", "D2"]) lesions[name] = number(name);
  return { lesions, dopamine: number("dopamine"), posterior: number("posterior"), channels: byId("channels").value,
    dPrime: number("dPrime"), conflict: number("conflict"), lead: number("lead") };
}

function totals(channels, lead, conflict) {
  return Array.from({ length: channels }, (_, i) => (i === 0 ? lead : i === 1 ? conflict * lead : 0));
}

function ratesAt(table, total) {
  const x = fixedPoint(table, driveOf(table, total));
  return x === null ? null : ratesOf(table, x);
}

function perNucleus(table, rates, name) {
  return rates.filter((_, b) => table.populations[table.owner[b]] === name);
}

function line(x1, y1, x2, y2, more) {
  return `<line x1="${x1}" y1="${y1}" x2="${x2}" y2="${y2}" ${more || 'class="axis"'}/>`;
}

const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");

// The place of every nucleus of the table.
function places(table) {
  const found = {}, others = [];
  for (const name of table.populations) {
    if (PLACES[name]) found[name] = PLACES[name];
    else others.push(name);
  }
  const rows = Math.ceil(others.length / COLUMNS.length);
  const free = Array.from({ length: rows }, (_, k) => COLUMNS.map((x) => [x, BELOW + k * ROW])).flat();
  for (const name of others) {
    const near = table.pathways.flatMap((p) => (p.from === name ? [p.to] : p.to === name ? [p.from] : []))
      .filter((other) => PLACES[other]).map((other) => PLACES[other][0]);
    const x = near.length ? near.reduce((a, b) => a + b) / near.length : 0;
    const off = (place) => Math.abs(place[0] - x) + 10 * (place[1] - BELOW);
    free.sort((a, b) => off(a) - off(b));
    found[name] = free.shift();
  }
  return found;
}

// A pathway from the edge of one box to that of the other, shifted to the left of its direction, so that two
// pathways between the same nuclei do not coincide.
function drawPathway(pathway, at) {
  const [a, b] = [at[pathway.from], at[pathway.to]];
  const name = escaped(`${pathway.from}->${pathway.to}`), mark = `marker-end="url(#${pathway.inhibits ? "dot" : "arrow"})"`;
  const way = (d) => `<path d="${d}" data-pathway="${name}" fill="none" stroke="#888" stroke-width="1.5" ${mark}/>`;
  if (pathway.from === pathway.to) return way(`M${a[0] + 50} ${a[1]}C${a[0] + 50} ${a[1] - 26} ${a[0] + 74} ${a[1] - 26} ${a[0] + 74} ${a[1]}`);
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]], long = Math.hypot(dx, dy);
  const [ox, oy] = [(dy / long) * APART, (-dx / long) * APART];
  const part = (sign) => Math.min((WIDTH / 2 - sign * Math.sign(dx) * ox) / Math.abs(dx), (HEIGHT / 2 - sign * Math.sign(dy) * oy) / Math.abs(dy));
  const point = (from, t) => `${(from[0] + WIDTH / 2 + ox + t * dx).toFixed(1)} ${(from[1] + HEIGHT / 2 + oy + t * dy).toFixed(1)}`;
  return way(`M${point(a, part(1))}L${point(b, -part(-1))}`);
}

function drawNuclei(table, intact, total) {
  const own = ratesAt(table, total), whole = ratesAt(intact, total), at = places(table);
  let svg = '<defs><marker id="arrow" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">' +
    '<path d="M0 0 8 4 0 8z" fill="#888"/></marker><marker id="dot" viewBox="0 0 8 8" refX="5" refY="4" markerWidth="7" ' +
    'markerHeight="7"><circle cx="4" cy="4" r="3" fill="#888"/></marker></defs>';
  for (const [name, [x, y]] of Object.entries(at)) {
    svg += `<rect x="${x}" y="${y}" width="${WIDTH}" height="${HEIGHT}" fill="#fff" stroke="#444" rx="4"/>`;
    const above = y < 150 ? y - 5 : y + HEIGHT + 13;
    svg += `<text x="${x + WIDTH / 2}" y="${above}" text-anchor="middle">${escaped(LABELS[name] || name)}</text>`;
    if (own === null) continue;
    const rates = perNucleus(table, own, name), before = whole === null ? [] : perNucleus(intact, whole, name);
    const room = (WIDTH - 12) / rates.length;
    rates.forEach((rate, i) => {
      const h = Math.min(Math.max(rate, 0) / MOST_HZ, 1) * (HEIGHT - 18), left = x + 6 + i * room;
      const colour = rates.length === 1 ? COMMON : COLOURS[i];
      svg += `<rect x="${left}" y="${y + HEIGHT - h}" width="${room - 3}" height="${h}" fill="${colour}"/>`;
      svg += `<text x="${left + room / 2 - 1.5}" y="${y + 11}" text-anchor="middle" font-size="9">${rate.toFixed(0)}</text>`;
      if (before.length) {
        const top = y + HEIGHT - Math.min(Math.max(before[i], 0) / MOST_HZ, 1) * (HEIGHT - 18);
        svg += line(left - 1, top, left + room - 2, top, 'stroke="#000" stroke-width="1"');
      }
    });
  }
  for (const pathway of table.pathways) svg += drawPathway(pathway, at);
  byId("nuclei").innerHTML = svg;
  byId("nuclei").setAttribute("viewBox", `0 0 640 ${Math.max(...Object.values(at).map((place) => place[1])) + 110}`);
  return own;
}

// A small plot: lines {points, style} on axes with ticks.
function plot(id, xs, ys, labels, body) {
  const [left, right, top, bottom] = [48, 298, 10, 200];
  const px = (x) => left + ((x - xs[0]) / (xs[1] - xs[0])) * (right - left);
  const py = (y) => bottom - ((Math.min(Math.max(y, ys[0]), ys[1]) - ys[0]) / (ys[1] - ys[0])) * (bottom - top);
  let svg = line(left, bottom, right, bottom) + line(left, top, left, bottom);
  for (let k = 0; k <= 4; k++) {
    const x = xs[0] + (k / 4) * (xs[1] - xs[0]), y = ys[0] + (k / 4) * (ys[1] - ys[0]);
    svg += `<text x="${px(x)}" y="${bottom + 14}" text-anchor="middle">${+x.toPrecision(3)}</text>`;
    svg += `<text x="${left - 5}" y="${py(y) + 4}" text-anchor="end">${+y.toPrecision(3)}</text>`;
  }
  svg += `<text x="${(left + right) / 2}" y="${bottom + 32}" text-anchor="middle">${labels[0]}</text>`;
  svg += `<text transform="translate(11 ${(top + bottom) / 2}) rotate(-90)" text-anchor="middle">${labels[1]}</text>`;
  byId(id).innerHTML = svg + body(px, py);
}

function path(points, px, py, style) {
  const drawn = points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
  if (!drawn.length) return "";
  return `<path fill="none" d="M${drawn.map(([x, y]) => `${px(x).toFixed(1)} ${py(y).toFixed(1)}`).join("L")}" ${style}/>`;
}

function drawOut(table, intact, chosen) {
  const leads = Array.from({ length: 41 }, (_, k) => (k / 40) * 8), channels = Number(chosen.channels);
  const along = (out) => leads.map((lead) => [lead, out(totals(channels, lead, chosen.conflict))[0]]);
  const level = -Math.log(chosen.posterior);
  plot("out", [0, 8], [0, 1], ["evidence for the leader, nats", "OUT, nats"], (px, py) =>
    path(along(circuitOut(intact)), px, py, 'stroke="#aaa" stroke-width="3"') +
    path(along(testOut(table)), px, py, 'stroke="#000" stroke-width="1.5" stroke-dasharray="5 4"') +
    path(along(circuitOut(table)), px, py, 'stroke="var(--one)" stroke-width="2"') +
    path([[0, level], [8, level]], px, py, 'stroke="#000" stroke-dasharray="1 3"'));
}

function drawTradeoff(found) {
  const shown = (one) => one.decided >= SHARE_DRAWN * one.trials;
  const most = TASK.readings * STEP_MS;
  plot("tradeoff", [0, most], [1 / found.channels, 1], ["mean decision time, ms", "accuracy"], (px, py) => {
    const point = (one, style) => !shown(one) ? "" :
      `<circle cx="${px(one.readings * STEP_MS)}" cy="${py(one.accuracy)}" r="5" ${style}/>`;
    const bar = (one) => {
      if (!shown(one)) return "";
      const se = Math.sqrt((one.accuracy * (1 - one.accuracy)) / one.decided), x = px(one.readings * STEP_MS);
      return line(x, py(one.accuracy - se), x, py(one.accuracy + se), 'stroke="var(--one)"');
    };
    return path(found.curve.filter(shown).map((one) => [one.readings * STEP_MS, one.accuracy]), px, py,
      'stroke="#000" stroke-dasharray="5 4"') + bar(found.own) + point(found.test, 'fill="#fff" stroke="#000"') +
      point(found.intact, 'fill="#aaa"') + point(found.own, 'fill="var(--one)"');
  });
}

function simulated(table, intact, chosen) {
  const task = Object.assign({ dPrime: chosen.dPrime, conflict: chosen.conflict }, TASK);
  const trials = walks(Number(chosen.channels), task), level = -Math.log(chosen.posterior), test = testOut(table);
  const posteriors = Array.from({ length: 9 }, (_, k) => 1 / chosen.channels + (0.985 - 1 / chosen.channels) * ((k + 1) / 9));
  return {
    channels: Number(chosen.channels),
    own: decided(trials, circuitOut(table), level),
    intact: decided(trials, circuitOut(intact), level),
    test: decided(trials, test, level),
    curve: posteriors.map((posterior) => decided(trials, test, -Math.log(posterior))),
  };
}

function warned(table, chosen) {
  const x = fixedPoint(table, totals(Number(chosen.channels), 0, 0)), level = -Math.log(chosen.posterior);
  if (x === null) return "The circuit has no fixed point at rest: its rates run away or oscillate.";
  if (Math.min(...outOf(table, x)) <= level)
    return "At rest OUT lies below the threshold: the circuit decides without evidence, and its accuracy says nothing.";
  if (level < table.readable[0]) return "The circuit cannot read an OUT as low as this threshold: it waits for the deadline.";
  return "";
}

function inWords(one) {
  const by = `of ${one.trials} trials decided within ${TASK.readings * STEP_MS} ms`;
  if (Number.isNaN(one.decided)) return "no decisions: for some of the evidence the circuit has no fixed point";
  if (one.decided === 0) return `none ${by}`;
  return `${one.decided} ${by}; accuracy ${one.accuracy.toFixed(2)} and mean time ${(one.readings * STEP_MS).toFixed(0)} ms of these`;
}

let waiting = null;

function show() {
  const chosen = settings(), intact = TABLES[chosen.channels], table = edited(intact, chosen.lesions, chosen.dopamine);
  for (const output of document.querySelectorAll("output")) {
    const id = output.getAttribute("for"), value = number(id);
    output.textContent = ["STN", "GPe", "D1", "D2"].includes(id) ? `${Math.round(100 * value)} %` : value.toFixed(2);
  }
  byId("warning").textContent = warned(table, chosen);
  byId("kappa").textContent = table.kappa;
  drawNuclei(table, intact, totals(Number(chosen.channels), chosen.lead, chosen.conflict));
  drawOut(table, intact, chosen);
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    const found = simulated(table, intact, chosen);
    drawTradeoff(found);
    byId("said").textContent = `The circuit as changed: ${inWords(found.own)}.\nIntact: ${inWords(found.intact)}.\n` +
      `The MSPRT at the same gain and threshold: ${inWords(found.test)}.`;
  }, 120);
}

const FIRST = Object.values(TABLES)[0];
byId("channels").innerHTML = Object.keys(TABLES).map((n) => `<option>${n}</option>`).join("");
byId("circuit").textContent = `${FIRST.name} (${FIRST.sha256.slice(0, 8)})`;
byId("trials").textContent = TASK.trials;
byId("controls").addEventListener("input", show);
byId("controls").addEventListener("reset", () => setTimeout(show, 0));
byId("controls").addEventListener("submit", (event) => event.preventDefault());
show();
