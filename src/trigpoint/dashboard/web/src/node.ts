// The card of the chosen node: what it believes, how sure it is, how well it hears its neighbours.
import { stateColour } from "./colours";
import { type Line, Plot } from "./plots";
import type { LinkFacts, NodeFacts, Numbers, Order, Topology, Trace } from "./protocol";
import { NONE, byId, count, element, percent, seconds, short, write } from "./text";

const MOST_COMPONENTS = 6;
const ORDER_TEXT: Record<Order, [string, string]> = {
  pause: ["Pause", "It hears, but neither steps nor speaks"],
  go: ["Go", "Lets a paused node go on"],
  kill: ["Kill", "Ends its process without notice"],
  revive: ["Revive", "Starts it again"],
};

export class NodeCard {
  readonly estimate: Plot;
  readonly error: Plot;
  private node = -1;
  private components = 0;
  private hasTruth = false;
  private hasUncertainty = false;
  private columns = "";

  constructor(
    public topology: Topology,
    private readonly order: (order: Order, node: number) => void,
    private readonly choose: (name: string) => void,
    private readonly again: (node: number) => void,
  ) {
    this.estimate = new Plot(byId("estimate-plot"), false, "", 150);
    this.error = new Plot(byId("error-plot"), true, topology.unit, 150);
    const buttons = byId("orders");
    for (const name of topology.controls) {
      const button = element("button", name === "kill" ? "danger" : "", ORDER_TEXT[name][0]);
      button.type = "button";
      button.id = `order-${name}`;
      button.title = ORDER_TEXT[name][1];
      button.addEventListener("click", () => this.order(name, this.node));
      buttons.append(button);
    }
  }

  select(node: number): void {
    this.node = node;
    const chosen = node >= 0;
    write(byId("chosen"), chosen ? `Node ${this.topology.names[node]}` : "No node chosen");
    byId("hint").hidden = chosen;
    byId("node-body").hidden = !chosen;
    byId("badge").hidden = !chosen;
    byId("orders").hidden = !chosen || !this.topology.controls.length;
    byId("answer").hidden = true;
    byId("facts").replaceChildren();
    this.columns = "";
    if (!chosen) {
      this.estimate.begin([], [[]]);
      this.error.begin([], [[]]);
    }
  }

  trace(trace: Trace): void {
    if (trace.node !== this.node) return;
    const known = (column: Numbers): boolean => column.some((value) => value !== null);
    this.components = Math.min(trace.estimate.length, MOST_COMPONENTS);
    this.hasTruth = Boolean(trace.truth?.some(known));
    this.hasUncertainty = this.topology.colours.includes("uncertainty");
    const lines: Line[] = [], columns: Numbers[] = [];
    for (let k = 0; k < this.components; k++) {
      lines.push({ label: `estimate ${k + 1}`, colour: k });
      columns.push(trace.estimate[k]);
    }
    for (let k = 0; this.hasTruth && k < this.components; k++) {
      lines.push({ label: `true ${k + 1}`, colour: k, dashed: true, width: 1.2 });
      columns.push(trace.truth![k]);
    }
    this.estimate.begin(lines, [trace.times, ...columns]);
    const other: Line[] = [{ label: "error", colour: 1 }];
    const values = [trace.error];
    if (this.hasUncertainty) {
      other.push({ label: "stated uncertainty", colour: 0, dashed: true });
      values.push(trace.uncertainty ?? trace.times.map(() => null));
    }
    this.error.begin(other, [trace.times, ...values]);
  }

  /** What is known now; a live run's traces grow by it. */
  show(facts: NodeFacts, state: number): void {
    if (facts.node !== this.node) return;
    if (this.topology.mode === "live") {
      if (facts.estimate.length && (!this.components || (facts.truth.length && !this.hasTruth))) {
        this.hasTruth = facts.truth.length > 0;
        this.again(facts.node); // the traces were sent before this was known: ask for them once more
      }
      const truth = this.hasTruth ? facts.truth.slice(0, this.components) : [];
      const estimate = Array.from({ length: this.components }, (_, k) => facts.estimate[k] ?? null);
      this.estimate.push(facts.time, [...estimate, ...truth]);
      this.error.push(facts.time, [facts.error, ...(this.hasUncertainty ? [facts.uncertainty] : [])]);
    }
    this.badge(this.topology.states[state] ?? "unknown");
    this.listFacts(facts);
    this.listLinks(facts.links);
  }

  private badge(state: string): void {
    const badge = byId("badge");
    write(badge, state);
    badge.style.setProperty("--state", stateColour(state));
  }

  private listFacts(facts: NodeFacts): void {
    const unit = this.topology.unit && ` ${this.topology.unit}`;
    const rows: [string, string][] = [["estimate", facts.estimate.map((v) => short(v)).join(", ") || NONE]];
    if (this.hasTruth) rows.push(["true", facts.truth.map((v) => short(v)).join(", ") || NONE]);
    rows.push(["error", `${short(facts.error)}${facts.error === null ? "" : unit}`]);
    if (this.hasUncertainty) rows.push(["stated uncertainty", short(facts.uncertainty)]);
    for (const [name, value] of facts.facts) rows.push([name, typeof value === "number" ? short(value) : (value ?? NONE)]);
    const list = byId("facts");
    if (list.childElementCount !== rows.length) {
      list.replaceChildren(...rows.map(() => {
        const row = element("div");
        row.append(element("dt"), element("dd"));
        return row;
      }));
    }
    rows.forEach(([name, value], k) => {
      const row = list.children[k];
      write(row.children[0] as HTMLElement, name);
      write(row.children[1] as HTMLElement, value);
    });
  }

  private listLinks(links: LinkFacts[]): void {
    const measured = links.some((link) => link.received !== undefined);
    const heads = measured
      ? ["Name", "Link", "Age", "Received", "Lost", "Share", "Round trip", "Clock offset"]
      : ["Name"];
    const key = `${this.node} ${links.map((link) => link.neighbour).join("\n")} ${measured}`;
    const table = byId<HTMLTableElement>("links");
    if (key !== this.columns) {
      this.columns = key;
      const head = element("tr");
      head.append(...heads.map((text) => {
        const cell = element("th", "", text);
        cell.scope = "col";
        return cell;
      }));
      table.tHead!.replaceChildren(head);
      table.tBodies[0].replaceChildren(...links.map((link) => this.row(link.neighbour, heads.length)));
    }
    if (!measured) return;
    links.forEach((link, row) => {
      const lost = link.lost ?? NaN, received = link.received ?? NaN;
      const cells = [
        link.state ?? "", seconds(link.age), count(received), count(lost),
        percent(lost + received > 0 ? lost / (lost + received) : NaN), seconds(link.round_trip), seconds(link.offset),
      ];
      cells.forEach((text, k) => write(table.tBodies[0].rows[row].cells[k + 1], text));
    });
  }

  private row(name: string, cells: number): HTMLTableRowElement {
    const row = element("tr");
    const first = element("th");
    first.scope = "row";
    const button = element("button", "link", name);
    button.type = "button";
    button.addEventListener("click", () => this.choose(name));
    first.append(button);
    row.append(first, ...Array.from({ length: cells - 1 }, () => element("td")));
    return row;
  }

  answer(text: string, good: boolean): void {
    const place = byId("answer");
    place.hidden = false;
    place.dataset.kind = good ? "good" : "bad";
    write(place, text);
  }

  restyle(): void {
    this.estimate.restyle();
    this.error.restyle();
  }
}
