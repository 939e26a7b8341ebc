/** The map from above, to be edited: items that are focused, dragged and turned, over what is not edited. */

import { mark, write } from "../dom";
import { boundsOf } from "../geometry/bounds";
import type { Environment } from "../messages";
import { drawFences } from "../plan/fences";
import { Frame, scaleBar } from "../plan/frame";
import { Gestures } from "../plan/gestures";
import { drawBelts, drawFloor, drawSolids } from "../plan/ground";
import { Lanes } from "../plan/lanes";
import { cm, draw, path, show, xy } from "../plan/svg";
import type { Picture } from "./picture";
import type { Item, Items, Section, Sorted } from "./model";
import { middleOf, outlineOf, verticesOf, yawOf } from "./shape";

export interface CanvasEvents {
  choose(id: number): void;
  /** A drag of the chosen item, from where it began; `part`: "" for all of it, "turn", or the number of a vertex. */
  drag(part: string, from: readonly [number, number], to: readonly [number, number], isFree: boolean): void;
  dropped(): void;
  /** A key on an item; true if it was for it. */
  key(event: KeyboardEvent): boolean;
  /** A click beside everything, {W}. */
  click(at: readonly [number, number]): void;
}

/** Strips with more vertices are moved and typed only. */
export const MOST_HANDLES = 12;
/** Distance of the handle that turns, px. */
const TURN_PX = 44;
const LAYERS = ["picture", "ground", "fences", "belts", "items", "handles"] as const;
/** Sections from the lowest to the uppermost: what is on a wall or a box lies over it. Tab goes in this order. */
const ORDER = ["planes", "boxes", "things", "strips", "lamps"] as const;
const KINDS = { strips: "Strip", lamps: "Lamp", boxes: "Box", things: "Thing", planes: "Wall" } as const;

/** What an item is called when it is read out. */
export function titleOf(item: Item): string {
  return `${KINDS[item.section]} ${item.name}`;
}

export class Canvas {
  readonly frame = new Frame();
  readonly svg: SVGSVGElement;
  private readonly box: HTMLDivElement;
  private readonly world: SVGGElement;
  private readonly layers: Record<(typeof LAYERS)[number], SVGGElement>;
  private readonly bar: { line: SVGElement; text: SVGTextElement };
  private readonly sections: Record<Section, SVGGElement>;
  private readonly groups = new Map<number, SVGGElement>();
  private readonly gestures: Gestures;
  private readonly sized: ResizeObserver;
  private map: Environment | null = null;
  private isFitted = true;
  private pressed = [0, 0] as [number, number];

  constructor(
    host: HTMLElement,
    private readonly events: CanvasEvents,
    isDark: boolean,
  ) {
    this.box = document.createElement("div");
    this.box.className = `plan edit-plan${isDark ? " plan-dark" : ""}`;
    this.svg = draw(this.box, "svg", {
      class: "plan-map",
      tabindex: 0,
      role: "group",
      "aria-label":
        "Plan of the map from above. Tab goes to the next thing; plus, minus and 0 zoom, arrows move the plan.",
    });
    this.world = draw(this.svg, "g");
    this.layers = Object.fromEntries(
      LAYERS.map((name) => [name, draw(this.world, "g", { class: `plan-layer-${name}` })]),
    ) as typeof this.layers;
    this.sections = Object.fromEntries(
      ORDER.map((section) => [section, draw(this.layers.items, "g")]),
    ) as typeof this.sections;
    const bar = draw(this.svg, "g", { class: "plan-scale", "aria-hidden": "true" });
    this.bar = { line: draw(bar, "path", {}), text: draw(bar, "text", { x: 14 }) };
    host.append(this.box);
    this.gestures = new Gestures(this.svg, this.frame, {
      moved: () => this.apply(false),
      points: () => undefined,
      fit: () => this.fit(),
    });
    this.svg.addEventListener("pointerdown", ({ clientX, clientY }) => (this.pressed = [clientX, clientY]));
    this.svg.addEventListener("click", (event) => {
      const [x, y] = this.pressed;
      if (Math.hypot(event.clientX - x, event.clientY - y) < 4) this.events.click(this.at(event)); // else it moved the plan
    });
    this.sized = new ResizeObserver(() => this.resize());
    this.sized.observe(this.svg);
  }

