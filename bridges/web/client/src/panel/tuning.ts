/** How staying selects, how far a ray may pass, how bright the light is; as the services answer. */

import { choice, type Option } from "../choice";
import type { Controls } from "../controls";
import { section, show } from "../dom";
import { figureOf, initialOf } from "../site/figures";
import { slider } from "../slider";
import type { RequestKey } from "../topics";
import type { PanelPart } from "./panel_part";

const DEG = Math.PI / 180;
const METHODS = ["gauge", "hold", "fraction"];

/** Options of the installed methods, ours first. */
function methodOptions(installed: readonly string[]): Option[] {
  const others = installed.filter((name) => !METHODS.includes(name));
  return [...METHODS, ...others].map((value) => ({ value, label: value[0]!.toUpperCase() + value.slice(1) }));
}

export interface Tuning extends PanelPart {
  /** Query the values in use again: a service was started. */
  forget(): void;
}

const percent = (share: number | null): number | null => share && Math.round(share * 100);

export function tuningPart(controls: Controls): Tuning {
  const { site } = controls;
  const asked = new Set<string>();
  let tolerance: number | null = null;
  let dwell: number | null = null;
  /** Time of the method that this page has chosen, as configured. */
  let ownDwell: number | null = null;

  async function askMethod(query: Record<string, unknown>): Promise<number | null> {
    const reply = await controls.ask({ key: "selector/method", query });
    if (!reply) return null;
    const installed = reply["installed"];
    method.offer(methodOptions(Array.isArray(installed) ? installed.map(String) : []));
    method.set(String(reply["name"] || reply["method"]));
    dwell = Number(reply["dwell_s"]);
    if (query["method"] || query["name"]) ownDwell = dwell;
    return dwell;
  }

  async function askTolerance(query: Record<string, unknown>): Promise<number | null> {
    const reply = await controls.ask({ key: "pui/tolerance", query });
    if (!reply) return null;
    const answered = reply["tolerance_rad"];
    tolerance = typeof answered === "number" ? Math.round((answered / DEG) * 100) / 100 : null;
    return tolerance;
  }

  async function dim(percent: number): Promise<number | null> {
    return (await controls.ask({ key: "leds/brightness", query: { brightness: percent / 100 } })) && percent;
  }

  const onInvalid = (problem: string): void => controls.toasts.show("error", problem);
  const method = choice(
    "Method",
    (value) =>
      void askMethod(METHODS.includes(value) ? { method: value } : { name: value }).then(controls.changed),
    methodOptions([]),
  );
  const time = slider({
    label: "Time on an object",
    min: 0.2,
    max: 3,
    step: 0.05,
    unit: "s",
    initial: () => ownDwell ?? initialOf(site, "selector", "dwell"),
    send: (value) => askMethod({ dwell_s: value }),
    onInvalid,
  });
  const near = slider({
    label: "Tolerance",
    min: 0.5,
    max: 15,
    step: 0.5,
    unit: "°",
    initial: () => initialOf(site, "pui", "tolerance"),
    send: (value) => askTolerance({ tolerance_rad: value * DEG }),
    onInvalid,
  });
  const light = slider({
    label: "Brightness of the strips",
    min: 0,
    max: 100,
    step: 5,
    unit: "%",
    initial: () => percent(initialOf(site, "led-driver", "brightness")),
    send: dim,
    onInvalid,
  });
  const element = section("Selecting and light", method.element, time.element, near.element, light.element);

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
      if (!isSelecting) ownDwell = null;
      const isCasting = once("pui/tolerance", () => askTolerance({}));
      const isLit = controls.may("leds/brightness") && (site.map?.strips.length ?? 0) > 0;
      show(method.element, isSelecting);
      show(time.element, isSelecting);
      show(near.element, isCasting && tolerance !== null);
      show(light.element, isLit);
      time.set(isSelecting ? dwell : null);
      near.set(isCasting ? tolerance : null);
      light.set(percent(figureOf(site.health.get("led-driver"), "brightness")));
      show(element, isSelecting || isCasting || isLit);
    },
  };
}
