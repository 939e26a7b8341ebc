/** The toggle that colours the floor by the things that cannot be told apart from there, and its legend. */

import type { Controls } from "./controls";
import { el, icon, key, mark, show, write } from "./dom";
import { separabilityText, type Separability } from "./geometry/separability";
import { standingOf } from "./site/site";

/** A map with many things takes the server some seconds, more on a small machine, ms. */
const PATIENCE_MS = 60_000;
export const SEPARABILITY_KEY = "T";

export class SeparabilityToggle {
  readonly button = el(
    "button",
    { type: "button", "aria-keyshortcuts": SEPARABILITY_KEY, onclick: () => this.toggle() },
    icon("floor"),
    el("span", { text: "Told apart" }),
    key(SEPARABILITY_KEY),
  );
  readonly legend: HTMLElement;
  /** What the floor shows, or null. */
  shown: Separability | null = null;
  private isOn = false;
  /** Map for which it was asked. */
  private asked = -1;
  private readonly stands = el("p", { role: "status" });
  private readonly under = el("p", { "aria-hidden": "true" });
  private mouse: readonly [number, number] | null = null;

  /** @param changed called when `shown` has changed. */
  constructor(
    private readonly controls: Controls,
    private readonly changed: () => void,
  ) {
    this.button.title = "Colour the floor by the things that cannot be told apart by pointing from there";
    this.legend = el(
      "div",
      { className: "apart", role: "group", "aria-label": "What is told apart from where" },
      el("strong", { text: "Told apart by pointing from there" }),
      el("div", { className: "ramp" }),
      el("div", { className: "ticks" }, ...["all", "half", "none"].map((text) => el("span", { text }))),
      this.stands,
      this.under,
    );
  }

  get isOffered(): boolean {
    const { map, hello } = this.controls.site;
    return (
      (map?.things.some((thing) => !thing.is_tracked) ?? false) &&
      (hello?.deeds.includes("told_apart") ?? false)
    );
  }

  toggle(): void {
    this.isOn = !this.isOn && this.isOffered;
    this.asked = -1;
    this.put(null);
    this.controls.changed();
  }

  /** The mouse is over that place of the floor, {W}, or elsewhere. */
  over(place: readonly [number, number] | null): void {
    this.mouse = place;
    const text = place && this.shown ? separabilityText(this.shown, ...place) : "";
    write(this.under, text ? `Under the mouse: ${text}` : "");
  }

  update(): void {
    const { controls } = this;
    const { site } = controls;
    if (!this.isOffered && this.isOn) this.toggle();
    show(this.button, this.isOffered);
    mark(this.button, "aria-pressed", String(this.isOn));
    show(this.legend, this.isOn);
    if (this.isOn && this.asked !== site.mapVersion) void this.ask(site.mapVersion);
    const { person } = controls;
    const stands = person && standingOf(person);
    const { shown } = this;
    const text = stands && shown ? separabilityText(shown, stands.position_m[0], stands.position_m[1]) : "";
    write(
      this.stands,
      this.isOn && !shown ? "Computing …" : text && `Where ${controls.user} stands: ${text}`,
    );
    this.over(this.mouse);
  }

  private async ask(version: number): Promise<void> {
    this.asked = version;
    const reply = await this.controls.ask({ deed: "told_apart" }, PATIENCE_MS);
    if (!this.isOn || this.asked !== version) return;
    if (reply) this.put(reply as unknown as Separability);
    else this.toggle();
    this.controls.changed();
  }

  private put(shown: Separability | null): void {
    this.shown = shown;
    this.changed();
  }
}
