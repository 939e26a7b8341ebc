/** What is selected, about to be, or under a cursor: outlines, rings in the owner's pattern, gauges. */

import {
  cssColor,
  kindColor,
  kindLetter,
  visibleColor,
  type Pattern,
  type Rgb,
} from "../geometry/appearance";
import type { Vec3 } from "../geometry/vec";
import { currentBoxColor, WHITE } from "../site/box_color";
import { holdersOf, ownersOf, type Site } from "../site/site";
import { NAME, type Labels } from "./labels";
import type { Marks } from "./marks";
import type { Thing, Things } from "./things";

const REFUSED: Rgb = [255, 70, 60];

/** Draw the state of every thing of `site`. */
export function state(site: Site, things: Things, marks: Marks, labels: Labels, dark: boolean): void {
  things.beginOutlines();
  for (const [id, user] of ownersOf(site)) {
    const thing = things.byId.get(id);
    const profile = site.people.get(user)?.profile;
    if (!thing) continue;
    const color = visibleColor(profile?.cursor_color ?? WHITE, dark);
    things.outline(thing, color);
    ring(thing, marks, color, profile?.pattern ?? "solid", 1);
  }
  for (const [id, user] of holdersOf(site)) {
    const thing = things.byId.get(id);
    if (thing)
      ring(
        thing,
        marks,
        visibleColor(site.people.get(user)?.profile?.cursor_color ?? WHITE, dark),
        "dotted",
        0.7,
      );
  }
  things.endOutlines();
  things.paintBoxes(({ object }) => currentBoxColor(site, object));
  let rank = 0;
  for (const { hover, profile, user } of site.people.values()) {
    const thing = hover?.object_id ? things.byId.get(hover.object_id) : undefined;
    if (!thing || !hover) continue;
    const color = visibleColor(profile?.cursor_color ?? WHITE, dark);
    const up = thing.up + thing.size[2] / 2 + (thing.form === "box" ? 0.34 : 0.2); // above its name
    const shown = hover.action === "refuse" ? REFUSED : color;
    const radius = 0.1 + 0.035 * (rank++ % 3);
    if (!dark)
      marks.add(thing.placed.at, radius * 1.06, [20, 25, 32], { faces: true, thick: 0.34, alpha: 0.4 }, up);
    marks.add(thing.placed.at, radius, shown, { faces: true, thick: 0.28, progress: hover.progress }, up);
    if (hover.taken_by && hover.action === "refuse") {
      labels.add(
        `taken ${user}`,
        thing.placed.at,
        up + 0.16,
        [{ text: `taken by ${hover.taken_by}` }],
        cssColor(color),
        1,
      );
    }
  }
  let number = 0;
  const parts = partsOf(
    [...things.byId.values()].filter(({ form, object }) => form === "box" && !object.press),
  );
  for (const thing of things.byId.values()) {
    if (parts.has(thing)) continue;
    if (thing.form === "package") continue;
    const { kind, id } = thing.object;
    if (thing.form === "box") {
      labels.add(
        `thing ${id}`,
        thing.placed.at,
        thing.size[2] / 2 + 0.08,
        [{ text: kind || id }],
        "",
        NAME,
        ++number,
      );
      continue;
    }
    const letter = { text: kindLetter(kind) || "?", color: kindColor(kind) };
    labels.add(
      `thing ${id}`,
      thing.placed.at,
      thing.form === "segment" ? 0.06 : 0.2,
      thing.form === "robot" ? [{ text: id }] : [letter],
    );
    if (thing.form === "robot")
      marks.add([thing.placed.at[0], thing.placed.at[1], 0], 0.12, WHITE, { thick: 0.12, alpha: 0.4 }, 0.01);
  }
}

/** Boxes of one kind that are nearer to each other have one name, m: links of an arm. */
const APART_M = 0.2;

/** Boxes without a name of their own: each is part of a whole of its kind, whose topmost box has the name. */
export function partsOf<Box extends Pick<Thing, "object" | "placed" | "size">>(
  boxes: readonly Box[],
): Set<Box> {
  const parts = new Set<Box>();
  const kinds = new Map<string, Box[]>();
  for (const box of boxes) kinds.set(box.object.kind, [...(kinds.get(box.object.kind) ?? []), box]);
  for (const [kind, alike] of kinds) {
    if (kind === "" || alike.length === 1) continue; // as most things: each has a name of its own
    for (const whole of wholesOf(alike)) {
      const named = whole.reduce((top, each) => (each.placed.at[2] > top.placed.at[2] ? each : top));
      for (const each of whole) if (each !== named) parts.add(each);
    }
  }
  return parts;
}

/** Boxes that are connected, directly or by others, as one group each. */
function wholesOf<Box extends Pick<Thing, "placed" | "size">>(boxes: readonly Box[]): Box[][] {
  const wholes: Box[][] = [];
  for (const box of boxes) {
    const near = wholes.filter((whole) => whole.some((each) => gap(each, box) < APART_M));
    for (const whole of near) wholes.splice(wholes.indexOf(whole), 1);
    wholes.push([box, ...near.flat()]);
  }
  return wholes;
}

function gap(
  { placed: one, size }: Pick<Thing, "placed" | "size">,
  { placed: other }: Pick<Thing, "placed">,
): number {
  return Math.hypot(...one.at.map((part, axis) => part - other.at[axis]!)) - Math.max(...size);
}

/** What came out at each bay, by kind. */
export function counts(site: Site, bays: readonly { id: string; at: Vec3 }[], labels: Labels): void {
  for (const { id, at } of bays) {
    const out = site.conveyor?.bays.filter(({ bay }) => bay === id) ?? [];
    labels.add(
      `bay ${id}`,
      at,
      0.22,
      [
        { text: /^bay/i.test(id) ? id : `Bay ${id}` },
        ...out.map(({ kind, count }) => ({ text: `${kindLetter(kind)} ${count}`, color: kindColor(kind) })),
      ],
      "",
      1,
    );
  }
}

function ring(thing: Thing, marks: Marks, color: Rgb, pattern: Pattern, alpha: number): void {
  const { form, placed, size, up } = thing;
  if (form === "package" || form === "box") {
    marks.add(
      placed.at,
      0.62 * Math.max(size[0], size[1]),
      color,
      { pattern, thick: 0.17, alpha },
      up + size[2] / 2 + 0.035,
    );
  } else {
    marks.add(
      placed.at,
      0.13,
      color,
      { pattern, faces: true, thick: 0.2, alpha },
      form === "segment" ? 0.1 : 0,
    );
  }
}
