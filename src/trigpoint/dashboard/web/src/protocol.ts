// What the server sends and takes; dashboard/frames.py and dashboard/commands.py define it.

export type Layer = "error" | "uncertainty" | "state" | "age";
export type LinkLayer = "loss" | "age";
export type Order = "pause" | "go" | "kill" | "revive";
export type Numbers = (number | null)[];

export interface Topology {
  type: "topology";
  version: number;
  mode: "replay" | "live";
  title: string;
  unit: string;
  names: string[];
  joined: number[];
  x: number[];
  y: number[];
  arcs: [number, number][];
  anchored: number[];
  rate: number | null;
  rate_name: string;
  stale: number | null;
  states: string[];
  colours: Layer[];
  links: LinkLayer[];
  controls: Order[];
  times: number[];
  norm: { times: number[]; values: Numbers };
  error_range: [number, number] | null;
}

export interface Trace {
  type: "trace";
  node: number;
  times: number[];
  estimate: Numbers[];
  truth?: Numbers[];
  error: Numbers;
  uncertainty?: Numbers;
}

export interface LinkFacts {
  neighbour: string;
  state?: string;
  age?: number | null;
  received?: number | null;
  lost?: number | null;
  round_trip?: number | null;
  offset?: number | null;
}

export interface NodeFacts {
  type: "node";
  node: number;
  time: number;
  estimate: Numbers;
  truth: Numbers;
  error: number | null;
  uncertainty: number | null;
  facts: [string, string | number | null][];
  links: LinkFacts[];
}

export interface Happening {
  time: number;
  text: string;
  node: number | null;
}

export type Message =
  | Topology
  | Trace
  | NodeFacts
  | { type: "events"; events: Happening[] }
  | { type: "state"; playing: boolean; speed: number }
  | { type: "refused" | "done"; order: Order; node: number; text?: string }
  | { type: "end"; text: string };

export type Command =
  | { type: "play" | "pause" }
  | { type: "seek"; frame: number }
  | { type: "speed"; value: number }
  | { type: "select"; node: number | null }
  | { type: "order"; order: Order; node: number };

export interface Frame {
  index: number;
  time: number;
  norm: number;
  traffic: number;
  missed: number;
  rejected: number;
  error: Float32Array;
  uncertainty: Float32Array;
  age: Float32Array;
  state: Float32Array;
  loss: Float32Array;
  linkAge: Float32Array;
}

export const VERSION = 2;
const HEAD = 40;

export function decodeFrame(buffer: ArrayBuffer): Frame {
  const view = new DataView(buffer);
  const version = view.getUint32(0, true);
  if (version !== VERSION) throw new Error(`frame version ${version}; this page reads ${VERSION}`);
  const nodes = view.getUint32(4, true);
  const links = view.getUint32(8, true);
  if (buffer.byteLength !== HEAD + 4 * (4 * nodes + 2 * links)) throw new Error("a frame of the wrong length");
  let at = HEAD;
  const take = (count: number): Float32Array => {
    const table = new Float32Array(buffer, at, count); // every browser runs little-endian
    at += 4 * count;
    return table;
  };
  return {
    index: view.getUint32(12, true),
    time: view.getFloat64(16, true),
    norm: view.getFloat32(24, true),
    traffic: view.getFloat32(28, true),
    missed: view.getFloat32(32, true),
    rejected: view.getFloat32(36, true),
    error: take(nodes),
    uncertainty: take(nodes),
    age: take(nodes),
    state: take(nodes),
    loss: take(links),
    linkAge: take(links),
  };
}
