// Replays a recorded run: draws what the socket sends, asks for nothing from anywhere else.
"use strict";

const INK = "#1b2733", MUTED = "#5f6b76", ARC = "#b4bdc7", GRID = "#dfe4e9", ACCENT = "#c2410c", BLUE = "#1d5f9e";
const NO_VALUE = "#c9ced4";
// cividis, reversed: readable with any colour vision, and in grey: dark is a large error
const STOPS = [[254, 232, 56], [221, 200, 88], [187, 173, 109], [154, 147, 118], [124, 123, 120], [96, 100, 111], [66, 78, 108], [24, 55, 111], [0, 34, 78]];
const LEVELS = 64;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 100];
const NAMED = 60;
const MARGIN = 34;

const byId = (id) => document.getElementById(id);
const palette = Array.from({ length: LEVELS }, (_, k) => {
  const at = (k / (LEVELS - 1)) * (STOPS.length - 1);
  const low = Math.min(Math.floor(at), STOPS.length - 2);
  const mix = STOPS[low].map((c, i) => Math.round(c + (at - low) * (STOPS[low + 1][i] - c)));
  return `rgb(${mix.join(",")})`;
});

let topology = null; // the JSON message
let places = []; // [x, y] in CSS pixels
let errors = null; // Float32Array of the latest frame
let sample = 0;
let playing = false;
let chosen = -1;
let trace = null; // {times, errors} of the chosen node
let stems = new Map(); // node with an external arc: the direction of its stem
let backdrop = null; // arcs, drawn once for each size
let waiting = false;

const socket = new WebSocket(`ws${location.protocol === "https:" ? "s" : ""}://${location.host}/ws${location.search}`);
socket.binaryType = "arraybuffer";
socket.onmessage = (event) => (typeof event.data === "string" ? receive(JSON.parse(event.data)) : receiveFrame(event.data));
socket.onclose = (event) => {
  byId("status").textContent = event.reason || "The connection is closed: start the replay again, then reload this page.";
  for (const control of document.querySelectorAll("button, input, select")) control.disabled = true;
};

function send(command) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
}

function receive(message) {
  if (message.type === "topology") begin(message);
  if (message.type === "state") {
    playing = message.playing;
    byId("play").textContent = playing ? "Pause" : "Play";
    showSpeed(message.speed);
  }
  if (message.type === "trace" && message.node === chosen) trace = message;
  redraw();
}

function receiveFrame(buffer) {
  const view = new DataView(buffer); // the layout is little-endian on every machine
  const count = buffer.byteLength / 4 - 1;
  const time = view.getFloat32(0, true);
  errors = new Float32Array(count);
  for (let k = 0; k < count; k++) errors[k] = view.getFloat32(4 + 4 * k, true);
  sample = nearest(topology.times, time);
  byId("seek").value = sample;
  byId("clock").textContent = `${short(topology.times[sample])} s`;
  redraw();
}

function begin(message) {
  topology = message;
  const { names, times, arcs, anchored } = message;
  byId("summary").textContent =
    `${names.length} nodes, ${arcs.length} linked pairs, ${anchored.length} anchored nodes, ${times.length} samples, engine ${message.path}`;
  byId("seek").max = times.length - 1;
  for (const [k, name] of names.entries()) byId("node").add(new Option(name, k));
  for (const control of document.querySelectorAll("button, input, select")) control.disabled = false;
  const range = message.error_range;
  byId("low").textContent = range ? short(range[0]) : "";
  byId("high").textContent = range ? short(range[1]) : "zero throughout";
  const pen = byId("scale").getContext("2d");
  for (let k = 0; k < LEVELS; k++) {
    pen.fillStyle = palette[k];
    pen.fillRect((k * 180) / LEVELS, 0, 180 / LEVELS + 1, 10);
  }
  resize();
}

function nearest(times, time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
}

function short(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 0.001 && size < 1e5 ? String(Number(value.toPrecision(4))) : value.toExponential(1);
}

function level(error) {
  const range = topology.error_range;
  if (!range || Number.isNaN(error)) return -1;
  if (!(error > range[0])) return 0;
  const share = range[1] > range[0] ? Math.log(error / range[0]) / Math.log(range[1] / range[0]) : 1;
  return Math.min(LEVELS - 1, Math.floor(share * LEVELS));
}

// -- drawing ----------------------------------------------------------------------------------------------------
function sized(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  return { width, height, ratio };
}

function pen(canvas) {
  const context = canvas.getContext("2d"), ratio = canvas.width / Math.max(1, canvas.clientWidth);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  return context;
}

