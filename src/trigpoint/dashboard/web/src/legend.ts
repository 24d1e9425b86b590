// The legend: what the colours mean, in numbers and units.
import { type Scale, palette, stateColour, theme, wear } from "./colours";
import type { Network } from "./network";
import type { Frame, Topology } from "./protocol";
import { byId, element, seconds, short } from "./text";

const TITLES = { error: "error of a node", uncertainty: "stated uncertainty", age: "last heard" };
const UNKNOWN = { error: "no error known", uncertainty: "none stated", age: "never heard" };

export function drawLegend(topology: Topology, network: Network, frame: Frame | null): void {
  const place = byId("legend");
  const parts: HTMLElement[] = network.layer === "state" ? states(topology, frame) : ramp(topology, network, frame);
  const links = network.linkScale();
  if (links) {
    const loss = network.linkLayer === "loss";
    const title = loss ? "link: share lost" : "link: last message";
    parts.push(bar(title, wear(), loss ? ["0 %", "≥ 50 %"] : ["0 s", `≥ ${seconds(links.high)}`], "links"));
  }
  if (topology.anchored.length) {
    const item = element("span", "item");
    item.append(element("i", "dot anchor"), "has an absolute reading");
    parts.push(item);
  }
  place.replaceChildren(...parts);
}

function ramp(topology: Topology, network: Network, frame: Frame | null): HTMLElement[] {
  const layer = network.layer as "error" | "uncertainty" | "age";
  const scale = network.scale();
  const unit = layer === "age" ? "" : topology.unit ? `, ${topology.unit}` : ", unit of the state";
  const parts = [bar(`${TITLES[layer]}${unit}`, palette(), scale ? ticks(scale) : ["none yet"], layer)];
  const lacks = layer === "age" ? (v: number) => v === Infinity : Number.isNaN;
  const missing = frame ? frame[layer].reduce((sum, value) => sum + (lacks(value) ? 1 : 0), 0) : 0;
  if (missing) {
    const item = element("span", "item");
    item.append(swatch(theme().unknown), `${UNKNOWN[layer]} (${missing})`);
    parts.push(item);
  }
  return parts;
}

function ticks(scale: Scale): string[] {
  if (!scale.log) return [seconds(scale.low), seconds((scale.low + scale.high) / 2), `≥ ${seconds(scale.high)}`];
  const span = Math.round(Math.log10(scale.high / scale.low));
  const step = span <= 5 ? 1 : 2;
  return Array.from({ length: span / step + 1 }, (_, k) => short(scale.low * 10 ** (k * step)));
}

function bar(title: string, colours: string[], labels: string[], name: string): HTMLElement {
  const item = element("span", "scale");
  item.dataset.scale = name;
  const strip = element("span", "strip");
  strip.style.background = `linear-gradient(to right, ${colours.join(",")})`;
  const row = element("span", "ticks");
  row.append(...labels.map((text) => element("span", "", text)));
  const body = element("span", "body");
  body.append(strip, row);
  item.append(element("span", "", title), body);
  return item;
}

function swatch(colour: string): HTMLElement {
  const dot = element("i", "dot");
  dot.style.background = colour;
  return dot;
}

function states(topology: Topology, frame: Frame | null): HTMLElement[] {
  const counts = topology.states.map(() => 0);
  frame?.state.forEach((state) => counts[state]++);
  return topology.states.flatMap((state, k) => {
    if (!counts[k] && state !== "anchored" && state !== "relative") return [];
    const item = element("span", "item");
    item.append(swatch(stateColour(state)), `${state} ${counts[k]}`);
    return [item];
  });
}
