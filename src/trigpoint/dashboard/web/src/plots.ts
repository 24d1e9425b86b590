// Plots over time: uPlot draws them, in the colours of the theme.
import uPlot from "uplot";
import { theme } from "./colours";
import type { Numbers } from "./protocol";
import { short } from "./text";

const MOST_POINTS = 4000;

export interface Line {
  label: string;
  colour: number; // of the theme's series
  dashed?: boolean;
  width?: number;
}

export class Plot {
  private plot: uPlot | null = null;
  private lines: Line[] = [];
  private data: Numbers[] = [[]];
  private dirty = false;
  /** Time of the vertical mark of a replay. */
  mark: number | null = null;

  constructor(
    private readonly place: HTMLElement,
    private readonly log: boolean,
    private readonly unit: string,
    private readonly height: number,
  ) {
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(place);
  }

  get points(): number {
    return this.data[0].length;
  }

  get labels(): string[] {
    return this.lines.map((line) => line.label);
  }

  /** Begins anew with these lines and columns: the times first. */
  begin(lines: Line[], columns: Numbers[]): void {
    this.lines = lines;
    const first = columns[0].findIndex((_, row) => columns.some((column, k) => k > 0 && column[row] !== null));
    const known = columns.map((column) => column.slice(first < 0 ? column.length : first)); // from what is known on
    this.data = known.map((column, k) => (k && this.log ? column.map(positive) : column));
    this.restyle();
  }

  /** Adds one sample; where there are too many, every second one goes. */
  push(time: number, values: Numbers): void {
    const times = this.data[0];
    const last = times[times.length - 1];
    if (last !== undefined && last !== null && time <= last) return;
    if (last === undefined && values.every((value) => value === null)) return;
    times.push(time);
    for (let k = 1; k < this.data.length; k++) {
      const value = values[k - 1] ?? null;
      this.data[k].push(this.log ? positive(value) : value);
    }
    if (times.length > MOST_POINTS) this.data = this.data.map((column) => column.filter((_, k) => k % 2 === 0));
    this.dirty = true;
  }

  draw(): void {
    if (!this.plot || !this.dirty) return;
    this.dirty = false;
    this.plot.setData(this.data as uPlot.AlignedData);
  }

  moveMark(time: number): void {
    if (this.mark === time) return;
    this.mark = time;
    this.plot?.redraw(false, false);
  }

  /** Builds the plot again, for other lines or another theme. */
  restyle(): void {
    this.plot?.destroy();
    this.place.replaceChildren();
    this.dirty = false;
    if (!this.lines.length) return;
    this.plot = new uPlot(this.options(), this.data as uPlot.AlignedData, this.place);
  }

  private size(): { width: number; height: number } {
    return { width: Math.max(220, this.place.clientWidth), height: this.height };
  }

  private options(): uPlot.Options {
    const now = theme();
    const font = '12px system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif';
    const axis = { stroke: now.muted, font, grid: { stroke: now.rule, width: 1 }, ticks: { show: false } };
    return {
      ...this.size(),
      padding: [8, 14, 0, 0],
      legend: { markers: { width: 2, fill: () => "transparent", dash: (plot, k) => (plot.series[k].dash ? "dashed" : "solid") } },
      cursor: { points: { size: 7 }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: this.log ? { distr: 3, range: decades } : {} },
      axes: [
        { ...axis, size: 30, values: (_, at) => at.map((t, k) => (k === at.length - 1 ? `${short(t)} s` : short(t))) },
        {
          ...axis,
          size: 58,
          ...(this.log ? { splits: wholeDecades, filter: (_: uPlot, splits: number[]) => splits } : {}),
          values: (_, at) => at.map((v) => (v === null ? "" : this.log ? decade(v) : short(v))),
        },
      ],
      series: [
        { label: "time", value: (_, t) => (t === null ? "" : `${short(t)} s`) },
        ...this.lines.map((line) => ({
          label: line.label,
          stroke: line.colour < 0 ? now.muted : now.series[line.colour % now.series.length],
          width: line.width ?? 1.8,
          dash: line.dashed ? [5, 4] : undefined,
          points: { show: false },
          spanGaps: false,
          value: (_: uPlot, v: number | null) => (v === null ? "" : `${short(v)}${this.unit && ` ${this.unit}`}`),
        })),
      ],
      hooks: { draw: [(plot) => this.drawMark(plot)] },
    };
  }

  private drawMark(plot: uPlot): void {
    if (this.mark === null) return;
    const x = Math.round(plot.valToPos(this.mark, "x", true));
    const { left, top, width, height } = plot.bbox;
    if (x < left || x > left + width) return;
    plot.ctx.fillStyle = theme().accent;
    plot.ctx.fillRect(x, top, 1.5 * devicePixelRatio, height);
  }
}

const positive = (value: number | null): number | null => (value !== null && value > 0 ? value : null);

/** Whole decades around what is drawn, at least one. */
function decades(_: uPlot, low: number, high: number): uPlot.Range.MinMax {
  if (!(low > 0) || !(high > 0)) return [0.1, 1];
  const bottom = Math.floor(Math.log10(low) + 1e-9), top = Math.ceil(Math.log10(high) - 1e-9);
  return [10 ** bottom, 10 ** Math.max(top, bottom + 1)];
}

/** Grid lines at whole powers of ten, at most six. */
function wholeDecades(_: uPlot, __: number, low: number, high: number): number[] {
  const bottom = Math.round(Math.log10(low)), top = Math.round(Math.log10(high));
  const step = Math.max(1, Math.ceil((top - bottom) / 5));
  return Array.from({ length: Math.floor((top - bottom) / step) + 1 }, (___, k) => 10 ** (bottom + k * step));
}

function decade(value: number): string {
  const power = Math.log10(value);
  if (Math.abs(power - Math.round(power)) > 1e-6) return "";
  return Math.abs(power) < 3.5 ? short(value) : `1e${Math.round(power)}`.replace("-", "−");
}