function resize() {
  if (!topology) return;
  sized(byId("trace"));
  const { width, height, ratio } = sized(byId("network"));
  const { x, y } = topology;
  const extreme = (list, choose) => list.reduce((a, b) => choose(a, b));
  const left = extreme(x, Math.min), right = extreme(x, Math.max), low = extreme(y, Math.min), high = extreme(y, Math.max);
  const room = [(width - 2 * MARGIN) / (right - left), (height - 2 * MARGIN) / (high - low)].filter(Number.isFinite);
  const scale = room.length ? Math.min(...room) : 1;
  places = x.map((value, k) => [
    width / 2 + scale * (value - (left + right) / 2),
    height / 2 - scale * (y[k] - (low + high) / 2),
  ]);
  stems = stemDirections();
  backdrop = document.createElement("canvas");
  backdrop.width = Math.round(width * ratio);
  backdrop.height = Math.round(height * ratio);
  drawArcs(backdrop.getContext("2d"), ratio);
  redraw();
}

function radius() {
  return Math.min(7, Math.max(1.6, 110 / Math.sqrt(places.length)));
}

function drawArcs(context, ratio) {
  context.scale(ratio, ratio);
  context.strokeStyle = ARC;
  context.lineWidth = places.length > 600 ? 0.6 : 1.2;
  context.beginPath();
  for (const [tail, head] of topology.arcs) {
    context.moveTo(...places[tail]);
    context.lineTo(...places[head]);
  }
  context.stroke();
  context.strokeStyle = ACCENT;
  context.lineWidth = 1.4;
  context.beginPath();
  const r = radius();
  for (const node of topology.anchored) {
    const [x, y] = places[node], [u, v] = stems.get(node), reach = r + 8;
    context.moveTo(x, y);
    context.lineTo(x + reach * u, y + reach * v);
    context.moveTo(x + reach * u - 5 * v, y + reach * v + 5 * u);
    context.lineTo(x + reach * u + 5 * v, y + reach * v - 5 * u);
  }
  context.stroke();
}

// directions of the external arcs: away from the node's other arcs, downwards where those balance
function stemDirections() {
  const sums = new Map(topology.anchored.map((node) => [node, [0, 0]]));
  for (const [tail, head] of topology.arcs) {
    const dx = places[head][0] - places[tail][0], dy = places[head][1] - places[tail][1];
    const length = Math.hypot(dx, dy) || 1;
    for (const [node, sign] of [[tail, -1], [head, 1]]) {
      const sum = sums.get(node);
      if (sum) [sum[0], sum[1]] = [sum[0] + (sign * dx) / length, sum[1] + (sign * dy) / length];
    }
  }
  for (const [node, [u, v]] of sums) {
    const length = Math.hypot(u, v);
    sums.set(node, length > 0.1 ? [u / length, v / length] : [0, 1]);
  }
  return sums;
}

function redraw() {
  if (waiting || !topology) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    drawNetwork();
    drawTrace();
  });
}

function drawNetwork() {
  if (!errors || !backdrop) return;
  const canvas = byId("network"), context = pen(canvas), r = radius();
  context.drawImage(backdrop, 0, 0, canvas.clientWidth, canvas.clientHeight);
  context.strokeStyle = INK;
  context.lineWidth = 0.8;
  for (const [k, [x, y]] of places.entries()) {
    const colour = level(errors[k]);
    context.fillStyle = colour < 0 ? NO_VALUE : palette[colour];
    context.beginPath();
    context.arc(x, y, r, 0, 2 * Math.PI);
    context.fill();
    if (r > 3) context.stroke();
  }
  if (places.length <= NAMED) for (let k = 0; k < places.length; k++) drawName(context, k, r);
  if (chosen >= 0) {
    context.strokeStyle = ACCENT;
    context.lineWidth = 2.5;
    context.beginPath();
    context.arc(...places[chosen], r + 3.5, 0, 2 * Math.PI);
    context.stroke();
    if (places.length > NAMED) drawName(context, chosen, r + 4);
  }
}

function drawName(context, node, r) {
  const name = topology.names[node], text = name.length > 24 ? `${name.slice(0, 23)}…` : name;
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  const below = stems.has(node) && stems.get(node)[1] < -0.3; // the stem of an external arc has the place above
  const [x, y] = [places[node][0], places[node][1] + (below ? r + 3 : -r - 2)];
  context.textAlign = "center";
  context.textBaseline = below ? "top" : "bottom";
  context.lineWidth = 3;
  context.strokeStyle = "rgba(255,255,255,0.85)";
  context.strokeText(text, x, y);
  context.fillStyle = INK;
  context.fillText(text, x, y);
}

