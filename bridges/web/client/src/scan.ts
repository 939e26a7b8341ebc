/** The page that maps the room by a camera. */

import "./scan.css";
import { el } from "./dom";
import { sentence } from "./format";
import type { Quaternion } from "./phone/orientation";
import { sense, type Sensing } from "./phone/sensing";
import { Wake } from "./phone/wake";
import { chime } from "./sound";
import type { ScanState } from "./wire";
import { Camera, NoCamera } from "./scan/camera";
import { Capturer, Unread } from "./scan/capture";
import { wordOf, type Colour } from "./scan/code";
import { gravity } from "./scan/gravity";
import { drawPlan } from "./scan/plan";
import { SimulatedCamera } from "./scan/simulated";
import { Things } from "./scan/things";
import { ask, light, lights, Refused, simulatedRoom } from "./scan/site";

const POLL_MS = 400;
const USUAL_LEDS_PER_M = 60;
/** Step that is shown between views, so that the person sees what the camera has to see, and how often it is renewed, ms. */
const AIM = { step: 1, brightness: 0.35, period: 3000 };

/** Time that lamps on a bridge take to change, beyond the answer of the site, ms. */
const LAMPS_MS = 800;

/** To 0.01 image pixels, so that a view of all lights fits a body. */
const rounded = (value: number) => Math.round(100 * value) / 100;

const part = <T extends Element = HTMLElement>(id: string) => document.getElementById(id) as unknown as T;
const button = (id: string) => part<HTMLButtonElement>(id);

class Page {
  private readonly wake = new Wake();
  private state: ScanState | null = null;
  private camera: Camera | null = null;
  private capturer: Capturer | null = null;
  private simulated: SimulatedCamera | null = null;
  private sensing: Sensing | null = null;
  private held: Quaternion | null = null;
  private readonly things = new Things(
    (thing) => void this.attempt(async () => this.show(await ask({ kind: "thing", ...thing }))),
  );
  private isTaking = false;
  private aimed: Promise<void> = Promise.resolve();
  private aiming: ReturnType<typeof setInterval> | undefined;

