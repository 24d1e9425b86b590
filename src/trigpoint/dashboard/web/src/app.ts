// Joins the parts: what the socket says goes to the network, the plots and the cards; what people do goes back.
import { darkPaper } from "./colours";
import { Connection } from "./connection";
import { drawLegend } from "./legend";
import { Network } from "./network";
import { NodeCard } from "./node";
import { Playback } from "./playback";
import { Plot } from "./plots";
import {
  type Frame, type Happening, type Layer, type LinkLayer, type Message, type Numbers, type Order, type Topology,
  VERSION,
} from "./protocol";
import { byId, count, element, percent, seconds, short, write } from "./text";

declare const SOURCES: string;

const LAYERS: Record<Layer, string> = { error: "Error", uncertainty: "Uncertainty", state: "State", age: "Staleness" };
const LINKS: Record<LinkLayer, string> = { loss: "by loss", age: "by age" };
const MOST_EVENTS = 200;
const PLOT_EVERY = 150; // ms between two redrawings of growing plots
const STALLED = 3000; // ms without a word from a live run

class Page {
  private readonly connection: Connection;
  private topology: Topology | null = null;
  private network: Network | null = null;
  private card: NodeCard | null = null;
  private playback: Playback | null = null;
  private norm: Plot | null = null;
  private frame: Frame | null = null;
  private hover: { node: number | null; link: number | null } = { node: null, link: null };
  private ended = "";
  private received = 0;
  private readonly drawn: number[] = [];
  private draws = 0;
  private plotted = 0;
  private legendKey = "";
  private eventCount = 0;
  private expected: ((time: number) => number | null) | null = null;

  constructor() {
    this.connection = new Connection({
      message: (message) => this.receive(message),
      frame: (frame) => this.show(frame),
      ended: (text) => this.end(text),
    });
    setInterval(() => this.watchdog(), 1000);
    darkPaper.addEventListener("change", () => this.restyle());
  }

  // -- what the server says ---------------------------------------------------------------------------------------

  private receive(message: Message): void {
    switch (message.type) {
      case "topology":
        return this.begin(message);
      case "trace":
        return this.card?.trace(message);
      case "node":
        return this.card?.show(message, this.frame?.state[message.node] ?? 0);
      case "events":
        return this.happen(message.events);
      case "state":
        return this.playback?.state(message.playing, message.speed);
      case "refused":
        return this.card?.answer(`${message.order} was refused: ${message.text}`, false);
      case "done":
        return this.card?.answer(`${message.order}: done`, true);
    }
  }

  private begin(topology: Topology): void {
    if (topology.version !== VERSION) return this.end("This page belongs to another version of the program: reload it.");
    if (this.topology) return this.grow(topology);
    this.topology = topology;
    document.title = topology.title ? `${topology.title} – Trigpoint` : "Trigpoint";
    document.body.dataset.mode = topology.mode;
    this.pill();
    this.drawNetwork(topology);
    this.card = new NodeCard(
      topology,
      (order, node) => this.order(order, node),
      (name) => this.choose(this.topology!.names.indexOf(name)),
      (node) => this.connection.send({ type: "select", node }),
    );
    if (topology.mode === "replay") this.playback = new Playback(topology.times, (command) => this.connection.send(command));
    this.beginNorm(topology);
    this.toolbar(topology);
    this.fromAddress(topology);
    this.drawLegend();
  }

  /** Nodes have joined, and come last: what was chosen stays. */
  private grow(topology: Topology): void {
    const { network } = this;
    const [layer, linkLayer, selected] = [network!.layer, network!.linkLayer, network!.selected];
    network!.end();
    this.topology = topology;
    this.frame = null; // it has fewer nodes
    this.hover = { node: null, link: null };
    this.drawNetwork(topology);
    Object.assign(this.network!, { layer, linkLayer });
    this.network!.select(selected);
    this.card!.topology = topology;
    this.listNames(topology);
    this.legendKey = "";
  }

  private drawNetwork(topology: Topology): void {
    const { names, arcs } = topology;
    write(byId("title"), [topology.title, `${count(names.length)} nodes, ${count(arcs.length)} links`].filter(Boolean).join(" · "));
    this.network = new Network(byId("network"), topology, {
      chosen: (node) => this.choose(node),
      hovered: (node, link) => this.point(node, link),
      drawn: () => this.count(),
    });
  }

