/** How staying selects, how far a ray may pass, how bright the light is; as the services answer. */

import type { Controls } from "../controls";
import { capital } from "../format";
import { figureOf, initialOf } from "../site/figures";
import type { RequestKey } from "../topics";
import { Choice } from "../ui/choice";
import type { Option } from "../ui/columns";
import { titledPart, type PanelPart } from "../ui/part";
import { Slider } from "../ui/slider";

const DEGREE = Math.PI / 180;
/** Answered tolerances are shown in hundredths of a degree. */
const STEPS_PER_DEGREE = 100;
const PERCENT = 100;
const METHODS = ["gauge", "hold", "fraction"];

/** Values in use, as the services have answered; each is asked for once its server is present. */
export class Tuning {
  method = "";
  methods: readonly Option[] = methodOptions([]);
  dwellS: number | null = null;
  /** Time of the method that this page has chosen, as configured, s. */
  ownDwellS: number | null = null;
  toleranceDeg: number | null = null;
  private readonly asked = new Set<RequestKey>();

  constructor(private readonly controls: Controls) {}

  /** Query the values in use again: a service was started. */
  forget(): void {
    this.asked.clear();
  }

  follow(): void {
    this.askOnce("selector/method", () => this.askMethod({}));
    this.askOnce("pui/tolerance", () => this.askTolerance({}));
    if (!this.controls.may("selector/method")) this.ownDwellS = null;
  }

  choose(method: string): void {
    const query = METHODS.includes(method) ? { method } : { name: method };
    void this.askMethod(query).then(this.controls.changed);
  }

  async askMethod(query: Record<string, unknown>): Promise<number | null> {
    const reply = await this.controls.ask({ key: "selector/method", query });
    if (!reply) return null;
    const installed = reply["installed"];
    this.methods = methodOptions(Array.isArray(installed) ? installed.map(String) : []);
    this.method = String(reply["name"] || reply["method"]);
    this.dwellS = Number(reply["dwell_s"]);
    if (query["method"] || query["name"]) this.ownDwellS = this.dwellS;
    return this.dwellS;
  }

  async askTolerance(query: Record<string, unknown>): Promise<number | null> {
    const reply = await this.controls.ask({ key: "pui/tolerance", query });
    if (!reply) return null;
    const answered = reply["tolerance_rad"];
    this.toleranceDeg = typeof answered === "number" ? roundedDegrees(answered) : null;
    return this.toleranceDeg;
  }

  async dim(percent: number): Promise<number | null> {
    const query = { brightness: percent / PERCENT };
    return (await this.controls.ask({ key: "leds/brightness", query })) && percent;
  }

  /** Query the values in use once, as soon as the server is present. */
  private askOnce(key: RequestKey, ask: () => Promise<unknown>): void {
    if (!this.controls.may(key)) {
      this.asked.delete(key);
      return;
    }
    if (this.asked.has(key)) return;
    this.asked.add(key);
    void ask().then(this.controls.changed);
  }
}

export function tuningPart(controls: Controls, tuning: Tuning): PanelPart {
  const isLit = (): boolean => controls.may("leds/brightness") && (controls.site.map?.strips.length ?? 0) > 0;
  return {
    ...titledPart(
      "Selecting and light",
      () => controls.may("selector/method") || controls.may("pui/tolerance") || isLit(),
      () => <TuningView controls={controls} tuning={tuning} isLit={isLit()} />,
    ),
    follow: () => tuning.follow(),
  };
}

interface TuningProps {
  controls: Controls;
  tuning: Tuning;
  /** There are strips whose brightness can be set. */
  isLit: boolean;
}

export function TuningView({ controls, tuning, isLit }: TuningProps) {
  const { site } = controls;
  const onInvalid = (problem: string): void => controls.toasts.show("error", problem);
  return (
    <>
      {controls.may("selector/method") && (
        <>
          <Choice
            legend="Method"
            options={tuning.methods}
            value={tuning.method}
            onChoose={(method) => tuning.choose(method)}
          />
          <Slider
            label="Time on an object"
            min={0.2}
            max={3}
            step={0.05}
            unit="s"
            initial={tuning.ownDwellS ?? initialOf(site, "selector", "dwell")}
            value={tuning.dwellS}
            send={(value) => tuning.askMethod({ dwell_s: value })}
            onInvalid={onInvalid}
          />
        </>
      )}
      {controls.may("pui/tolerance") && tuning.toleranceDeg !== null && (
        <Slider
          label="Tolerance"
          min={0.5}
          max={15}
          step={0.5}
          unit="°"
          initial={initialOf(site, "pui", "tolerance")}
          value={tuning.toleranceDeg}
          send={(value) => tuning.askTolerance({ tolerance_rad: value * DEGREE })}
          onInvalid={onInvalid}
        />
      )}
      {isLit && (
        <Slider
          label="Brightness of the strips"
          min={0}
          max={100}
          step={5}
          unit="%"
          initial={percentOf(initialOf(site, "led-driver", "brightness"))}
          value={percentOf(figureOf(site.health.get("led-driver"), "brightness"))}
          send={(value) => tuning.dim(value)}
          onInvalid={onInvalid}
        />
      )}
    </>
  );
}

/** Options of the installed methods, ours first. */
function methodOptions(installed: readonly string[]): Option[] {
  const others = installed.filter((name) => !METHODS.includes(name));
  return [...METHODS, ...others].map((value) => ({ value, label: capital(value) }));
}

function roundedDegrees(radians: number): number {
  return Math.round((radians / DEGREE) * STEPS_PER_DEGREE) / STEPS_PER_DEGREE;
}

function percentOf(share: number | null): number | null {
  return share === null ? null : Math.round(share * PERCENT);
}