  constructor() {
    const taps: Record<string, () => Promise<void>> = {
      start: () => this.start(),
      take: () => this.take(),
      undo: () => this.undo(),
      again: () => this.begin(),
    };
    for (const [id, deed] of Object.entries(taps))
      button(id).addEventListener("click", () => void this.attempt(deed));
    part<HTMLFormElement>("finish").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.attempt(() => this.save());
    });
    part("origin").addEventListener("change", () => this.link());
    addEventListener("pagehide", () => {
      clearInterval(this.aiming);
      void light(null).catch(() => undefined);
    });
    void this.attempt(async () => this.offer(await ask({ kind: "look" })));
  }

  /** Do it, and say what hinders. */
  private async attempt(deed: () => Promise<void>): Promise<void> {
    this.trouble("");
    try {
      await deed();
    } catch (error) {
      const isKnown = error instanceof Refused || error instanceof NoCamera || error instanceof Unread;
      this.trouble(isKnown ? error.message : `This did not work: ${String(error)}.`);
    }
  }

  /** Ask for the LEDs per metre of each strip. */
  private offer(state: ScanState): void {
    const strips = state.strips.filter(({ pixels }) => pixels > 1);
    const lamps = state.strips.filter(({ pixels }) => pixels === 1);
    const names = strips.map(({ name }) => name);
    part("with-lamps").hidden = !lamps.length;
    part("lamps").textContent = lamps.map(({ name }) => name).join(", ");
    part("pitches").className = "fields";
    part("pitches").replaceChildren(
      ...strips.map(({ name, pixels, leds_per_m }) =>
        el(
          "label",
          {},
          `${name}: ${pixels} LEDs, per metre `,
          el("input", {
            type: "number",
            min: 5,
            max: 500,
            step: "any",
            inputmode: "decimal",
            value: leds_per_m ?? USUAL_LEDS_PER_M,
            "data-strip": name,
          }),
        ),
      ),
    );
    part("known-strip").replaceChildren(
      el("option", { value: "", text: "none" }),
      ...names.map((name) => el("option", { value: name, text: name })),
    );
    part("origin").replaceChildren(...names.map((name) => el("option", { value: name, text: name })));
    part<HTMLInputElement>("name").value = state.file || "room.yaml";
    button("start").textContent = state.is_simulated ? "Start the simulated camera" : "Start the camera";
    if (!names.length)
      this.trouble(
        "The site's map has no strips yet: add them with their numbers of LEDs, and load this page again.",
      );
    button("start").disabled = !names.length;
    this.state = state;
    this.link();
  }

  /** Within a tap: the camera and the sensors ask for permission. */
  private async start(): Promise<void> {
    if (this.camera) return;
    const sensing = sense({ turned: (q) => (this.held = q), ended: () => (this.held = null) }).catch(
      () => null,
    );
    chime("tick");
    button("start").disabled = true;
    try {
      if (this.state?.is_simulated)
        this.simulated = new SimulatedCamera(await simulatedRoom(), lights, this.state.views);
      this.camera = await Camera.open(part<HTMLVideoElement>("video"), this.simulated?.stream ?? null);
    } finally {
      button("start").disabled = false;
    }
    this.sensing = await sensing;
    this.wake.want(true);
    part("before").hidden = true;
    part("running").hidden = false;
    const before = await ask({ kind: "look" });
    if (before.views)
      this.show(before); // the page was loaded again
    else await this.begin();
    void this.attempt(() => this.follow());
    this.aim();
    this.aiming = setInterval(() => this.aim(), AIM.period);
    button("take").focus({ preventScroll: true });
  }

  private async begin(): Promise<void> {
    const per = [...document.querySelectorAll<HTMLInputElement>("[data-strip]")].filter(
      ({ valueAsNumber }) => valueAsNumber > 1,
    );
    const known = part<HTMLSelectElement>("known-strip").value;
    const metres = part<HTMLInputElement>("known-m").valueAsNumber;
    this.things.forget(0);
    this.show(
      await ask({
        kind: "begin",
        leds_per_m: Object.fromEntries(per.map((input) => [input.dataset.strip!, input.valueAsNumber])),
        known_strip: metres > 0 ? known : "",
        known_m: known && metres > 0 ? metres : null,
        has_lamps: part<HTMLInputElement>("has-lamps").checked,
      }),
    );
  }

  private async undo(): Promise<void> {
    this.show(await ask({ kind: "undo" }));
    this.things.forget(this.state!.views);
    void this.attempt(() => this.follow());
  }

  private async take(): Promise<void> {
    if (this.isTaking || !this.camera || !this.state) return;
    this.capturer ??= new Capturer(
      this.camera,
      { show: (step, brightness) => light(this.colours(step), brightness) },
      this.state.strips.some(({ pixels }) => pixels === 1) ? LAMPS_MS : 0,
    );
    this.isTaking = true;
    button("take").disabled = true;
    this.say("Hold still …");
    try {
      await this.aimed;
      const down = this.gravity();
      const { seen, still, width, height } = await this.capturer.take(this.state.lights.length, (share) =>
        this.count(share),
      );
      chime("tick");
      navigator.vibrate?.(40);
      this.show(
        await ask({
          kind: "view",
          width,
          height,
          gravity: down,
          seen: seen.map(({ index, u, v }) => [index, rounded(u), rounded(v)]),
        }),
      );
      this.things.keep(this.state.views - 1, still, width);
      this.simulated?.walk();
      void this.attempt(() => this.follow());
    } catch (error) {
      chime("buzz");
      this.show(this.state);
      throw error;
    } finally {
      this.isTaking = false;
      button("take").disabled = false;
      part("count").textContent = "";
      this.aim();
    }
  }

  /** Colours of all lights at a step, none before the first. */
  private colours(step: number): Colour[] {
    const count = this.state?.lights.length ?? 0;
    return step < 0 ? [] : Array.from({ length: count }, (_, index) => wordOf(index, count)[step]!);
  }

  /** Show the lights between views. */
  private aim(): void {
    if (!this.isTaking && document.visibilityState === "visible")
      this.aimed = light(this.colours(AIM.step), AIM.brightness).catch(() => undefined);
  }

  private gravity(): [number, number, number] | null {
    if (this.simulated) return this.simulated.gravity;
    if (!this.held || !this.sensing || !this.camera?.looksAhead) return null;
    return gravity(this.held, screen.orientation.angle);
  }

  private async follow(): Promise<void> {
    while (this.state?.is_solving) {
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      this.show(await ask({ kind: "look" }));
    }
  }

  private async save(): Promise<void> {
    const name = part<HTMLInputElement>("name").value.trim();
    const state = await ask({ kind: "save", name, origin: part<HTMLSelectElement>("origin").value });
    this.show(state);
    part("saved").textContent =
      `The map is saved as ${state.saved}. Check it in its folder: pointit map check ${state.saved.replace(/^.*[\\/]/, "")}`;
    chime("up");
  }

  private show(state: ScanState): void {
    this.state = state;
    drawPlan(part<SVGSVGElement>("plan"), state);
    part("strips").replaceChildren(
      ...state.strips.map(({ name, pixels, seen, line_m, sigma_m, reason }) =>
        el(
          "tr",
          {},
          el(
            "th",
            { scope: "row" },
            name,
            pixels
              ? null
              : el("button", {
                  type: "button",
                  className: "forget",
                  text: "Forget",
                  "aria-label": `Forget ${name}`,
                  onclick: () =>
                    void this.attempt(async () =>
                      this.show(await ask({ kind: "thing", name, shape: "box", corners: [] })),
                    ),
                }),
          ),
          el("td", { text: `${seen} ${seen === 1 ? "view" : "views"}` }),
          el("td", {
            text: line_m.length
              ? `${sigma_m === null ? "?" : `± ${(100 * sigma_m).toFixed(1)} cm`}${reason ? `: ${reason}` : ""}`
              : reason || "not yet",
          }),
        ),
      ),
    );
    const isReady = state.is_complete && !state.saved;
    const done = isReady ? "All lights are known to 1 cm. Save the map, or take more views. " : "";
    this.say(
      state.is_solving ? "Calculating …" : `${done}${state.problem ? sentence(state.problem) : state.advice}`,
    );
    button("undo").disabled = !state.views;
    const hasMap = state.strips.some(({ line_m }) => line_m.length > 1);
    part("finish").hidden = button("save").hidden = !hasMap;
    button("save").classList.toggle("primary", isReady);
    button("take").classList.toggle("primary", !state.is_complete);
    if (!state.saved) part("saved").textContent = "";
  }

  private link(): void {
    part<HTMLAnchorElement>("download").href =
      `/scan/map.yaml?origin=${encodeURIComponent(part<HTMLSelectElement>("origin").value)}`;
  }

  private count(share: number): void {
    part("count").textContent = `Hold still: ${Math.round(100 * share)} %`;
  }

  private say(text: string): void {
    if (part("advice").textContent !== text) part("advice").textContent = text;
  }

  private trouble(text: string): void {
    part("trouble").textContent = text;
    part("trouble").hidden = !text;
  }
}

new Page();