  private listNames(topology: Topology): void {
    byId("names").replaceChildren(...topology.names.map((name) => new Option(name, name)));
  }

  private beginNorm(topology: Topology): void {
    const { times, values } = topology.norm;
    this.norm = new Plot(byId("norm-plot"), true, topology.unit, 200);
    const lines = [{ label: "error norm", colour: 0, width: 2.2 }];
    const columns: Numbers[] = [times, values];
    if (topology.rate) {
      lines.push({ label: `${topology.rate_name} ${short(topology.rate, 3)} /s`, colour: -1, width: 1.4 });
      Object.assign(lines[1], { dashed: true });
      const floor = Math.min(...values.filter((v): v is number => v !== null && v > 0)) / 3;
      this.anchorRate(topology.rate, times, values, topology.mode === "replay" ? floor : 0);
      columns.push(times.map((time) => this.expected?.(time) ?? null));
    }
    this.norm.begin(lines, columns);
  }

  /** The line of the rate starts at the first error that is known. */
  private anchorRate(rate: number, times: number[], values: Numbers, floor: number): void {
    const start = values.findIndex((value) => value !== null && value > 0);
    if (start < 0) return;
    const [t0, first] = [times[start], values[start]!];
    this.expected = (time) => {
      const value = first * Math.exp(-rate * (time - t0));
      return value > floor && value > 1e-6 * first ? value : null;
    };
  }

  private show(frame: Frame): void {
    if (!this.network || !this.topology) return;
    this.frame = frame;
    this.received++;
    this.network.show(frame);
    this.tiles(frame);
    this.drawLegend();
    this.drawTip();
    if (this.topology.mode === "replay") {
      this.playback?.at(frame.index);
      for (const plot of [this.norm, this.card?.estimate, this.card?.error]) plot?.moveMark(frame.time);
    } else {
      if (this.topology.rate && !this.expected) this.anchorRate(this.topology.rate, [frame.time], [frame.norm], 0);
      this.norm?.push(frame.time, [Number.isFinite(frame.norm) ? frame.norm : null, this.expected?.(frame.time) ?? null]);
      this.plotLater();
    }
  }

  private plotLater(): void {
    const now = performance.now();
    if (now - this.plotted < PLOT_EVERY) return;
    this.plotted = now;
    for (const plot of [this.norm, this.card?.estimate, this.card?.error]) plot?.draw();
  }

  private tiles(frame: Frame): void {
    const total = frame.state.length;
    const anchored = frame.state.reduce((sum, state) => sum + (state === 1 || state === 2 ? 1 : 0), 0);
    write(byId("tile-time"), `${frame.time < 100 ? frame.time.toFixed(2) : frame.time.toFixed(1)} s`);
    write(byId("tile-anchored"), `${count(anchored)} of ${count(total)}`);
    byId("tile-anchored").dataset.kind = anchored === total ? "good" : "warn";
    write(byId("tile-norm"), short(frame.norm, 3));
    write(byId("tile-traffic"), count(frame.traffic));
    write(byId("tile-missed"), count(frame.missed));
    write(byId("tile-rejected"), count(frame.rejected));
  }

  private happen(events: Happening[]): void {
    const list = byId("events");
    if (!this.eventCount && events.length) list.replaceChildren();
    this.eventCount += events.length;
    for (const { time, text, node } of events.slice(-MOST_EVENTS)) {
      const item = element("li");
      item.append(element("time", "", `${time.toFixed(2)} s`));
      if (node === null) item.append(element("span", "", text));
      else {
        const button = element("button", "link", text);
        button.type = "button";
        button.addEventListener("click", () => this.choose(node));
        item.append(button);
      }
      list.prepend(item);
    }
    while (list.childElementCount > MOST_EVENTS) list.lastElementChild!.remove();
  }

  private end(text: string): void {
    if (this.ended) return;
    this.ended = text;
    const last = this.frame ? ` What is shown is from ${seconds(this.frame.time)} of the run.` : "";
    this.banner(text + last, "ended");
    this.pill();
    document.body.dataset.ended = "true";
    this.playback?.disable();
    for (const button of byId("orders").querySelectorAll("button")) button.disabled = true;
    for (const plot of [this.norm, this.card?.estimate, this.card?.error]) plot?.draw();
  }