  dispose(): void {
    this.gestures.dispose();
    this.sized.disconnect();
  }

  /** Draw what is not edited, and show all of the map. */
  setMap(map: Environment): void {
    const isFirst = this.map === null;
    this.map = map;
    for (const name of ["ground", "fences", "belts"] as const) this.layers[name].replaceChildren();
    drawFloor(this.layers.ground, boundsOf(map));
    drawSolids(this.layers.ground, { ...map, boxes: [], planes: [] });
    drawFences(this.layers.fences, map);
    drawBelts(this.layers.belts, map, new Lanes(map));
    if (isFirst) this.fit();
  }

  setPicture(picture: Picture | null): void {
    this.layers.picture.replaceChildren();
    if (picture) {
      const { source, left, top, width, height } = picture;
      draw(this.layers.picture, "image", {
        href: source,
        x: cm(left),
        y: cm(-top),
        width: cm(width),
        height: cm(height),
        opacity: 0.55,
        preserveAspectRatio: "none",
      });
    }
  }

  draw(items: Items, chosen: Item | null, findings: Sorted): void {
    const gone = new Set(this.groups.keys());
    for (const item of items) {
      if (!middleOf(item)) continue;
      gone.delete(item.id);
      const group = this.groups.get(item.id) ?? this.begin(item);
      const worst =
        [...findings.of(item).values()]
          .flat()
          .map(({ severity }) => severity)
          .sort()[0] ?? "";
      mark(
        group,
        "class",
        `edit-item edit-${item.section} ${worst && `edit-${worst}`}${item === chosen ? " edit-chosen" : ""}`,
      );
      mark(group, "aria-label", `${titleOf(item)}${worst && `, ${worst}`}`);
      mark(group, "aria-pressed", String(item === chosen));
      this.shape(group, item);
    }
    for (const id of gone) {
      this.groups.get(id)!.remove();
      this.groups.delete(id);
    }
    this.handles(chosen);
  }

  focus(item: Item): void {
    this.groups.get(item.id)?.focus();
  }

  /** The place in {W} under the mouse. */
  private at(event: MouseEvent): [number, number] {
    const { left, top } = this.svg.getBoundingClientRect();
    return this.frame.toWorld(event.clientX - left, event.clientY - top);
  }

  private begin({ id, section }: Item): SVGGElement {
    const group = draw(this.sections[section], "g", { tabindex: 0, role: "button" });
    this.groups.set(id, group);
    group.addEventListener("focus", () => this.events.choose(id));
    group.addEventListener("keydown", (event) => {
      if (!this.events.key(event)) return;
      event.preventDefault();
      event.stopPropagation();
    });
    this.drags(group, "", () => this.events.choose(id));
    return group;
  }

