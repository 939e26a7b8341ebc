/** Names and counts beside what they belong to: elements over the picture, crisp at every resolution. */

import * as THREE from "three";
import { cssColor, inkOn, type Rgb } from "../geometry/appearance";
import { placed, type Rect, type Size, type Wish } from "../geometry/placing";
import type { Read3 } from "../geometry/vec";
import type { Theme } from "./mesh_factory";
import type { Text } from "./sprites";

/** A piece of a label's text; a colour makes it a small badge. */
export interface Piece {
  text: string;
  color?: Rgb;
}

interface Label {
  readonly element: HTMLElement;
  shown: string;
  text: string;
  color: string;
  at: [number, number, number];
  used: boolean;
  placed: string;
  rank: number;
  /** Shown with a legend where the text has no room; 0: it is left out then. */
  number: number;
  /** Where it went aside, px from its wish, and until when it stays there (`performance.now()`). */
  aside: { x: number; y: number; until: number } | null;
  /** Of the element, px; 0: to be measured. */
  width: number;
  height: number;
}

/** Rank of names of lamps and things: aside of a head, rather than left out. */
export const NAME = 0.5;
/** Half of what is kept free about something that is far away, px. */
const MIN_HALF_PX = 4;
/** Size of a number in place of a name, px. */
const NUMBER_PX = { width: 28, height: 22 } as const;
/** A legend that takes more than a line, and more of the picture's height than this share, is left out with its numbers: it would hide what can be pointed at. */
const MAX_LEGEND_SHARE = 0.2;
const LINE_PX = 26;
/** A label that had to go aside stays there so long, ms: what is in its way may move. */
const ASIDE_MS = 3000;

/** Something that is upright about its middle `at`, {W}, m; its label of that key stands on it. */
interface Freed {
  readonly at: Read3;
  readonly wide: number;
  readonly deep: number;
  readonly tall: number;
  readonly key: string;
}

/** Labels of one frame: `begin`, `add` …, `end`. */
export class Labels {
  private readonly layer = document.createElement("div");
  private readonly labels = new Map<string, Label>();
  private readonly point = new THREE.Vector3();
  private numbers: HTMLElement[] = [];
  private legend: HTMLElement | null = null;
  private explained = "";
  private isTooLong = false;
  private theme: Theme | null = null;
  /** What lies over the picture, px from its upper left corner; no label goes there. */
  covered: readonly Rect[] = [];
  /** People, robots and objects in this frame; no label goes there either. */
  private readonly freed: Freed[] = [];

  constructor(host: HTMLElement) {
    this.layer.setAttribute("aria-hidden", "true");
    Object.assign(this.layer.style, {
      position: "absolute",
      inset: "0",
      overflow: "hidden",
      pointerEvents: "none",
    });
    host.append(this.layer);
  }

  begin(theme: Theme): void {
    if (theme !== this.theme) this.clear();
    this.theme = theme;
    this.freed.length = 0;
    for (const label of this.labels.values()) label.used = false;
  }