  private watchdog(): void {
    if (this.ended || this.topology?.mode !== "live") return;
    const silence = performance.now() - this.connection.lastHeard;
    if (silence > STALLED) this.banner(`Nothing has come for ${Math.round(silence / 1000)} s.`, "stalled");
    else this.banner("", "");
  }

  private banner(text: string, kind: string): void {
    const place = byId("banner");
    place.hidden = !text;
    place.dataset.kind = kind;
    write(place, text);
  }

  private pill(): void {
    const kind = this.ended ? "ended" : (this.topology?.mode ?? "waiting");
    const pill = byId("pill");
    pill.dataset.kind = kind;
    write(pill, { ended: "Ended", live: "Live", replay: "Replay", waiting: "Connecting" }[kind]);
  }

  // -- what people do ---------------------------------------------------------------------------------------------

  private toolbar(topology: Topology): void {
    const layers = byId("layers");
    for (const layer of topology.colours) {
      const label = element("label");
      const radio = element("input");
      Object.assign(radio, { type: "radio", name: "layer", value: layer, checked: layer === this.network!.layer });
      radio.addEventListener("change", () => this.colourBy(layer));
      label.append(radio, element("span", "", LAYERS[layer]));
      layers.append(label);
    }
    const links = byId<HTMLSelectElement>("link-layer");
    byId("links-field").hidden = !topology.links.length;
    links.add(new Option("plain", "none"));
    for (const layer of topology.links) links.add(new Option(LINKS[layer], layer));
    links.value = this.network!.linkLayer;
    links.addEventListener("change", () => this.linksBy(links.value as LinkLayer | "none"));
    this.listNames(topology);
    const find = byId<HTMLInputElement>("find");
    const seek = (): void => {
      const node = this.topology!.names.indexOf(find.value);
      find.setCustomValidity(find.value && node < 0 ? "No node has this name" : "");
      if (node >= 0 || !find.value) this.choose(node);
    };
    find.addEventListener("input", seek);
    for (const way of ["in", "out", "fit"] as const) byId(`zoom-${way}`).addEventListener("click", () => this.network?.zoom(way));
  }

  private colourBy(layer: Layer): void {
    if (!this.network) return;
    this.network.layer = layer;
    this.network.repaint(this.frame);
    this.drawLegend();
    this.toAddress();
  }

  private linksBy(layer: LinkLayer | "none"): void {
    if (!this.network) return;
    this.network.linkLayer = layer;
    this.network.repaint(this.frame);
    this.drawLegend();
    this.toAddress();
  }

  private choose(node: number): void {
    if (!this.network || !this.topology || node === this.network.selected) return;
    this.network.select(node);
    this.card?.select(node);
    byId<HTMLInputElement>("find").value = node < 0 ? "" : this.topology.names[node];
    this.connection.send({ type: "select", node: node < 0 ? null : node });
    this.toAddress();
  }

  private order(order: Order, node: number): void {
    if (node >= 0) this.connection.send({ type: "order", order, node });
  }

  private point(node: number | null, link: number | null): void {
    this.hover = { node, link };
    byId("network").classList.toggle("pointing", node !== null);
    this.drawTip();
  }

  /** The choices stand behind the # of the address, so that reloading keeps them. */
  private fromAddress(topology: Topology): void {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const layer = wanted.get("colour") as Layer | null;
    if (layer && topology.colours.includes(layer)) {
      this.network!.layer = layer;
      const radio = document.querySelector<HTMLInputElement>(`input[name=layer][value=${layer}]`);
      if (radio) radio.checked = true;
    }
    const links = wanted.get("links") as LinkLayer | "none" | null;
    if (links && (links === "none" || topology.links.includes(links))) {
      this.network!.linkLayer = links;
      byId<HTMLSelectElement>("link-layer").value = links;
    }
    const node = topology.names.indexOf(wanted.get("node") ?? "");
    if (node >= 0) this.choose(node);
  }

  private toAddress(): void {
    const { network, topology } = this;
    if (!network || !topology) return;
    const words = new URLSearchParams({ colour: network.layer, links: network.linkLayer });
    if (network.selected >= 0) words.set("node", topology.names[network.selected]);
    history.replaceState(null, "", `${location.pathname}${location.search}#${words}`);
  }

