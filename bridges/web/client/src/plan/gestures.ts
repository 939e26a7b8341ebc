/** Mouse, fingers and keys over the plan: drag and pinch move it, the wheel zooms, moving points. */

import type { Frame } from "./frame";

export interface GestureEvents {
  /** The frame was changed by the person. */
  moved(): void;
  /** The pointer is at (px, py) of the plan and points. */
  points(px: number, py: number): void;
  /** Show everything again. */
  fit(): void;
}

/** Pixels that an arrow key moves the plan by. */
const STEP = 60;

export class Gestures {
  /** While on, a mouse that hovers and a single finger point; else they move the plan. */
  pointing = false;
  private readonly down = new Map<number, { x: number; y: number }>();
  private readonly stop = new AbortController();

  constructor(
    private readonly svg: SVGSVGElement,
    private readonly frame: Frame,
    private readonly events: GestureEvents,
  ) {
    const options = { signal: this.stop.signal };
    svg.addEventListener("pointerdown", (event) => this.press(event), options);
    svg.addEventListener("pointermove", (event) => this.move(event), options);
    for (const name of ["pointerup", "pointercancel"] as const)
      svg.addEventListener(name, (event) => this.down.delete(event.pointerId), options);
    svg.addEventListener("wheel", (event) => this.wheel(event), { ...options, passive: false });
    svg.addEventListener("keydown", (event) => this.key(event), options);
    svg.addEventListener(
      "dblclick",
      () => {
        if (!this.pointing) this.events.fit();
      },
      options,
    );
  }

  /** Listen no more. */
  dispose(): void {
    this.stop.abort();
  }

  private at(event: MouseEvent): { x: number; y: number } {
    const { left, top } = this.svg.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  private press(event: PointerEvent): void {
    const at = this.at(event);
    this.down.set(event.pointerId, at);
    this.svg.setPointerCapture(event.pointerId);
    if (this.pointing && event.pointerType !== "mouse" && this.down.size === 1)
      this.events.points(at.x, at.y);
  }

  private move(event: PointerEvent): void {
    const at = this.at(event);
    const before = this.down.get(event.pointerId);
    if (!before) {
      if (this.pointing && event.pointerType !== "touch") this.events.points(at.x, at.y);
      return;
    }
    if (this.down.size === 1) {
      if (this.pointing && event.pointerType !== "mouse") this.events.points(at.x, at.y);
      else this.frame.pan(at.x - before.x, at.y - before.y);
    } else {
      this.pinch(event.pointerId, before, at);
    }
    this.down.set(event.pointerId, at);
    this.events.moved();
  }

  private pinch(id: number, before: { x: number; y: number }, at: { x: number; y: number }): void {
    const other = [...this.down].find(([each]) => each !== id)?.[1];
    if (!other) return;
    const [was, is] = [
      Math.hypot(before.x - other.x, before.y - other.y),
      Math.hypot(at.x - other.x, at.y - other.y),
    ];
    if (was > 10 && is > 10) this.frame.zoom(is / was, (at.x + other.x) / 2, (at.y + other.y) / 2);
    this.frame.pan((at.x - before.x) / 2, (at.y - before.y) / 2);
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const { x, y } = this.at(event);
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.frame.zoom(Math.exp(-Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.0018), x, y);
    this.events.moved();
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const middle: [number, number] = [this.frame.width / 2, this.frame.height / 2];
    const pans: Record<string, [number, number]> = {
      ArrowLeft: [STEP, 0],
      ArrowRight: [-STEP, 0],
      ArrowUp: [0, STEP],
      ArrowDown: [0, -STEP],
    };
    const pan = pans[event.key];
    if (event.key === "+" || event.key === "=") this.frame.zoom(1.25, ...middle);
    else if (event.key === "-") this.frame.zoom(0.8, ...middle);
    else if (event.key === "0") return this.events.fit();
    else if (pan && !this.pointing) this.frame.pan(...pan);
    else return;
    event.preventDefault();
    event.stopPropagation();
    this.events.moved();
  }
}
