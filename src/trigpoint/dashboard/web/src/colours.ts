// Palettes that hold for every kind of colour vision, on light and on dark paper.

export interface Theme {
  dark: boolean;
  card: string;
  ink: string;
  muted: string;
  rule: string;
  arc: string;
  accent: string;
  outline: string;
  unknown: string;
  series: string[];
}

export const LEVELS = 64;

// cividis: dark blue to yellow. On light paper large is dark, on dark paper large is bright: large stands out.
const CIVIDIS = [
  [0, 34, 78], [24, 55, 111], [66, 78, 108], [96, 100, 111], [124, 123, 120],
  [154, 147, 118], [187, 173, 109], [221, 200, 88], [254, 232, 56],
];

// Okabe and Ito: anchored, uncovered, relative, silent, paused, away; unknown comes from the theme.
const STATE_LIGHT: Record<string, string> = {
  anchored: "#0072b2", uncovered: "#56b4e9", relative: "#e69f00", silent: "#c1440e", paused: "#9a6fb0", away: "#aab3bd",
};
const STATE_DARK: Record<string, string> = {
  anchored: "#3d9be0", uncovered: "#9fd8ff", relative: "#f0b429", silent: "#f0643c", paused: "#c79adf", away: "#5a6672",
};

const LIGHT: Theme = {
  dark: false, card: "#ffffff", ink: "#17212b", muted: "#5b6773", rule: "#e3e7ec", arc: "#a3afbb", accent: "#c2410c",
  outline: "#3b4754", unknown: "#e4e8ec",
  series: ["#0072b2", "#c1440e", "#009e73", "#9a6fb0", "#b88a00", "#56b4e9", "#17212b"],
};
const DARK: Theme = {
  dark: true, card: "#151d26", ink: "#e6ebf0", muted: "#9ba8b6", rule: "#26313c", arc: "#4d5c6b", accent: "#fb923c",
  outline: "#b8c3cf", unknown: "#2c3742",
  series: ["#58aef0", "#f0814f", "#35c99d", "#c79adf", "#e3c04d", "#9fd8ff", "#e6ebf0"],
};

export const darkPaper = window.matchMedia("(prefers-color-scheme: dark)");

export function theme(): Theme {
  return darkPaper.matches ? DARK : LIGHT;
}

function ramp(stops: number[][], levels: number): string[] {
  return Array.from({ length: levels }, (_, k) => {
    const at = (k / (levels - 1)) * (stops.length - 1);
    const low = Math.min(Math.floor(at), stops.length - 2);
    const mix = stops[low].map((c, i) => Math.round(c + (at - low) * (stops[low + 1][i] - c)));
    return `#${mix.map((c) => c.toString(16).padStart(2, "0")).join("")}`;
  });
}

const RISING = ramp(CIVIDIS, LEVELS);
const FALLING = [...RISING].reverse();

/** Colours from small to large. */
export function palette(): string[] {
  return theme().dark ? RISING : FALLING;
}

const hex = (colour: string): number[] => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
const WEAR_LIGHT = ramp([hex(LIGHT.arc), [214, 140, 60], hex(LIGHT.accent)], LEVELS);
const WEAR_DARK = ramp([hex(DARK.arc), [190, 120, 60], hex(DARK.accent)], LEVELS);

/** Colours of links from good to bad. */
export function wear(): string[] {
  return theme().dark ? WEAR_DARK : WEAR_LIGHT;
}

export function stateColour(state: string): string {
  const now = theme();
  return (now.dark ? STATE_DARK : STATE_LIGHT)[state] ?? now.unknown;
}

/** A scale from numbers to levels; -1 where a number is not known. */
export interface Scale {
  low: number;
  high: number;
  log: boolean;
}

export function level(scale: Scale | null, value: number): number {
  if (Number.isNaN(value) || !scale) return -1;
  if (value >= scale.high) return LEVELS - 1;
  if (!(value > scale.low)) return 0;
  const share = scale.log
    ? Math.log(value / scale.low) / Math.log(scale.high / scale.low)
    : (value - scale.low) / (scale.high - scale.low);
  return Math.min(LEVELS - 1, Math.floor(share * LEVELS));
}

/** A logarithmic scale in whole decades that grows with what is seen, at most six decades. */
export class GrowingScale {
  private low = Infinity;
  private high = 0;

  constructor(range: [number, number] | null = null) {
    if (range) [this.low, this.high] = range;
  }

  /** Takes the numbers in; true when the scale changed. */
  grow(values: Float32Array): boolean {
    const before = this.scale();
    for (const value of values) {
      if (!(value > 0) || value === Infinity) continue;
      if (value < this.low) this.low = value;
      if (value > this.high) this.high = value;
    }
    const after = this.scale();
    return before?.low !== after?.low || before?.high !== after?.high;
  }

  scale(): Scale | null {
    if (!(this.high > 0)) return null;
    const high = 10 ** Math.ceil(Math.log10(this.high) - 1e-9);
    const low = 10 ** Math.floor(Math.log10(Math.max(this.low, high / 1e6)) + 1e-9);
    return { low: Math.min(low, high / 10), high, log: true };
  }
}
