/** Boxes, screens and tables: their corners are tapped in stills of two views, which stay in this browser. */

import { el } from "../dom";
import type { ScanThing } from "../wire";
import type { Place } from "./blobs";

const SCREEN = ["its first corner", "the next corner", "the third corner"];
const CORNERS: Record<ScanThing["shape"], readonly string[]> = {
  box: [
    "a corner of its top",
    "the next corner of its top",
    "the third corner of its top",
    "a point of its foot",
  ],
  screen: SCREEN,
  table: SCREEN,
};
const ARROWS: Record<string, readonly [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};
/** Step of the cross by an arrow key, and with Shift, pixels of the still. */
const STEP = 8;
const SMALL_STEP = 1;

const part = <T extends Element = HTMLElement>(id: string) => document.getElementById(id) as unknown as T;

export class Things {
  /** By number of the view, smaller than its picture. */
  private readonly stills: ImageBitmap[] = [];
  /** Width of the pictures, image pixels. */
  private width = 0;
  private taps: Place[] = [];
  private cross: Place | null = null;
  private readonly canvas = part<HTMLCanvasElement>("still");
  private readonly name = part<HTMLInputElement>("thing-name");
  private readonly shape = part<HTMLSelectElement>("thing-shape");
  private readonly views = [
    part<HTMLSelectElement>("thing-first"),
    part<HTMLSelectElement>("thing-second"),
  ] as const;

  /** `done` gets a thing whose corners were tapped in both views. */
  constructor(private readonly done: (thing: Omit<ScanThing, "kind">) => void) {
    for (const field of [this.shape, ...this.views]) field.addEventListener("change", () => this.begin());
    part("thing-back").addEventListener("click", () => {
      this.taps.pop();
      this.draw();
    });
    this.canvas.addEventListener("pointerup", ({ offsetX, offsetY }) => {
      const scale = this.canvas.width / this.canvas.clientWidth;
      this.tap({ u: offsetX * scale, v: offsetY * scale });
    });
    this.canvas.addEventListener("keydown", (event) => {
      const arrow = ARROWS[event.key];
      const step = event.shiftKey ? SMALL_STEP : STEP;
      const at = this.cross ?? { u: this.canvas.width / 2, v: this.canvas.height / 2 };
      if (arrow) {
        this.cross = { u: at.u + step * arrow[0], v: at.v + step * arrow[1] };
        this.draw();
      } else if (event.key === "Enter") this.tap(at);
      else return;
      event.preventDefault();
    });
  }

  /** Keep the still of view `number`, counted from 0, of a picture `width` wide; those of later ones were forgotten. */
  keep(number: number, still: ImageBitmap, width: number): void {
    this.forget(number);
    this.width = width;
    this.stills[number] = still;
    const options = () =>
      Object.keys(this.stills).map((key) => el("option", { value: key, text: String(Number(key) + 1) }));
    for (const field of this.views) field.replaceChildren(...options());
    this.views[0].value = Object.keys(this.stills)[0]!;
    this.views[1].value = String(number);
    this.begin();
  }

  /** Forget the stills from view `number` on. */
  forget(number: number): void {
    for (const still of this.stills.splice(number)) still?.close();
    this.begin();
  }

  private begin(): void {
    part("things").hidden = Object.keys(this.stills).length < 2;
    this.taps = [];
    this.draw();
  }

  private tap(at: Place): void {
    const corners = CORNERS[this.shape.value as ScanThing["shape"]].length;
    if (this.views[0].value === this.views[1].value || this.taps.length >= 2 * corners) return;
    this.taps.push(at);
    this.cross = null;
    this.draw();
    if (this.taps.length < 2 * corners) return;
    if (!this.name.reportValidity()) return void this.taps.pop();
    const scale = this.width / this.canvas.width;
    this.done({
      name: this.name.value.trim(),
      shape: this.shape.value as ScanThing["shape"],
      corners: this.taps
        .slice(0, corners)
        .map((first, i) =>
          [first, this.taps[corners + i]!].map(
            ({ u, v }, view) =>
              [Number(this.views[view]!.value), scale * u, scale * v] as [number, number, number],
          ),
        ),
    });
    this.begin();
  }

  private draw(): void {
    const corners = CORNERS[this.shape.value as ScanThing["shape"]];
    const isSecond = this.taps.length >= corners.length;
    const view = this.views[isSecond ? 1 : 0].value;
    const still = this.stills[Number(view)];
    const next = corners[this.taps.length % corners.length]!;
    part("thing-say").textContent =
      this.views[0].value === this.views[1].value
        ? "Choose two views."
        : `View ${Number(view) + 1}: tap ${next}.`;
    if (!still) return;
    [this.canvas.width, this.canvas.height] = [still.width, still.height];
    const context = this.canvas.getContext("2d")!;
    context.drawImage(still, 0, 0);
    context.font = `600 ${still.width / 30}px system-ui`;
    const arm = still.width / 60;
    const mark = ({ u, v }: Place, text: string) => {
      for (const [colour, wider] of [
        ["#000", 3],
        ["#fff", 1],
      ] as const) {
        context.strokeStyle = context.fillStyle = colour;
        context.lineWidth = (wider * still.width) / 500;
        context.stroke(new Path2D(`M${u - arm} ${v}h${2 * arm}M${u} ${v - arm}v${2 * arm}`));
        if (wider === 1) context.fillText(text, u + 0.7 * arm, v - 0.7 * arm);
        else context.strokeText(text, u + 0.7 * arm, v - 0.7 * arm);
      }
    };
    this.taps.slice(isSecond ? corners.length : 0).forEach((tap, i) => mark(tap, String(i + 1)));
    if (this.cross) mark(this.cross, "");
  }
}
