// The network: sigma draws it; this keeps the colours and draws again only what changed.
import { createNodeBorderProgram } from "@sigma/node-border";
import Graph from "graphology";
import Sigma from "sigma";
import type { NodeDisplayData, PartialButFor } from "sigma/types";
import { GrowingScale, type Scale, level, palette, stateColour, theme, wear } from "./colours";
import type { Frame, Layer, LinkLayer, Topology } from "./protocol";

type Label = PartialButFor<NodeDisplayData, "x" | "y" | "size" | "label" | "color">;
interface Handlers {
  chosen(node: number): void;
  hovered(node: number | null, link: number | null): void;
  drawn(): void;
}

const SMALL = 60;
const MIDDLE = 600;
const FONT = 'system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif';

export class Network {
  layer: Layer;
  linkLayer: LinkLayer | "none";
  selected = -1;
  private readonly sigma: Sigma;
  private readonly nodeColours: string[];
  private readonly linkColours: string[];
  private readonly linkSizes: number[];
  private readonly anchored: Set<number>;
  private readonly neighbours: number[][];
  private readonly growing: { error: GrowingScale; uncertainty: GrowingScale };
  private radius = 5;
  private readonly gone = new AbortController();

  constructor(
    private readonly place: HTMLElement,
    private readonly topology: Topology,
    handlers: Handlers,
  ) {
    const count = topology.names.length;
    this.layer = topology.colours[0];
    this.linkLayer = topology.links[0] ?? "none";
    this.nodeColours = Array<string>(count).fill(theme().unknown);
    this.linkColours = Array<string>(topology.arcs.length).fill(theme().arc);
    this.linkSizes = Array<number>(topology.arcs.length).fill(this.thin());
    this.anchored = new Set(topology.anchored);
    this.neighbours = topology.names.map(() => []);
    for (const [i, j] of topology.arcs) {
      this.neighbours[i].push(j);
      this.neighbours[j].push(i);
    }
    this.growing = { error: new GrowingScale(topology.error_range), uncertainty: new GrowingScale() };
    this.sigma = new Sigma(this.graph(), place, this.settings());
    this.fitRadius();
    this.listen(handlers);
  }

  private graph(): Graph {
    const graph = new Graph({ type: "undirected" });
    const { names, x, y, arcs } = this.topology;
    const joined = new Set(this.topology.joined);
    names.forEach((name, k) => graph.addNode(String(k), { x: x[k], y: y[k], label: joined.has(k) ? `${name} (joined)` : name }));
    arcs.forEach(([i, j], k) => graph.addEdgeWithKey(String(k), String(i), String(j)));
    return graph;
  }

  private settings(): object {
    const many = this.topology.names.length;
    return {
      defaultNodeType: "bordered",
      nodeProgramClasses: {
        bordered: createNodeBorderProgram({
          borders: [
            { size: { attribute: "ring", defaultValue: 1, mode: "pixels" }, color: { attribute: "ringColour" } },
            { size: { fill: true }, color: { attribute: "color" } },
          ],
        }),
      },
      nodeReducer: (key: string, data: object) => this.node(Number(key), data),
      edgeReducer: (key: string, data: object) => {
        const k = Number(key);
        return { ...data, color: this.linkColours[k], size: this.linkSizes[k] };
      },
      defaultDrawNodeLabel: (context: CanvasRenderingContext2D, data: Label) => drawLabel(context, data),
      defaultDrawNodeHover: (context: CanvasRenderingContext2D, data: Label) => drawHover(context, data),
      labelRenderedSizeThreshold: many <= SMALL ? 0 : 7,
      labelDensity: many <= SMALL ? 40 : 0.6,
      labelGridCellSize: many <= SMALL ? 20 : 90,
      enableEdgeEvents: many <= MIDDLE,
      stagePadding: 36,
      minEdgeThickness: many > MIDDLE ? 0.6 : 1,
      minCameraRatio: 0.02,
      maxCameraRatio: 4,
      zIndex: false,
    };
  }

  private node(k: number, data: object): object {
    const now = theme();
    const isAnchor = this.anchored.has(k);
    const chosen = k === this.selected;
    return {
      ...data,
      color: this.nodeColours[k],
      ring: chosen ? 3 : isAnchor ? Math.max(2, 0.3 * this.radius) : this.radius > 3 ? 1.4 : 0.7,
      ringColour: chosen || isAnchor ? now.accent : now.outline,
      size: chosen ? this.radius + 3 : isAnchor ? this.radius + 1.5 : this.radius,
      highlighted: chosen,
    };
  }

  private thin(): number {
    return this.topology.names.length > MIDDLE ? 1.2 : 2;
  }

  private fitRadius(): void {
    const area = Math.max(1, this.place.clientWidth) * Math.max(1, this.place.clientHeight);
    this.radius = Math.min(11, Math.max(2.2, 0.25 * Math.sqrt(area / this.topology.names.length)));
  }