function drawTrace() {
  const canvas = byId("trace"), context = pen(canvas);
  const box = { left: 56, right: canvas.clientWidth - 12, top: 10, bottom: canvas.clientHeight - 34 };
  const shown = [...topology.norm, ...(trace ? trace.errors : [])].filter((value) => value > 0);
  if (!shown.length) return;
  let low = Math.log10(shown.reduce((a, b) => Math.min(a, b))), high = Math.log10(shown.reduce((a, b) => Math.max(a, b)));
  const room = Math.max(0.05 * (high - low), 0.5 * (1 - high + low), 0.05);
  low -= room;
  high += room;
  const times = topology.times, start = times[0], span = times[times.length - 1] - start || 1;
  const across = (time) => box.left + ((time - start) / span) * (box.right - box.left);
  const down = (value) => box.bottom - ((Math.log10(value) - low) / (high - low)) * (box.bottom - box.top);
  drawAxes(context, box, low, high, start, span, down, across);
  drawLine(context, times, topology.norm, across, down, BLUE);
  if (trace) drawLine(context, trace.times, trace.errors, across, down, ACCENT);
  context.strokeStyle = INK;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(across(times[sample]), box.top);
  context.lineTo(across(times[sample]), box.bottom);
  context.stroke();
}

function drawAxes(context, box, low, high, start, span, down, across) {
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  context.lineWidth = 1;
  context.strokeStyle = GRID;
  context.fillStyle = MUTED;
  context.textAlign = "right";
  context.textBaseline = "middle";
  const step = Math.max(1, Math.ceil((high - low) / 8));
  for (let power = Math.ceil(low / step) * step; power <= high; power += step) {
    context.beginPath();
    context.moveTo(box.left, down(10 ** power));
    context.lineTo(box.right, down(10 ** power));
    context.stroke();
    context.fillText(`1e${power}`.replace("-", "−"), box.left - 7, down(10 ** power));
  }
  context.textBaseline = "top";
  for (let k = 0; k <= 4; k++) {
    context.textAlign = k === 0 ? "left" : k === 4 ? "right" : "center";
    const time = start + (k * span) / 4;
    context.fillText(k === 4 ? `${short(time)} s` : short(time), across(time), box.bottom + 8);
  }
  context.strokeStyle = MUTED;
  context.beginPath();
  context.moveTo(box.left, box.top);
  context.lineTo(box.left, box.bottom);
  context.lineTo(box.right, box.bottom);
  context.stroke();
}

function drawLine(context, times, values, across, down, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.beginPath();
  let lifted = true;
  for (let k = 0; k < times.length; k++) {
    const usable = values[k] !== null && values[k] > 0;
    if (usable && lifted) context.moveTo(across(times[k]), down(values[k]));
    else if (usable) context.lineTo(across(times[k]), down(values[k]));
    lifted = !usable;
  }
  context.stroke();
}

// -- controls ---------------------------------------------------------------------------------------------------
function choose(node) {
  chosen = node;
  trace = null;
  byId("node").value = node < 0 ? "" : String(node);
  byId("chosen").textContent = node < 0 ? "click a node to see its error" : `node ${topology.names[node]}`;
  if (node >= 0) send({ type: "trace", node });
  redraw();
}

function showSpeed(speed) {
  const list = byId("speed");
  const known = [...new Set([...SPEEDS, speed])].sort((a, b) => a - b);
  list.replaceChildren(...known.map((value) => new Option(`${value} ×`, value, false, value === speed)));
}

byId("play").addEventListener("click", () => send({ type: playing ? "pause" : "play" }));
byId("seek").addEventListener("input", (event) => send({ type: "seek", frame: Number(event.target.value) }));
byId("speed").addEventListener("change", (event) => send({ type: "speed", value: Number(event.target.value) }));
byId("node").addEventListener("change", (event) => choose(event.target.value === "" ? -1 : Number(event.target.value)));
byId("network").addEventListener("click", (event) => {
  let best = -1, reach = Math.max(14, 2 * radius());
  for (const [k, [x, y]] of places.entries()) {
    const distance = Math.hypot(x - event.offsetX, y - event.offsetY);
    if (distance < reach) [best, reach] = [k, distance];
  }
  choose(best);
});
new ResizeObserver(resize).observe(byId("network"));
