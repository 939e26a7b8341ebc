/** Names and counts beside what they belong to: elements over the picture, crisp at every resolution. */

import * as THREE from "three";
import type { Read3 } from "../geometry/vec";
import type { Theme } from "./kit";

/** A piece of a label's text; a colour makes it a small badge. */
export interface Piece {
  text: string;
  color?: string;
}

interface Label {
  readonly element: HTMLElement;
  shown: string;
  at: [number, number, number];
  used: boolean;
  placed: string;
}

/** Labels of one frame: `begin`, `add` …, `end`. */
export class Labels {
  private readonly layer = document.createElement("div");
  private readonly labels = new Map<string, Label>();
  private readonly point = new THREE.Vector3();
  private theme: Theme | null = null;

  constructor(host: HTMLElement) {
    this.layer.setAttribute("aria-hidden", "true");
    Object.assign(this.layer.style, { position: "absolute", inset: "0", overflow: "hidden", pointerEvents: "none" });
    host.append(this.layer);
  }

  begin(theme: Theme): void {
    if (theme !== this.theme) this.clear();
    this.theme = theme;
    for (const label of this.labels.values()) label.used = false;
  }

  /** Show `pieces` above `at` ({W}, m, and `up` more); `color` (CSS) frames it. */
  add(key: string, at: Read3, up: number, pieces: readonly Piece[], color = ""): void {
    let label = this.labels.get(key);
    if (!label) {
      label = { element: this.make(), shown: "", at: [0, 0, 0], used: true, placed: "nowhere yet" };
      this.labels.set(key, label);
    }
    label.used = true;
    label.at[0] = at[0];
    label.at[1] = at[1];
    label.at[2] = at[2] + up;
    let shown = color;
    for (const piece of pieces) shown += `|${piece.text}#${piece.color ?? ""}`;
    if (shown === label.shown) return;
    label.shown = shown;
    label.element.style.borderColor = color || "transparent";
    label.element.replaceChildren(...pieces.map((piece) => {
      const span = document.createElement("span");
      span.textContent = piece.text;
      if (piece.color) {
        Object.assign(span.style, {
          background: piece.color, color: inkOn(piece.color), borderRadius: "4px", padding: "0 5px", fontWeight: "700",
        });
      }
      return span;
    }));
  }

  /** Put them where the camera sees their places. */
  end(camera: THREE.PerspectiveCamera, width: number, height: number): void {
    for (const [key, label] of this.labels) {
      if (!label.used) {
        label.element.remove();
        this.labels.delete(key);
        continue;
      }
      this.point.set(...label.at).project(camera);
      const { x, y, z } = this.point, inside = z < 1 && Math.abs(x) < 1.1 && Math.abs(y) < 1.1;
      const placed = inside
        ? `translate(${((x + 1) * width * 0.5).toFixed(1)}px, ${((1 - y) * height * 0.5).toFixed(1)}px) translate(-50%, -100%)`
        : "";
      if (placed === label.placed) continue;
      label.placed = placed;
      label.element.style.visibility = inside ? "visible" : "hidden";
      if (inside) label.element.style.transform = placed;
    }
  }

  private make(): HTMLElement {
    const element = document.createElement("div"), theme = this.theme!;
    Object.assign(element.style, {
      position: "absolute", left: "0", top: "0", display: "flex", gap: "5px", alignItems: "center", whiteSpace: "nowrap",
      padding: "2px 8px", borderRadius: "7px", border: "2px solid transparent", background: theme.paper, color: theme.ink,
      font: "600 12px/1.45 system-ui, sans-serif", fontVariantNumeric: "tabular-nums", willChange: "transform",
    });
    this.layer.append(element);
    return element;
  }

  private clear(): void {
    this.layer.replaceChildren();
    this.labels.clear();
  }

  dispose(): void {
    this.clear();
    this.layer.remove();
  }
}

/** Black or white, whichever is read better on `#rrggbb`. */
export function inkOn(color: string): string {
  const value = Number.parseInt(color.slice(1), 16);
  const bright = 0.299 * (value >> 16) + 0.587 * ((value >> 8) & 255) + 0.114 * (value & 255);
  return bright > 140 ? "#10141a" : "#ffffff";
}
