/** How staying selects, how far a ray may pass, how bright the light is; as the services answer. */

import { choice } from "../choice";
import type { Desk } from "../desk";
import { folded, show } from "../dom";
import { slider } from "../slider";
import type { RequestKey } from "../topics";
import type { Part } from "./part";

const DEG = Math.PI / 180;
const METHODS = [
  { value: "gauge", label: "Gauge" }, { value: "hold", label: "Hold" }, { value: "fraction", label: "Fraction" },
];

export interface Tuning extends Part {
  /** Ask anew what is in use: something was started. */
  forget(): void;
}

export function tuningPart(desk: Desk): Tuning {
  const asked = new Set<string>();
  let tolerance: number | null = null;
  let dwell: number | null = null;

  async function askMethod(query: Record<string, unknown>): Promise<number | null> {
    const reply = await desk.ask({ key: "selector/method", query }, { isQuiet: true });
    if (!reply) return null;
    method.set(String(reply["method"]));
    dwell = Number(reply["dwell_s"]);
    return dwell;
  }

  async function askTolerance(query: Record<string, unknown>): Promise<number | null> {
    const reply = await desk.ask({ key: "pui/tolerance", query }, { isQuiet: true });
    if (!reply) return null;
    const answered = reply["tolerance_rad"];
    tolerance = typeof answered === "number" ? answered / DEG : null;
    return tolerance;
  }

  async function dim(value: number): Promise<number | null> {
    const reply = await desk.ask({ key: "leds/brightness", query: { brightness: value } }, { isQuiet: true });
    return reply ? value : null;
  }

  const method = choice("Method", (value) => void askMethod({ method: value }).then(desk.changed), METHODS);
  const time = slider({
    label: "Time on an object", min: 0.2, max: 3, step: 0.05, text: (value) => `${value.toFixed(2)} s`,
    send: (value) => askMethod({ dwell_s: value }),
  });
  const near = slider({
    label: "Tolerance", min: 0.5, max: 15, step: 0.5, text: (value) => `${value.toFixed(1)}°`,
    send: (value) => askTolerance({ tolerance_rad: value * DEG }),
  });
  const light = slider({
    label: "Brightness of the strips", min: 0, max: 1, step: 0.05, text: (value) => `${Math.round(value * 100)} %`, send: dim,
  });
  const element = folded("Selecting and light", false, method.element, time.element, near.element, light.element);

  /** Ask once for what is in use, as soon as there is somebody to ask. */
  function once(key: RequestKey, ask: () => Promise<unknown>): boolean {
    const may = desk.may(key);
    if (!may) asked.delete(key);
    else if (!asked.has(key)) {
      asked.add(key);
      void ask().then(desk.changed);
    }
    return may;
  }

  return {
    element,
    forget: () => asked.clear(),
    update() {
      const isSelecting = once("selector/method", () => askMethod({}));
      const isCasting = once("pui/tolerance", () => askTolerance({}));
      const isLit = desk.may("leds/brightness") && (desk.site.map?.strips.length ?? 0) > 0;
      show(method.element, isSelecting);
      show(time.element, isSelecting);
      show(near.element, isCasting && tolerance !== null);
      show(light.element, isLit);
      time.set(dwell);
      near.set(tolerance);
      light.set(desk.site.health.get("led-driver")?.figures.find((each) => each.name === "brightness")?.value ?? null);
      show(element, isSelecting || isCasting || isLit);
    },
  };
}