  private drags(element: SVGElement, part: string, press: () => void): void {
    let from: [number, number] | null = null;
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.stopPropagation();
      from = this.at(event);
      element.setPointerCapture(event.pointerId);
      press();
    });
    element.addEventListener("pointermove", (event) => {
      if (from) this.events.drag(part, from, this.at(event), event.altKey);
    });
    for (const name of ["pointerup", "pointercancel"] as const) {
      element.addEventListener(name, () => {
        if (from) this.events.dropped();
        from = null;
      });
    }
    element.addEventListener("click", (event) => event.stopPropagation());
  }

  private shape(group: SVGGElement, item: Item): void {
    const signature = JSON.stringify([item.name, item.value]);
    if (group.dataset["shape"] === signature) return;
    group.dataset["shape"] = signature;
    group.replaceChildren();
    const vertices = verticesOf(item);
    const middle = middleOf(item)!;
    const corners = outlineOf(item);
    if (item.section === "strips") {
      const first = item.value["direction"] === -1 ? vertices.at(-1)! : vertices[0]!;
      for (const name of ["edit-reach", "edit-halo", "edit-line"])
        draw(group, "path", { class: name, d: path(vertices) });
      draw(draw(group, "g", { transform: `translate(${xy(first)})` }), "circle", {
        class: "edit-first plan-upright",
        r: 5,
      });
    } else if (corners) {
      for (const name of ["edit-reach", "edit-area"])
        draw(group, "path", { class: name, d: path(corners, true) });
    } else {
      const upright = draw(draw(group, "g", { transform: `translate(${xy(middle)})` }), "g", {
        class: "plan-upright",
      });
      draw(upright, "circle", { class: "edit-reach", r: 14 });
      draw(upright, "circle", { class: "edit-lamp", r: 7 });
    }
    const label = draw(draw(group, "g", { transform: `translate(${xy(middle)})` }), "g", {
      class: "plan-upright",
    });
    draw(label, "text", { class: "plan-name", y: -14, "text-anchor": "middle" }, item.name);
  }

  private handles(chosen: Item | null): void {
    const layer = this.layers.handles;
    const middle = chosen && middleOf(chosen);
    const vertices = chosen?.section === "strips" ? verticesOf(chosen) : [];
    const yaw = chosen && yawOf(chosen);
    const parts = vertices.length <= MOST_HANDLES ? vertices.map((_, i) => String(i)) : [];
    if (middle && yaw !== null) parts.push("turn");
    const signature = middle ? `${chosen.id} ${parts.join(" ")}` : "";
    if (layer.dataset["parts"] !== signature) {
      layer.dataset["parts"] = signature;
      layer.replaceChildren();
      for (const part of parts) {
        const group = draw(layer, "g", { "aria-hidden": "true" });
        const upright = draw(group, "g", { class: "plan-upright" });
        if (part === "turn") draw(upright, "path", { class: "edit-arm", d: `M0 0V${-TURN_PX}` });
        draw(upright, "circle", { class: "edit-reach", r: 14, cy: part === "turn" ? -TURN_PX : 0 });
        draw(upright, "circle", { class: "edit-handle", r: 6, cy: part === "turn" ? -TURN_PX : 0 });
        this.drags(group, part, () => undefined);
      }
    }
    parts.forEach((part, i) => {
      const turn = part === "turn" ? ` rotate(${((-(yaw ?? 0) * 180) / Math.PI).toFixed(2)})` : "";
      mark(
        layer.children[i]!,
        "transform",
        `translate(${xy(part === "turn" ? middle! : vertices[i]!)})${turn}`,
      );
    });
    show(layer, parts.length > 0);
  }

  private fit(): void {
    if (this.map) this.frame.fit(boundsOf(this.map), TURN_PX + 8);
    this.apply(true);
  }

  private resize(): void {
    const { width, height } = this.svg.getBoundingClientRect();
    if (!width || !height) return;
    [this.frame.width, this.frame.height] = [width, height];
    if (this.isFitted) this.fit();
    else this.apply(false);
  }

  private apply(isFitted: boolean): void {
    const { frame } = this;
    this.isFitted = isFitted;
    mark(this.world, "transform", frame.transform);
    this.svg.style.setProperty("--plan-px", String(100 / frame.scale));
    const metres = scaleBar(frame.scale);
    const y = frame.height - 16;
    mark(this.bar.line, "d", `M14 ${y - 5}V${y}H${14 + metres * frame.scale}V${y - 5}`);
    mark(this.bar.text, "y", y - 9);
    write(this.bar.text, metres < 1 ? `${metres * 100} cm` : `${metres} m`);
  }
}
