// The fixed point of a circuit's table, and decisions that read it: the algebra of
// circuits/dynamics/fixed_point.py, number for number. No drawing here.
"use strict";

const MOST_STEPS = 400, TOLERANCE = 1e-9, LARGEST_MOVE = 1, MOST_DAMPING = 4, PATIENCE = 100, CAUTION = 10,
  EXP_MOST = 60, MOST_NATS = 5.5;
const ROUNDING = 1e-10;

const TRANSFER = {
  linear: [(x) => x, () => 1],
  rectified: [(x) => Math.max(x, 0), (x) => (x > 0 ? 1 : 0)],
  saturating: [
    (x) => Math.min(Math.max(x, 0), MOST_NATS),
    (x) => (x > 0 && x < MOST_NATS ? 1 : 0),
  ],
  ramp: [(x) => Math.min(Math.max(x, 0), 1), (x) => (x > 0 && x < 1 ? 1 : 0)],
  exp: [(x) => Math.exp(Math.min(x, EXP_MOST)), (x) => (x < EXP_MOST ? Math.exp(x) : 0)],
  s_minus_log_s: [(x) => (x > 0 ? x - Math.log(x) : 0), (x) => (x > 0 ? 1 - 1 / x : 0)],
};

// A table with nuclei lesioned by fractions and a level of dopamine.
function edited(table, lesions, dopamine) {
  const deliver = table.deliver.map((row) =>
    row.map((value, b) => value * (1 - (lesions[table.populations[table.owner[b]]] || 0))));
  const weight = table.weight.map((row) => row.slice());
  const bias = table.bias.slice();
  for (const path of table.dopamine) {
    const change = path.sign * (dopamine - 1);
    for (const b of path.blocks) {
      for (const u of path.units) weight[b][u] *= 1 + change;
      bias[b] -= change * path.weight * path.pivot;
    }
  }
  return Object.assign({}, table, { deliver, weight, bias });
}

function rateOf(table, b, x) {
  const rate = table.baseline[b] + table.gain[b] * TRANSFER[table.transfer[b]][0](x);
  return Math.max(rate, table.floor[b]);
}

function slopeOf(table, b, x) {
  const law = TRANSFER[table.transfer[b]];
  const above = table.baseline[b] + table.gain[b] * law[0](x) > table.floor[b];
  return above ? table.gain[b] * law[1](x) : 0;
}

// What each unit receives, and what each block then gets through its units.
function unitsOf(table, x) {
  const rates = x.map((value, b) => rateOf(table, b, value));
  return table.deliver.map((row, u) => {
    let sum = table.constant[u];
    for (let b = 0; b < row.length; b++) if (row[b] !== 0) sum += row[b] * rates[b];
    return sum;
  });
}

function inputOf(table, b, units) {
  let sum = table.bias[b];
  const row = table.weight[b];
  for (let u = 0; u < row.length; u++)
    if (row[u] !== 0) sum += row[u] * TRANSFER[table.unitTransfer[u]][0](units[u]);
  return sum;
}

// Gaussian elimination with pivots by size; null where there is none.
function solved(matrix, right) {
  const n = right.length, a = matrix.map((row, i) => row.concat(right[i]));
  for (let k = 0; k < n; k++) {
    let p = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(a[i][k]) > Math.abs(a[p][k])) p = i;
    if (a[p][k] === 0) return null;
    [a[k], a[p]] = [a[p], a[k]];
    for (let i = k + 1; i < n; i++) {
      const f = a[i][k] / a[k][k];
      if (f !== 0) for (let j = k; j <= n; j++) a[i][j] -= f * a[k][j];
    }
  }
  const x = new Array(n);
  for (let i = n - 1; i >= 0; i--) {
    let sum = a[i][n];
    for (let j = i + 1; j < n; j++) sum -= a[i][j] * x[j];
    x[i] = sum / a[i][i];
  }
  return x;
}

function newton(table, outside, x, blocks) {
  for (let step = 0; step < MOST_STEPS; step++) {
    const units = unitsOf(table, x);
    const error = blocks.map((b) => outside[b] + inputOf(table, b, units) - x[b]);
    const size = Math.max(...error.map(Math.abs));
    const damping = (step < PATIENCE ? 1 : CAUTION) * Math.min(size, MOST_DAMPING);
    const slopes = blocks.map((b) => slopeOf(table, b, x[b]));
    const through = units.map((value, u) => TRANSFER[table.unitTransfer[u]][1](value));
    const jacobian = blocks.map((b, i) =>
      blocks.map((other, j) => {
        let sum = 0;
        for (let u = 0; u < units.length; u++)
          sum += table.weight[b][u] * through[u] * table.deliver[u][other];
        return sum * slopes[j] - (i === j ? 1 + damping : 0);
      }));
    const move = solved(jacobian, error.map((e) => -e));
    if (move === null) break;
    let most = 0;
    blocks.forEach((b, i) => {
      if (table.transfer[b] === "exp") most = Math.max(most, Math.abs(move[i]));
    });
    const part = Math.min(1, LARGEST_MOVE / Math.max(most, 1e-300));
    blocks.forEach((b, i) => { x[b] += part * move[i]; });
    if (size < TOLERANCE) return true;
  }
  return false;
}

