// Numbers as people read them, and small helpers for elements.

export const NONE = "–";

/** Four significant digits, exponents only where they help, a true minus sign. */
export function short(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || Number.isNaN(value)) return NONE;
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 0.001 && size < 1e6 ? String(Number(value.toPrecision(digits))) : exponent(value);
  return text.replace("-", "−");
}

function exponent(value: number): string {
  const [mantissa, power] = value.toExponential(1).split("e");
  return `${mantissa.replace(/\.0$/, "")}e${Number(power)}`.replace("e-", "e−");
}

export function percent(share: number): string {
  return Number.isNaN(share) ? NONE : `${short(100 * share, 2)} %`;
}

/** Seconds in the unit that suits their size. */
export function seconds(value: number | null | undefined): string {
  if (value === null || value === undefined || Number.isNaN(value)) return NONE;
  if (!Number.isFinite(value)) return "never";
  const size = Math.abs(value);
  if (size === 0) return "0 s";
  if (size < 1e-3) return `${short(1e6 * value, 3)} µs`;
  if (size < 1) return `${short(1e3 * value, 3)} ms`;
  return `${short(value, 3)} s`;
}

export function count(value: number): string {
  return Number.isNaN(value) ? NONE : Math.round(value).toLocaleString("en").replaceAll(",", "\u202f");
}

export function byId<T extends HTMLElement = HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page lacks #${id}`);
  return found as T;
}

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  className = "",
  text = "",
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text) made.textContent = text;
  return made;
}

/** Writes only what differs, so that nothing is laid out again for nothing. */
export function write(target: HTMLElement, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}
