/** How staying selects, how far a ray may pass, how bright the light is; as the services answer. */

import { choice, type Option } from "../choice";
import type { Controls } from "../controls";
import { folded, show } from "../dom";
import { slider } from "../slider";
import type { RequestKey } from "../topics";
import type { Part } from "./part";

const DEG = Math.PI / 180;
const METHODS = ["gauge", "hold", "fraction"];

/** Options of the installed methods, ours first. */
function methodOptions(installed: readonly string[]): Option[] {
  const others = installed.filter((name) => !METHODS.includes(name));
  return [...METHODS, ...others].map((value) => ({ value, label: value[0]!.toUpperCase() + value.slice(1) }));
}

export interface Tuning extends Part {
  /** Query the values in use again: a service was started. */
  forget(): void;
}

export function tuningPart(controls: Controls): Tuning {
  const asked = new Set<string>();
  let tolerance: number | null = null;
  let dwell: number | null = null;

  async function askMethod(query: Record<string, unknown>): Promise<number | null> {
    const reply = await controls.ask({ key: "selector/method", query }, { isQuiet: true });
    if (!reply) return null;
    const installed = reply["installed"];
    method.offer(methodOptions(Array.isArray(installed) ? installed.map(String) : []));
    method.set(String(reply["name"] || reply["method"]));
    dwell = Number(reply["dwell_s"]);
    return dwell;
  }

  async function askTolerance(query: Record<string, unknown>): Promise<number | null> {
    const reply = await controls.ask({ key: "pui/tolerance", query }, { isQuiet: true });
    if (!reply) return null;
    const answered = reply["tolerance_rad"];
    tolerance = typeof answered === "number" ? answered / DEG : null;
    return tolerance;
  }

  async function dim(value: number): Promise<number | null> {
    const reply = await controls.ask({ key: "leds/brightness", query: { brightness: value } }, { isQuiet: true });
    return reply ? value : null;
  }

  const method = choice("Method", (value) => void askMethod(METHODS.includes(value) ? { method: value } : { name: value }).then(controls.changed), methodOptions([]));
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

  /** Query the values in use once, as soon as the server is present. */
  function once(key: RequestKey, ask: () => Promise<unknown>): boolean {
    const may = controls.may(key);
    if (!may) asked.delete(key);
    else if (!asked.has(key)) {
      asked.add(key);
      void ask().then(controls.changed);
    }
    return may;
  }

  return {
    element,
    forget: () => asked.clear(),
    update() {
      const isSelecting = once("selector/method", () => askMethod({}));
      const isCasting = once("pui/tolerance", () => askTolerance({}));
      const isLit = controls.may("leds/brightness") && (controls.site.map?.strips.length ?? 0) > 0;
      show(method.element, isSelecting);
      show(time.element, isSelecting);
      show(near.element, isCasting && tolerance !== null);
      show(light.element, isLit);
      time.set(dwell);
      near.set(tolerance);
      light.set(controls.site.health.get("led-driver")?.figures.find((each) => each.name === "brightness")?.value ?? null);
      show(element, isSelecting || isCasting || isLit);
    },
  };
}
