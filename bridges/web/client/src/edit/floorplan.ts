/** The controls of a floor plan under the map: choose a picture, scale it by two clicks and a length, move it. */

import { el, folded, show, write } from "../dom";
import type { Frame } from "../plan/frame";
import { numberIn } from "./model";
import { keepPicture, keptPicture, pictureOf, scaled, widened, type Picture, type Place } from "./picture";
import { mm } from "./shape";

type Side = "width" | "left" | "top";
const SIDES: Record<Side, string> = {
  width: "Wide, m",
  left: "Left edge, x in m",
  top: "Upper edge, y in m",
};

export class FloorPlan {
  readonly element: HTMLElement;
  private picture: Picture | null = null;
  private path = "";
  /** Places that were clicked for the scale, or null if clicks are for the map. */
  private clicks: Place[] | null = null;
  private readonly said = el("p", { className: "edit-status", role: "status" });
  private readonly file = el("input", {
    type: "file",
    accept: "image/png,image/jpeg",
    onchange: () => void this.load(),
  });
  private readonly inputs = Object.fromEntries(
    Object.entries(SIDES).map(([side]) => [
      side,
      el("input", { type: "text", inputmode: "decimal", onchange: () => this.type(side as Side) }),
    ]),
  ) as Record<Side, HTMLInputElement>;
  private readonly metres = el("input", { type: "text", inputmode: "decimal", onchange: () => this.scale() });
  private readonly apart = el(
    "label",
    { className: "edit-field" },
    el("span", { text: "They are apart, m" }),
    this.metres,
  );
  private readonly more = el(
    "div",
    { className: "edit-fields" },
    el("button", { type: "button", onclick: () => this.begin(), text: "Scale by two clicks" }),
    this.apart,
    el(
      "div",
      { className: "edit-row" },
      ...Object.entries(SIDES).map(([side, label]) =>
        el("label", { className: "edit-field" }, el("span", { text: label }), this.inputs[side as Side]),
      ),
    ),
    el("button", { type: "button", onclick: () => this.put(null), text: "Remove the picture" }),
  );

  constructor(
    private readonly shown: (picture: Picture | null) => void,
    private readonly frame: () => Frame,
  ) {
    this.element = folded(
      "Floor plan",
      false,
      el("p", {
        className: "muted",
        text: "A picture under the map, PNG or JPEG. It stays in this browser.",
      }),
      el("label", { className: "edit-field" }, el("span", { text: "Picture" }), this.file),
      this.said,
      this.more,
    );
  }

  /** Show the picture that is kept for the map at `path`. */
  open(path: string): void {
    this.path = path;
    this.picture = keptPicture(path);
    this.refresh();
  }

  /** Keep the picture for the map at `path`, which is a copy. */
  keepFor(path: string): void {
    if (path !== this.path && this.picture) keepPicture(path, this.picture);
    this.path = path;
  }

  /** A click at that place, {W}; true if it was for the scale. */
  click(at: Place): boolean {
    if (!this.clicks || this.clicks.length === 2) return false;
    this.clicks.push(at);
    write(this.said, this.clicks.length === 1 ? "Now the other end." : "How far apart are they? Type it.");
    show(this.apart, this.clicks.length === 2);
    if (this.clicks.length === 2) this.metres.focus();
    return true;
  }

  private begin(): void {
    this.clicks = [];
    write(this.said, "Click one end of something whose length you know, in the plan.");
  }

  private scale(): void {
    const [a, b] = this.clicks ?? [];
    const metres = numberIn(this.metres.value, { least: 0.01, most: 1000 });
    if (typeof metres === "string") return write(this.said, metres);
    if (!this.picture || !a || !b || Math.hypot(b[0] - a[0], b[1] - a[1]) < 1e-6)
      return write(this.said, "Click two places that are apart.");
    this.clicks = null;
    this.metres.value = "";
    this.put(scaled(this.picture, a, b, metres));
  }

  private type(side: Side): void {
    const found = numberIn(this.inputs[side].value, { least: side === "width" ? 0.01 : -1000, most: 1000 });
    if (typeof found === "string") return write(this.said, found);
    if (this.picture)
      this.put(side === "width" ? widened(this.picture, found) : { ...this.picture, [side]: found });
  }

  private async load(): Promise<void> {
    const file = this.file.files?.[0];
    const { x, y, width, height, scale } = this.frame();
    if (!file) return;
    try {
      this.put(
        await pictureOf(file, mm(x - width / scale / 2), mm(y + height / scale / 2), mm(width / scale)),
      );
    } catch {
      write(this.said, `${file.name} is no picture that this browser can show.`);
    }
  }

  private put(picture: Picture | null): void {
    this.picture = picture;
    write(
      this.said,
      keepPicture(this.path, picture)
        ? ""
        : "This browser has no room to keep the picture: it is gone when the page is closed.",
    );
    this.refresh();
  }

  private refresh(): void {
    show(this.more, this.picture !== null);
    show(this.apart, this.clicks?.length === 2);
    if (!this.picture) this.file.value = "";
    else
      for (const side of Object.keys(SIDES) as Side[])
        this.inputs[side].value = String(mm(this.picture[side]));
    this.shown(this.picture);
  }
}