  // -- drawing ----------------------------------------------------------------------------------------------------

  private drawLegend(): void {
    const { topology, network, frame } = this;
    if (!topology || !network) return;
    const key = JSON.stringify([
      network.layer, network.linkLayer, network.scale(), darkPaper.matches,
      network.layer === "state" ? [...(frame?.state ?? [])].join("") : missing(frame, network.layer),
    ]);
    if (key === this.legendKey) return;
    this.legendKey = key;
    drawLegend(topology, network, frame);
  }

  private drawTip(): void {
    const tip = byId("tip");
    const { node, link } = this.hover;
    const { network, topology, frame } = this;
    tip.hidden = (node === null && link === null) || !network || !topology || !frame;
    if (tip.hidden || !network || !topology || !frame) return;
    const at = node !== null ? network.at(node) : network.middle(link!);
    const [i, j] = link !== null ? topology.arcs[link] : [0, 0];
    const head = node !== null ? topology.names[node] : `${topology.names[i]} – ${topology.names[j]}`;
    const rows = node !== null ? this.nodeRows(node) : [["lost", percent(frame.loss[link!])], ["last message", seconds(frame.linkAge[link!])]];
    const list = element("dl");
    for (const [name, value] of rows) list.append(element("dt", "", name), element("dd", "", value));
    tip.replaceChildren(element("strong", "", head), ...(node === null && !topology.links.length ? [] : [list]));
    const room = byId("network").clientWidth - tip.offsetWidth - 8;
    tip.style.left = `${Math.max(4, Math.min(at.x + 16, room))}px`;
    tip.style.top = `${Math.max(4, at.y - tip.offsetHeight - 14)}px`;
  }

  private nodeRows(node: number): string[][] {
    const frame = this.frame!, { unit, states, colours } = this.topology!;
    const rows = [["state", states[frame.state[node]] ?? "unknown"]];
    if (this.topology!.joined.includes(node)) rows.push(["joined", "while the run went on"]);
    rows.push(["error", Number.isNaN(frame.error[node]) ? "–" : `${short(frame.error[node])} ${unit}`]);
    if (colours.includes("uncertainty")) rows.push(["uncertainty", short(frame.uncertainty[node])]);
    if (colours.includes("age")) rows.push(["last heard", seconds(frame.age[node])]);
    return rows;
  }

  private restyle(): void {
    this.network?.repaint(this.frame);
    this.norm?.restyle();
    this.card?.restyle();
    this.drawLegend();
  }

  private count(): void {
    this.draws++;
    this.drawn.push(performance.now());
    while (this.drawn.length && this.drawn[0] < performance.now() - 5000) this.drawn.shift();
  }

  // -- for tests --------------------------------------------------------------------------------------------------

  /** Where a node is on the page, in CSS pixels. */
  at(node: number): { x: number; y: number } | null {
    if (!this.network) return null;
    const box = byId("network").getBoundingClientRect(), place = this.network.at(node);
    return { x: box.left + place.x, y: box.top + place.y };
  }

  state(): object {
    const { topology, network, card, frame } = this;
    return {
      connected: this.connection.open,
      ended: this.ended,
      mode: topology?.mode ?? null,
      nodes: topology?.names.length ?? 0,
      links: topology?.arcs.length ?? 0,
      joined: topology?.joined ?? [],
      received: this.received,
      draws: this.draws,
      drawsPerSecond: this.drawn.length / 5,
      time: frame?.time ?? null,
      layer: network?.layer ?? null,
      selected: network?.selected ?? -1,
      colours: new Set(network?.colours ?? []).size,
      colourOf: network ? [...network.colours.slice(0, 100)] : [],
      events: this.eventCount,
      plots: {
        norm: { points: this.norm?.points ?? 0, labels: this.norm?.labels ?? [] },
        estimate: { points: card?.estimate.points ?? 0, labels: card?.estimate.labels ?? [] },
        error: { points: card?.error.points ?? 0, labels: card?.error.labels ?? [] },
      },
    };
  }

  readonly sources = SOURCES;
}

function missing(frame: Frame | null, layer: "error" | "uncertainty" | "age"): number {
  return frame ? frame[layer].reduce((sum, value) => sum + (Number.isNaN(value) || value === Infinity ? 1 : 0), 0) : 0;
}

Object.assign(window, { trigpoint: new Page() });
