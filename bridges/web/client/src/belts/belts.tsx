/** The conveyor: speed, packages, counts at bays. */

import type { Controls } from "../controls";
import { byName, capital } from "../format";
import { cssColor, KIND_COLORS, kindColor } from "../geometry/appearance";
import type { BayCount, ConveyorState } from "../messages";
import { initialOf } from "../site/figures";
import type { Option } from "../ui/columns";
import { Choice } from "../ui/choice";
import { Button } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";
import { Slider } from "../ui/slider";
import { called, movingOf, nounOf } from "../words";

/** Kinds offered while the real ones are unknown. */
const USUAL_KINDS = ["red", "green", "blue"];
const MAX_KINDS = 6;
const ORDER = Object.keys(KIND_COLORS);
/** Speeds of the belts, m/s. */
const USUAL_MPS = 0.3;
const MAX_MPS = 1.5;
const STEP_MPS = 0.05;
/** Speeds are sent in hundredths of m/s. */
const STEPS_PER_MPS = 100;

/** What this page does with the belts; keys do the same as buttons. */
export class Belts {
  /** Kind of the package that is added next. */
  private chosen = USUAL_KINDS[0]!;
  private seen = new Set<string>();
  private seenIn = "";
  private beforeMps = USUAL_MPS;

  constructor(private readonly controls: Controls) {}

  get kind(): string {
    const offered = this.kinds;
    return offered.includes(this.chosen) ? this.chosen : offered[0]!;
  }

  choose(kind: string): void {
    this.chosen = kind;
    this.controls.changed();
  }

  /** The kinds that this scenario has, as far as they were on its belts or came out; the usual ones before any did. */
  get kinds(): readonly string[] {
    const { site, scenario } = this.controls;
    const here = `${scenario} ${site.map?.name ?? ""}`;
    if (here !== this.seenIn) {
      this.seen = new Set();
      this.seenIn = here;
    }
    for (const { objects } of site.objects.values()) for (const { kind } of objects) this.see(kind);
    for (const { kind } of site.conveyor?.bays ?? []) this.see(kind);
    if (!this.seen.size) return USUAL_KINDS;
    return [...this.seen].sort((a, b) => placeOf(a) - placeOf(b) || byName(a, b)).slice(0, MAX_KINDS);
  }

  /** Whether packages are fed: after the last package, feeding starts again. */
  get isFed(): boolean {
    const { conveyor } = this.controls.site;
    return (conveyor?.feeding ?? false) && conveyor?.step !== "end";
  }

  feedOrRest(): void {
    if (!this.controls.site.conveyor) return;
    void this.controls.ask({ key: "conveyor/set_feeding", query: { feeding: !this.isFed } });
  }

  add(): void {
    if (this.controls.may("conveyor/add_package")) void this.addOne();
  }

  /** Stop, or go on as before. */
  halt(): void {
    const now = this.controls.site.conveyor?.speed_mps ?? 0;
    if (!this.controls.may("conveyor/set_speed")) return;
    if (now !== 0) this.beforeMps = now;
    void this.setSpeed(now === 0 ? this.beforeMps : 0);
  }

  faster(byMps: number): void {
    const { conveyor } = this.controls.site;
    if (!conveyor || !this.controls.may("conveyor/set_speed")) return;
    void this.setSpeed(Math.max(0, Math.min(MAX_MPS, conveyor.speed_mps + byMps)));
  }

  /** Set the speed, m/s. Returns the one in use then, or null if it is refused. */
  async setSpeed(mps: number): Promise<number | null> {
    const speed = Math.round(mps * STEPS_PER_MPS) / STEPS_PER_MPS;
    const reply = await this.controls.ask({ key: "conveyor/set_speed", query: { speed_mps: speed } });
    return reply ? speed : null;
  }

  private async addOne(): Promise<void> {
    const { controls, kind } = this;
    const reply = await controls.ask({ key: "conveyor/add_package", query: { kind } });
    if (!reply) return;
    const name = called(controls.site, String(reply["object_id"] ?? ""), kind);
    controls.toasts.show("done", `Added: ${name}.`, { topic: "added" });
  }