  /** Show `pieces` above `at` ({W}, m, and `up` more); `color` (CSS) frames it. Of two in one place the greater `rank` has it. */
  add(key: string, at: Read3, up: number, pieces: readonly Piece[], color = "", rank = 0, number = 0): void {
    let label = this.labels.get(key);
    if (!label) {
      label = {
        element: this.make(),
        shown: "",
        text: "",
        color: "",
        at: [0, 0, 0],
        used: true,
        placed: "nowhere yet",
        rank,
        number,
        aside: null,
        width: 0,
        height: 0,
      };
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
    label.text = pieces.map(({ text }) => text).join(" ");
    label.color = color;
    label.width = 0;
    label.element.style.borderColor = color || "transparent";
    label.element.replaceChildren(
      ...pieces.map((piece) => {
        const span = document.createElement("span");
        span.textContent = piece.text;
        if (piece.color) {
          Object.assign(span.style, {
            background: cssColor(piece.color),
            color: inkOn(piece.color),
            borderRadius: "4px",
            padding: "0 5px",
            fontWeight: "700",
          });
        }
        return span;
      }),
    );
  }

  /** The labels of this frame. */
  get texts(): Text[] {
    return [...this.labels]
      .filter(([, { used }]) => used)
      .map(([key, { at, text, color }]) => ({ key, at, text, color }));
  }

  /** Keep something free of labels, that of `key` stands on it; its size in m. */
  keepFree(at: Read3, wide: number, deep: number, tall: number, key = ""): void {
    this.freed.push({ at, wide, deep, tall, key });
  }

  /** Put them where the camera sees their places, beside each other and beside what covers the picture. */
  end(camera: THREE.PerspectiveCamera, width: number, height: number): void {
    const seen: Label[] = [];
    const wishes: Wish[] = [];
    const now = performance.now();
    const taken = [...this.covered];
    const tops = new Map<string, number>();
    for (const each of this.freed) {
      const rect = this.seen(each, camera, width, height);
      if (!rect) continue;
      taken.push(rect);
      if (each.key) tops.set(each.key, rect.y);
    }
    for (const [key, label] of this.labels) {
      if (!label.used) {
        label.element.remove();
        this.labels.delete(key);
        continue;
      }
      this.point.set(...label.at).project(camera);
      const { x, y, z } = this.point;
      if (z >= 1 || Math.abs(x) > 1 || Math.abs(y) > 1) {
        put(label, "");
        continue;
      }
      if (!label.width) {
        label.width = label.element.offsetWidth;
        label.height = label.element.offsetHeight;
      }
      seen.push(label);
      const wish = {
        x: (x + 1) * width * 0.5,
        y: Math.min((1 - y) * height * 0.5, tops.get(key) ?? Infinity),
        width: label.width,
        height: label.height,
        rank: label.rank,
      };
      const { aside } = label;
      wishes.push(
        aside && now < aside.until ? { ...wish, kept: { x: wish.x + aside.x, y: wish.y + aside.y } } : wish,
      );
    }
    const spots = placed(wishes, taken, { width, height });
    this.showNumbers(seen, wishes, spots, { width, height });
    spots.forEach((at, i) => {
      const label = seen[i]!;
      const wish = wishes[i]!;
      put(label, at ? `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px)` : "");
      const x = at ? at.x - wish.x : 0;
      const y = at ? at.y - wish.y : 0;
      const isAside = at !== null && Math.hypot(x + wish.width / 2, y + wish.height) > 1;
      if (!isAside) label.aside = null;
      else if (
        !label.aside ||
        now >= label.aside.until ||
        Math.hypot(x - label.aside.x, y - label.aside.y) > 0.01
      )
        label.aside = { x, y, until: now + ASIDE_MS };
    });
  }

  /** Number what has no room for its name, and explain the numbers. */
  private showNumbers(
    seen: readonly Label[],
    wishes: readonly Wish[],
    spots: readonly ({ x: number; y: number } | null)[],
    picture: Size,
  ): void {
    const without = seen.map((_, i) => i).filter((i) => !spots[i] && seen[i]!.number);
    this.explain(without.map((i) => `${seen[i]!.number} ${seen[i]!.text}`).join(" · "), picture);
    const full = [
      ...this.covered,
      ...spots.flatMap((at, i) =>
        at ? [{ ...at, width: wishes[i]!.width, height: wishes[i]!.height }] : [],
      ),
    ];
    const places = placed(
      without.map((i) => ({ ...wishes[i]!, ...NUMBER_PX, rank: 1 })),
      full,
      picture,
    );
    while (this.numbers.length < without.length) this.numbers.push(this.make());
    this.numbers.forEach((element, n) => {
      const label = seen[without[n] ?? -1];
      const wish = wishes[without[n] ?? -1];
      const at = places[n] ?? (wish && { x: wish.x - NUMBER_PX.width / 2, y: wish.y - NUMBER_PX.height });
      element.style.visibility = label && !this.isTooLong ? "visible" : "hidden";
      if (!label || !at) return;
      element.textContent = String(label.number);
      element.style.transform = `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px)`;
    });
  }

  /** Show the legend of the numbers, if it leaves the picture free. */
  private explain(legend: string, picture: Size): void {
    if (legend === this.explained) return;
    this.explained = legend;
    this.legend ??= this.make();
    const low = Math.max(
      0,
      ...this.covered
        .filter(({ y, height }) => y + height / 2 > picture.height / 2)
        .map(({ y }) => picture.height - y),
    );
    Object.assign(this.legend.style, {
      top: "auto",
      bottom: `${low + 4}px`,
      left: "4px",
      maxWidth: "calc(100% - 8px)",
      boxSizing: "border-box",
      whiteSpace: "normal",
      visibility: "hidden",
    });
    this.legend.textContent = legend;
    this.isTooLong = this.legend.offsetHeight > Math.max(LINE_PX, MAX_LEGEND_SHARE * picture.height);
    if (legend && !this.isTooLong) this.legend.style.visibility = "visible";
  }

  /** The part of the picture that something takes up, px; null behind the camera. */
  private seen(
    { at, wide, deep, tall }: Freed,
    camera: THREE.PerspectiveCamera,
    width: number,
    height: number,
  ): Rect | null {
    const away = -this.point.set(...at).applyMatrix4(camera.matrixWorldInverse).z;
    if (away <= camera.near) return null;
    this.point.applyMatrix4(camera.projectionMatrix);
    const perM = height / (2 * away * Math.tan((camera.fov * Math.PI) / 360));
    const down = Math.abs(camera.matrixWorld.elements[10]!);
    const x = Math.max((wide * perM) / 2, MIN_HALF_PX);
    const y = Math.max(((tall * Math.sqrt(1 - down * down) + deep * down) * perM) / 2, MIN_HALF_PX);
    return {
      x: (this.point.x + 1) * width * 0.5 - x,
      y: (1 - this.point.y) * height * 0.5 - y,
      width: 2 * x,
      height: 2 * y,
    };
  }

  private make(): HTMLElement {
    const element = document.createElement("div");
    const theme = this.theme!;
    Object.assign(element.style, {
      position: "absolute",
      left: "0",
      top: "0",
      display: "flex",
      gap: "5px",
      alignItems: "center",
      whiteSpace: "nowrap",
      padding: "2px 8px",
      borderRadius: "7px",
      border: "2px solid transparent",
      background: theme.paper,
      color: theme.ink,
      font: "600 12px/1.45 system-ui, sans-serif",
      fontVariantNumeric: "tabular-nums",
      willChange: "transform",
    });
    this.layer.append(element);
    return element;
  }

  private clear(): void {
    this.layer.replaceChildren();
    this.labels.clear();
    this.numbers = [];
    this.legend = null;
    this.explained = "";
  }

  dispose(): void {
    this.clear();
    this.layer.remove();
  }
}

/** Position of the label as a CSS transform. It is empty if the label is not shown. */
function put(label: Label, at: string): void {
  if (at === label.placed) return;
  label.placed = at;
  label.element.style.visibility = at ? "visible" : "hidden";
  if (at) label.element.style.transform = at;
}
