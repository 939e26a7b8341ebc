/** Tracked objects in the plan: their kind by colour and letter, their owners by pattern and name. */

import { mark, write } from "../dom";
import type { TrackedObject } from "../messages";
import { holdersOf, ownersOf, siteNow, thingsOf, type Site } from "../site/site";
import { currentBoxColor } from "../site/box_color";
import { cssColor, inkOn, isBox, kindColor, kindLetter, sizeOf } from "../geometry/appearance";
import type { Lanes } from "./lanes";
import { styleOf } from "./person_style";
import { cm, draw, show, turned, xy } from "./svg";
import type { Thing } from "./pointed_position";

/** An object as it is drawn now. */
export interface Drawn extends Thing {
  readonly object: TrackedObject;
}

interface Figure {
  turning: SVGGElement;
  box: SVGElement;
  edge: SVGElement;
  ring: SVGElement;
  hold: SVGElement;
  place: SVGGElement;
  below: SVGGElement;
  letter: SVGTextElement;
  owner: SVGTSpanElement;
}

/** How far beyond its outline an object's ring is drawn, m. */
const RING_M = 0.035;
/** Segments are drawn wider than they are, m: their strip's pixels are to be seen between their edges. */
const SEGMENT_M = 0.16;

function isSegment(object: TrackedObject): boolean {
  return object.surface === "strip" && !isBox(object);
}

export class Packages {
  /** By id: where objects are drawn; of this frame. */
  readonly drawn = new Map<string, Drawn>();
  private readonly figures = new Map<string, Figure>();

  /** `boxes` lie below strips and people, `letters` above them. */
  constructor(
    private readonly boxes: Element,
    private readonly letters: Element,
  ) {}

  update(site: Site, lanes: Lanes): void {
    const now = siteNow(site);
    const owners = ownersOf(site);
    const holders = holdersOf(site);
    this.drawn.clear();
    for (const { object, stamp_ns } of thingsOf(site)) {
      const { at, heading } = lanes.placed(object, stamp_ns, now);
      const [long, wide] = sizeOf(object);
      const drawn: Drawn = {
        object,
        at,
        heading,
        halfLength: long / 2,
        halfBreadth: (isSegment(object) ? SEGMENT_M : wide) / 2,
      };
      this.drawn.set(object.id, drawn);
      const figure = this.figures.get(object.id) ?? this.make(object);
      this.place(figure, drawn);
      this.mark(figure, site, object, owners.get(object.id) ?? "", holders.get(object.id) ?? "");
    }
    for (const [id, figure] of this.figures) {
      if (this.drawn.has(id)) continue;
      figure.turning.remove();
      figure.place.remove();
      this.figures.delete(id);
    }
  }

  /** Remove all; the next update redraws. */
  clear(): void {
    for (const { turning, place } of this.figures.values())
      for (const element of [turning, place]) element.remove();
    this.figures.clear();
    this.drawn.clear();
  }

  private make(object: TrackedObject): Figure {
    const turning = draw(this.boxes, "g");
    const isRound = !isBox(object) && (object.surface === "none" || object.surface === "points");
    const shape = (name: string) => draw(turning, isRound ? "circle" : "rect", { class: name });
    const [hold, edge, ring, box] = [
      shape("plan-held"),
      shape("plan-owned-edge"),
      shape("plan-owned"),
      shape("plan-box"),
    ];
    const color = kindColor(object.kind);
    mark(box, "fill", cssColor(color));
    if (isSegment(object)) mark(box, "fill-opacity", 0.4);
    const place = draw(this.letters, "g");
    const upright = draw(place, "g", { class: "plan-upright" });
    const below = draw(place, "g");
    const isThin = isSegment(object);
    const letter = draw(
      upright,
      "text",
      { class: isThin ? "plan-letter plan-beside" : "plan-letter", "text-anchor": "middle", y: 5 },
      kindLetter(object.kind),
    );
    if (!isThin) letter.style.fill = inkOn(color); // an attribute counts less than the style sheet
    const text = draw(draw(below, "g", { class: "plan-upright" }), "text", {
      class: "plan-owner",
      "text-anchor": "middle",
      y: 15,
    });
    if (isBox(object)) draw(text, "tspan", { class: "plan-thing" }, `${object.kind || object.id} `);
    const owner = draw(text, "tspan");
    const figure = { turning, box, edge, ring, hold, place, below, letter, owner };
    this.figures.set(object.id, figure);
    return figure;
  }

  private place(figure: Figure, { object, at, heading, halfLength, halfBreadth }: Drawn): void {
    mark(figure.turning, "transform", `translate(${xy(at)}) rotate(${turned(heading)})`);
    const isThin = isSegment(object);
    const aside = isThin ? halfBreadth + 0.1 : 0;
    mark(
      figure.place,
      "transform",
      `translate(${xy([at[0] - aside * Math.sin(heading), at[1] + aside * Math.cos(heading)])})`,
    );
    const tall = isThin
      ? 0.05
      : Math.abs(Math.sin(heading)) * halfLength + Math.abs(Math.cos(heading)) * halfBreadth + RING_M;
    const isBeside = isThin && Math.abs(Math.sin(heading)) > 0.5;
    mark(figure.owner.parentElement!, "text-anchor", isBeside ? "end" : "middle");
    mark(figure.owner.parentElement!, "x", isBeside ? 8 : 0);
    mark(figure.below, "transform", `translate(0 ${cm(tall)})`);
    for (const [shape, by] of [
      [figure.box, 0],
      [figure.edge, RING_M],
      [figure.ring, RING_M],
      [figure.hold, 2 * RING_M],
    ] as const) {
      if (shape.tagName === "circle") {
        mark(shape, "r", cm(halfLength + by));
        continue;
      }
      const [long, broad] = [halfLength + by, halfBreadth + by];
      mark(shape, "x", cm(-long));
      mark(shape, "y", cm(-broad));
      mark(shape, "width", cm(2 * long));
      mark(shape, "height", cm(2 * broad));
      mark(shape, "rx", cm(0.03 + by));
    }
  }

  private mark(figure: Figure, site: Site, object: TrackedObject, owner: string, holder: string): void {
    for (const element of [figure.edge, figure.ring]) show(element, owner !== "");
    show(figure.hold, holder !== "" && holder !== owner);
    for (const [element, user] of [
      [figure.ring, owner],
      [figure.hold, holder],
    ] as const) {
      if (!user) continue;
      const style = styleOf(site.people.get(user)?.profile);
      mark(element, "stroke", style.color);
      mark(element, "stroke-dasharray", style.dashes);
    }
    if (isBox(object)) {
      const look = currentBoxColor(site, object);
      mark(figure.box, "fill", cssColor(look));
      figure.letter.style.fill = inkOn(look);
    }
    write(figure.owner, owner ? owner : holder ? `${holder} …` : "");
  }
}