// The state under a drive per channel, nats; null where the circuit has no fixed point.
function fixedPoint(table, drive) {
  const outside = table.bias.map(() => 0);
  table.input.forEach((b, i) => { outside[b] = table.driveGain * drive[i]; });
  const x = outside.map((value, b) => value + table.bias[b]);
  for (const part of table.parts) {
    if (part.loop) {
      if (!newton(table, outside, x, part.blocks)) return null;
    } else {
      const units = unitsOf(table, x);
      const found = part.blocks.map((b) => outside[b] + inputOf(table, b, units));
      part.blocks.forEach((b, i) => { x[b] = found[i]; });
    }
  }
  return x;
}

function ratesOf(table, x) {
  return x.map((value, b) => rateOf(table, b, value));
}

// OUT of each channel, nats.
function outOf(table, x) {
  return table.readout.map((b) => (rateOf(table, b, x[b]) - table.baseline[b]) / table.gain[b]);
}

// What the circuit is given: evidence times the gain; where the circuit needs it centred, no further
// behind the leader than it reaches, less its mean.
function driveOf(table, total) {
  const scaled = total.map((value) => table.kappa * value);
  if (!table.centred) return scaled;
  const top = Math.max(...scaled);
  const cut = scaled.map((value) => Math.max(value, top - table.reach));
  const mean = cut.reduce((a, b) => a + b, 0) / cut.length;
  return cut.map((value) => value - mean);
}

function minusLogP(total) {
  const top = Math.max(...total);
  const sum = total.reduce((a, value) => a + Math.exp(value - top), 0);
  return total.map((value) => top - value + Math.log(sum));
}

// Random numbers of a seed: mulberry32 (Ettinger), two normal ones at a time (Box & Muller 1958).
function normals(seed) {
  let state = seed >>> 0, kept = null;
  const uniform = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = state;
    t = Math.imul(t ^ (t >>> 15), t | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  return () => {
    if (kept !== null) { const value = kept; kept = null; return value; }
    const radius = Math.sqrt(-2 * Math.log(1 - uniform())), turn = 2 * Math.PI * uniform();
    kept = radius * Math.sin(turn);
    return radius * Math.cos(turn);
  };
}

// Evidence of trials, [trial][reading][channel], summed; the first channel is true.
function walks(channels, task) {
  const draw = normals(task.seed), separation = task.dPrime / Math.SQRT2, found = [];
  for (let n = 0; n < task.trials; n++) {
    const total = new Array(channels).fill(0), trial = [];
    for (let t = 0; t < task.readings; t++) {
      for (let i = 0; i < channels; i++) {
        const mean = i === 0 ? separation : i === 1 ? task.conflict * separation : 0;
        total[i] += separation * (mean + draw());
      }
      trial.push(total.slice());
    }
    found.push(trial);
  }
  return found;
}

// First crossing of OUT: the number of trials, how many cross by the last reading, and the accuracy and
// mean reading of these; the others stay undecided. Without a fixed point on the way all but the number of
// trials is NaN. Equal channels, as where D1 is silent for all, share the choice.
function decided(trials, out, threshold) {
  let right = 0, readings = 0, count = 0;
  for (const trial of trials) {
    for (let t = 0; t < trial.length; t++) {
      const values = out(trial[t]);
      const least = Math.min(...values);
      if (Number.isNaN(least)) return { trials: trials.length, decided: NaN, accuracy: NaN, readings: NaN };
      if (least <= threshold + ROUNDING) {
        const equal = values.filter((value) => value <= least + ROUNDING).length;
        right += values[0] <= least + ROUNDING ? 1 / equal : 0;
        readings += t + 1;
        count += 1;
        break;
      }
    }
  }
  return { trials: trials.length, decided: count, accuracy: right / count, readings: readings / count };
}

function circuitOut(table) {
  return (total) => {
    const x = fixedPoint(table, driveOf(table, total));
    return x === null ? table.readout.map(() => NaN) : outOf(table, x);
  };
}

function testOut(table) {
  return (total) => minusLogP(total.map((value) => table.kappa * value));
}
