/** One tile for each thing of the map: its name and state, what pointing at it does, who fired it last, and a button that tries it. */

import type { Controls } from "../controls";
import type { ActState } from "../messages";
import { problemsOfThings, thingTiles, type ThingTile } from "../site/things";
import { Icon } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";
import { OUTCOMES } from "../words";

/** User in the events of a trial, as of `pointit things try`: nobody pointed. */
const OPERATOR = "operator";
const ICONS: Record<ThingTile["mode"], string> = { button: "button", switch: "power", claim: "check" };

export function thingsPart(controls: Controls): PanelPart {
  return titledPart(
    "Things",
    () => (controls.site.map?.things.length ?? 0) > 0,
    () => <Things controls={controls} />,
  );
}

export function Things({ controls }: { controls: Controls }) {
  const tiles = thingTiles(controls.site);
  return (
    <>
      <div class="problems">
        {problemsOfThings(tiles).map(({ text, isStarting }) => (
          <p key={text} class={isStarting ? "muted" : ""}>
            <Icon name={isStarting ? "pause" : "warning"} />
            <span>{text}</span>
          </p>
        ))}
      </div>
      <ul class="cards things">
        {tiles.map((tile) => (
          <ThingCard key={tile.id} controls={controls} tile={tile} />
        ))}
      </ul>
    </>
  );
}

function ThingCard({ controls, tile }: { controls: Controls; tile: ThingTile }) {
  const { name, mode } = tile;
  const mayTry = mode !== "claim" && controls.may("selector/{user}/set_thing");
  const isUnavailable = tile.problem !== "" && !tile.isStarting;

  function tryIt(): void {
    if (tile.canBeTried) void tryThing(controls, tile);
  }

  return (
    <li data-on={mark(tile.isOn)} data-unavailable={mark(isUnavailable)}>
      <span class="badge">
        <Icon name={ICONS[mode]} />
      </span>
      <div>
        <div class="head">
          <strong>{name}</strong>
          <p>{tile.state}</p>
        </div>
        <p class="muted">{tile.last}</p>
        <p class="muted">{tile.does}</p>
        <progress
          max={1}
          value={tile.progress ?? 0}
          aria-label={`How far ${name} is selected`}
          data-shown={mark(tile.progress !== null)}
        />
      </div>
      {mayTry && (
        <button
          type="button"
          aria-label={`Try ${name}`}
          aria-disabled={tile.canBeTried ? undefined : "true"}
          onClick={tryIt}
        >
          <span>Try</span>
        </button>
      )}
    </li>
  );
}

async function tryThing(controls: Controls, { id, name, mode, isOn }: ThingTile): Promise<void> {
  const does = OUTCOMES[mode][isOn ? 1 : 0];
  const reply = await controls.ask({
    key: "selector/{user}/set_thing",
    name: OPERATOR,
    query: { thing: id },
  });
  if (reply) controls.toasts.show(...triedToast(name, does, reply["status"] as ActState["status"] | null));
}

/** What is told of a trial: that it was done only if its carriers have told so. */
export function triedToast(
  name: string,
  does: string,
  status: ActState["status"] | null,
): ["done" | "info", string] {
  if (status === "done") return ["done", `${does}: ${name}.`];
  return ["info", `${name}: ${status === "pending" ? "started" : "asked, its result is not told yet"}.`];
}

/** Value of an attribute that is there or not. */
function mark(isOn: boolean): "" | undefined {
  return isOn ? "" : undefined;
}
