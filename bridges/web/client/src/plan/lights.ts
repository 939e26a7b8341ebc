/** Strips as rows of coloured pixels, and lamps. */

import { mark } from "../dom";
import type { Environment, StripsFrame } from "../messages";
import { isOfThing, type Site } from "../site/site";
import { cssColor } from "../geometry/appearance";
import { darkLamps } from "../site/things";
import { edges, paths } from "./runs";
import { placeName } from "../words";
import { draw, show, xy } from "./svg";
import type { Lanes } from "./lanes";

/** One strip: its pixels' edges, and a path for each colour that it shows. */
interface Row {
  at: string[];
  group: SVGGElement;
  pens: SVGPathElement[];
  shown: Uint8Array | null;
}

export class Lights {
  private readonly rows = new Map<string, Row>();
  private readonly lamps = new Map<
    string,
    { bulb: SVGElement; halo: SVGElement; target: SVGElement; note: SVGTextElement }
  >();
  private frame: StripsFrame | null = null;

  /** `strips` and `lamps` are layers of the plan, emptied by who calls. */
  constructor(strips: Element, lamps: Element, map: Environment, lanes: Lanes) {
    for (const strip of map.strips) {
      const line = lanes.line("strip", strip.id);
      if (!line) continue;
      const at = edges(strip, line);
      const d = `M${at.join("L")}`;
      const group = draw(strips, "g", { "aria-hidden": "true" });
      draw(strips, "path", { class: "plan-gaps", d, pathLength: strip.pixels });
      draw(group, "path", { class: "plan-strip", d });
      this.rows.set(strip.id, { at, group, pens: [], shown: null });
    }
    for (const lamp of map.lamps) {
      const group = draw(draw(lamps, "g", { transform: `translate(${xy(lamp.position_m)})` }), "g", {
        class: "plan-upright",
      });
      const halo = draw(group, "circle", { class: "plan-halo", r: 16 });
      const target = draw(group, "circle", { class: "plan-target", r: 15 });
      const bulb = draw(group, "circle", { class: "plan-lamp", r: 7 });
      if (!isOfThing(map, lamp.id))
        draw(
          group,
          "text",
          { class: "plan-name", y: -21, "text-anchor": "middle" },
          placeName(lamp.id, "lamp"),
        );
      const note = draw(group, "text", { class: "plan-note", y: 32, "text-anchor": "middle" });
      this.lamps.set(lamp.id, { bulb, halo, target, note });
    }
  }

  update(site: Site): void {
    if (site.strips && site.strips !== this.frame) {
      this.frame = site.strips;
      for (const strip of site.strips.strips) this.colour(strip.id, strip.rgb);
    }
    const wanted = new Map<string, string>();
    const dark = darkLamps(site);
    for (const person of site.people.values()) {
      const search = person.localization;
      if (search?.phase === "sampling" && search.target_id)
        wanted.set(search.target_id, `${person.user}: ${Math.round(search.progress * 100)} %`);
    }
    for (const [id, { bulb, halo, target, note }] of this.lamps) {
      const color = dark.has(id) ? undefined : site.lamps.get(id)?.color;
      const isLit = !!color && color.some((part) => part > 0);
      mark(bulb, "fill", isLit ? cssColor(color) : "none");
      mark(halo, "fill", isLit ? cssColor(color) : "none");
      show(halo, isLit);
      show(target, wanted.has(id));
      const text = wanted.get(id) ?? "";
      if (note.textContent !== text) note.textContent = text;
    }
  }

  private colour(id: string, rgb: Uint8Array): void {
    const row = this.rows.get(id);
    if (!row || (row.shown && same(row.shown, rgb))) return;
    row.shown = rgb;
    let used = 0;
    for (const [colour, d] of paths(rgb, row.at)) {
      const pen = row.pens[used] ?? draw(row.group, "path", { class: "plan-lit" });
      row.pens[used++] = pen;
      mark(pen, "stroke", colour);
      mark(pen, "d", d);
      show(pen, true);
    }
    for (const pen of row.pens.slice(used)) show(pen, false);
  }
}

function same(a: Uint8Array, b: Uint8Array): boolean {
  if (a.length !== b.length) return false;
  for (let i = 0; i < a.length; i++) if (a[i] !== b[i]) return false;
  return true;
}