  private see(kind: string): void {
    if (kind) this.seen.add(kind);
  }
}

export function beltsPart(controls: Controls, belts: Belts): PanelPart {
  return titledPart(
    () => capital(movingOf(controls.site)),
    () => isOffered(controls),
    () => <BeltsView controls={controls} belts={belts} />,
  );
}

function isOffered(controls: Controls): boolean {
  const { conveyor } = controls.site;
  if (!conveyor) return false;
  if (controls.may("conveyor/set_speed") || controls.may("conveyor/add_package")) return true;
  return conveyor.bays.some(({ bay }) => bay);
}

interface BeltsProps {
  controls: Controls;
  belts: Belts;
}

export function BeltsView({ controls, belts }: BeltsProps) {
  const { conveyor } = controls.site;
  if (!conveyor) return null;
  return (
    <>
      {controls.may("conveyor/set_speed") && (
        <Speed controls={controls} belts={belts} mps={conveyor.speed_mps} />
      )}
      {controls.may("conveyor/set_feeding") && (
        <Button
          name={feedingName(belts, conveyor)}
          icon={belts.isFed ? "pause" : "play"}
          onClick={() => belts.feedOrRest()}
        />
      )}
      {controls.may("conveyor/add_package") && (
        <>
          <Choice
            legend="Kind to add"
            options={belts.kinds.map(kindOption)}
            value={belts.kind}
            onChoose={(kind) => belts.choose(kind)}
          />
          <Button
            name={`Add a ${nounOf(controls.site)}`}
            icon="plus"
            shortcut="P"
            onClick={() => belts.add()}
          />
        </>
      )}
      <Bays counts={conveyor.bays.filter(({ bay }) => bay)} />
    </>
  );
}

function Speed({ controls, belts, mps }: BeltsProps & { mps: number }) {
  const moving = movingOf(controls.site);
  const isStill = mps === 0;
  return (
    <>
      <Slider
        label="Speed"
        min={0}
        max={MAX_MPS}
        step={STEP_MPS}
        unit="m/s"
        initial={initialOf(controls.site, "conveyor-sim", "speed")}
        value={mps}
        send={(value) => belts.setSpeed(value)}
        onInvalid={(problem) => controls.toasts.show("error", problem)}
      />
      <Button
        name={isStill ? `Start the ${moving}` : `Stop the ${moving}`}
        icon={isStill ? "play" : "stop"}
        shortcut="S"
        onClick={() => belts.halt()}
      />
    </>
  );
}

function feedingName(belts: Belts, { step }: ConveyorState): string {
  if (belts.isFed) return "Stop feeding";
  return step === "end" ? "Feed again" : "Start feeding";
}

function kindOption(kind: string): Option {
  return { value: kind, label: capital(kind), swatch: cssColor(kindColor(kind)) };
}

/** Place of a kind in the order of colours; unknown ones come last. */
function placeOf(kind: string): number {
  return ORDER.includes(kind) ? ORDER.indexOf(kind) : ORDER.length;
}

/** How many packages of each kind came out at each bay. */
function Bays({ counts }: { counts: readonly BayCount[] }) {
  if (counts.length === 0) return null;
  const kinds = [...new Set(counts.map(({ kind }) => kind))].sort(byName);
  const bays = [...new Set(counts.map(({ bay }) => bay))].sort(byName);
  const countOf = (bay: string, kind: string): string => {
    const found = counts.find((each) => each.bay === bay && each.kind === kind);
    return found ? String(found.count) : "–";
  };
  return (
    <table class="bays">
      <caption>Came out</caption>
      <thead>
        <tr>
          <th scope="col">Bay</th>
          {kinds.map((kind) => (
            <th key={kind} scope="col">
              {capital(kind)}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {bays.map((bay) => (
          <tr key={bay}>
            <th scope="row">{bay}</th>
            {kinds.map((kind) => (
              <td key={kind}>{countOf(bay, kind)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}