  private listen(handlers: Handlers): void {
    const { sigma } = this;
    sigma.on("clickNode", ({ node }) => handlers.chosen(Number(node)));
    sigma.on("clickStage", () => handlers.chosen(-1));
    sigma.on("doubleClickStage", ({ event }) => event.preventSigmaDefault());
    sigma.on("enterNode", ({ node }) => handlers.hovered(Number(node), null));
    sigma.on("leaveNode", () => handlers.hovered(null, null));
    sigma.on("enterEdge", ({ edge }) => handlers.hovered(null, Number(edge)));
    sigma.on("leaveEdge", () => handlers.hovered(null, null));
    sigma.on("afterRender", () => handlers.drawn());
    sigma.on("resize", () => {
      this.fitRadius();
      this.repaint();
    });
    this.place.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (event.key === "Escape") handlers.chosen(-1);
      if (!way) return;
      event.preventDefault();
      handlers.chosen(this.towards(way[0], way[1]));
    }, { signal: this.gone.signal });
  }

  /** The neighbour of the chosen node that lies best in a direction; the node itself where none does. */
  private towards(dx: number, dy: number): number {
    if (this.selected < 0) return 0;
    const { x, y } = this.topology;
    let best = this.selected, score = 0.3;
    for (const other of this.neighbours[this.selected]) {
      const ux = x[other] - x[this.selected], uy = y[other] - y[this.selected];
      const cosine = (dx * ux + dy * uy) / (Math.hypot(ux, uy) || 1);
      if (cosine > score) [best, score] = [other, cosine];
    }
    return best;
  }

  scale(layer: Layer = this.layer): Scale | null {
    if (layer === "error") return this.growing.error.scale();
    if (layer === "uncertainty") return this.growing.uncertainty.scale();
    return layer === "age" ? { low: 0, high: 2 * (this.topology.stale ?? 1), log: false } : null;
  }

  linkScale(): Scale | null {
    if (this.linkLayer === "loss") return { low: 0, high: 0.5, log: false };
    return this.linkLayer === "age" ? { low: 0, high: this.topology.stale ?? 1, log: false } : null;
  }

  /** Takes a frame in and draws what looks different; true when a scale changed. */
  show(frame: Frame): boolean {
    const grown = [this.growing.error.grow(frame.error), this.growing.uncertainty.grow(frame.uncertainty)];
    const nodes = this.recolourNodes(frame);
    const edges = this.recolourLinks(frame);
    if (nodes.length || edges.length) {
      this.sigma.refresh({ partialGraph: { nodes, edges }, skipIndexation: true, schedule: true });
    }
    return grown.some(Boolean);
  }

  private recolourNodes(frame: Frame): string[] {
    const changed: string[] = [];
    const colours = palette(), scale = this.scale(), blank = theme().unknown;
    const states = this.topology.states.map(stateColour);
    const values = this.layer === "state" ? frame.state : frame[this.layer];
    for (let k = 0; k < values.length; k++) {
      let colour = blank;
      if (this.layer === "state") colour = states[values[k]] ?? blank;
      else if (!(this.layer === "age" && values[k] === Infinity)) colour = colours[level(scale, values[k])] ?? blank;
      if (colour === this.nodeColours[k]) continue;
      this.nodeColours[k] = colour;
      changed.push(String(k));
    }
    return changed;
  }

  private recolourLinks(frame: Frame): string[] {
    const changed: string[] = [];
    const values = this.linkLayer === "none" ? null : this.linkLayer === "loss" ? frame.loss : frame.linkAge;
    const scale = this.linkScale(), colours = wear(), plain = theme().arc, thin = this.thin();
    for (let k = 0; k < this.linkColours.length; k++) {
      const step = values ? level(scale, values[k]) : -1;
      const colour = colours[step] ?? plain;
      const size = step < 0 ? thin : thin * (1 + (2.5 * step) / colours.length);
      if (colour === this.linkColours[k] && size === this.linkSizes[k]) continue;
      [this.linkColours[k], this.linkSizes[k]] = [colour, size];
      changed.push(String(k));
    }
    return changed;
  }

  /** Draws everything again: after another choice of colours, another theme, another size. */
  repaint(frame: Frame | null = null): void {
    if (frame) {
      this.recolourNodes(frame);
      this.recolourLinks(frame);
    }
    this.sigma.refresh({ skipIndexation: true, schedule: true });
  }

  select(node: number): void {
    const nodes = [this.selected, node].filter((k) => k >= 0).map(String);
    this.selected = node;
    this.sigma.refresh({ partialGraph: { nodes }, schedule: true });
  }

  /** Takes itself off the page. */
  end(): void {
    this.gone.abort();
    this.sigma.kill();
  }

  zoom(way: "in" | "out" | "fit"): void {
    const camera = this.sigma.getCamera();
    if (way === "fit") void camera.animatedReset({ duration: 200 });
    else void (way === "in" ? camera.animatedZoom({ duration: 200 }) : camera.animatedUnzoom({ duration: 200 }));
  }

  /** Where a node is, in pixels from the corner of the network's element. */
  at(node: number): { x: number; y: number } {
    const { x, y } = this.topology;
    return this.sigma.graphToViewport({ x: x[node], y: y[node] });
  }

  middle(link: number): { x: number; y: number } {
    const [a, b] = this.topology.arcs[link].map((node) => this.at(node));
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  }

  get colours(): readonly string[] {
    return this.nodeColours;
  }
}

function drawLabel(context: CanvasRenderingContext2D, data: Label): void {
  if (!data.label) return;
  const now = theme();
  const text = data.label.length > 24 ? `${data.label.slice(0, 23)}…` : data.label;
  const x = data.x + 0.75 * data.size + 2, y = data.y - 0.75 * data.size - 2;
  context.font = `500 12px ${FONT}`;
  context.lineJoin = "round";
  context.lineWidth = 3.5;
  context.strokeStyle = now.card;
  context.strokeText(text, x, y);
  context.fillStyle = now.ink;
  context.fillText(text, x, y);
}

function drawHover(context: CanvasRenderingContext2D, data: Label): void {
  context.beginPath();
  context.arc(data.x, data.y, data.size + 3, 0, 2 * Math.PI);
  context.strokeStyle = theme().accent;
  context.lineWidth = 2;
  context.stroke();
  drawLabel(context, data);
}
