// Play, pause, speed and seeking; only for what was recorded.
import type { Command } from "./protocol";
import { byId, short } from "./text";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 100];

export class Playback {
  private playing = false;
  private readonly play = byId<HTMLButtonElement>("play");
  private readonly seek = byId<HTMLInputElement>("seek");
  private readonly speed = byId<HTMLSelectElement>("speed");
  private readonly clock = byId("clock");

  constructor(
    private readonly times: number[],
    private readonly send: (command: Command) => void,
  ) {
    byId("playback").hidden = false;
    this.seek.max = String(times.length - 1);
    this.play.addEventListener("click", () => this.toggle());
    this.seek.addEventListener("input", () => this.send({ type: "seek", frame: Number(this.seek.value) }));
    this.speed.addEventListener("change", () => this.send({ type: "speed", value: Number(this.speed.value) }));
    document.addEventListener("keydown", (event) => {
      const busy = event.target instanceof Element && event.target.closest("input, select, button, textarea");
      if (event.key !== " " || busy) return;
      event.preventDefault();
      this.toggle();
    });
  }

  private toggle(): void {
    if (!this.play.disabled) this.send({ type: this.playing ? "pause" : "play" });
  }

  state(playing: boolean, speed: number): void {
    this.playing = playing;
    this.play.textContent = playing ? "Pause" : "Play";
    const known = [...new Set([...SPEEDS, speed])].sort((a, b) => a - b);
    this.speed.replaceChildren(...known.map((value) => new Option(`${value} ×`, String(value), false, value === speed)));
  }

  at(index: number): void {
    this.seek.value = String(index);
    this.seek.setAttribute("aria-valuetext", `${short(this.times[index])} s`);
    this.clock.textContent = `${short(this.times[index])} of ${short(this.times[this.times.length - 1])} s`;
  }

  disable(): void {
    for (const control of [this.play, this.seek, this.speed]) control.disabled = true;
  }
}
