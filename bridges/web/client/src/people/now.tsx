/** What the chosen person does now: their state and next step, the button of their wrist, and what can be taken back. */

import { useRef } from "preact/hooks";
import type { Controls } from "../controls";
import { capital } from "../format";
import type { Hover } from "../messages";
import { standingOf, type Person, type Site } from "../site/site";
import { unavailable } from "../site/things";
import { Button, Icon } from "../ui/elements";
import { namedPart, type PanelPart } from "../ui/part";
import { friendly, nextStepOf, pressTitle, rememberedSentence, stateTitle, thing } from "../words";

const ICONS = { idle: "pause", localizing: "place", pointing: "point" } as const;
/** Time without people after which it is said, ms: they come a little later than the rest of a scenario. */
const NOBODY_MS = 3000;

export function nowPart(controls: Controls): PanelPart {
  return namedPart(
    "Now",
    () => true,
    () => <Now controls={controls} />,
    () => controls.person?.interaction?.state ?? "idle",
  );
}

export function Now({ controls }: { controls: Controls }) {
  const { site, person } = controls;
  const isRunning = site.connected && site.status?.run === "runs" && !site.timeline;
  const nobodyMs = useDuration(isRunning && site.people.size === 0);
  return (
    <>
      {nobodyMs > NOBODY_MS && <p class="muted">Nobody is here yet. Add a person: pointit person add anna</p>}
      {person?.interaction && <State controls={controls} person={person} />}
      {person && <Position person={person} />}
      {site.hello?.role === "viewer" && (
        <p class="muted">
          {site.timeline
            ? "This is the past: nothing in it can be changed."
            : "This page only looks on. The operator's link lets you control."}
        </p>
      )}
      <Press controls={controls} />
      <Actions controls={controls} />
      <Remembered controls={controls} />
    </>
  );
}

/** How long something has held without a pause, ms. */
function useDuration(holds: boolean): number {
  const sinceMs = useRef(Infinity);
  const nowMs = performance.now();
  sinceMs.current = holds ? Math.min(sinceMs.current, nowMs) : Infinity;
  return nowMs - sinceMs.current;
}

function State({ controls, person }: { controls: Controls; person: Person }) {
  const { site } = controls;
  const { user } = person;
  const state = person.interaction?.state ?? "idle";
  const title = stateTitle(state);
  const passed = friendly(site, person.cursor?.passed?.text ?? "");
  const step = site.timeline ? "" : nextStepOf(site, person);
  return (
    <div class="now">
      <div class="state">
        <span class="badge">
          <Icon name={ICONS[state] ?? "pause"} />
        </span>
        <div>
          <strong>{site.people.size > 1 ? `${user}: ${title.toLowerCase()}` : title}</strong>
          <p class="next">{capital(passed) || step}</p>
        </div>
      </div>
      {controls.isPresent("selector") && <Gauge site={site} person={person} />}
    </div>
  );
}

/** How far a selection has come. Its place is kept, so that what is below does not jump. */
function Gauge({ site, person }: { site: Site; person: Person }) {
  const { hover, interaction } = person;
  const isOn = Boolean(hover?.object_id) && interaction?.state === "pointing";
  return (
    <div class="gauge" data-shown={isOn ? "" : undefined}>
      <span class="muted">{isOn && hover ? gaugeText(site, hover) : ""}</span>
      <progress max={1} value={hover?.progress ?? 0} aria-label="How far the selection has come" />
    </div>
  );
}

function gaugeText(site: Site, hover: Hover): string {
  const name = capital(thing(site, hover.object_id));
  return hover.action === "refuse" ? `${name}: ${refusalOf(site, hover)}` : name;
}

/** Why the object cannot be selected now. */
function refusalOf(site: Site, hover: Hover): string {
  if (hover.taken_by) return `taken by ${hover.taken_by}`;
  return unavailable(site, hover.object_id) ? "unavailable" : "too late";
}

function Position({ person }: { person: Person }) {
  const stands = standingOf(person);
  if (stands && !stands.isAssumed) return null;
  return (
    <p class="muted">
      {stands
        ? `The position of ${person.user} is not yet measured; the assumed one is shown.`
        : `The position of ${person.user} is not known, so they are not shown.`}
    </p>
  );
}

/** The button of the wrist. A simulation points by itself: its button is not the largest of the panel. */
function Press({ controls }: { controls: Controls }) {
  const { user, person } = controls;
  const name = pressTitle(person?.interaction ?? null);
  const line = person?.line ?? null;
  // Without an arm nothing follows a press
  const canPoint = line?.moved_by !== "own" || line.source !== "none";
  if (!user || !name || !canPoint || !controls.mayDo("press")) return null;
  const isDemo = line?.moved_by === "own" && line.source === "simulation";
  return (
    <Button
      name={name}
      icon="button"
      shortcut="Space"
      kind={isDemo ? "" : "primary"}
      class={isDemo ? "" : "press"}
      onClick={() => controls.press()}
    />
  );
}

function Actions({ controls }: { controls: Controls }) {
  const isBusy = isLocalizing(controls);
  const canLocalize = controls.canLocalize && !isBusy;
  const canCancel = controls.may("localizer/{user}/cancel") && isBusy;
  const mayUndo = controls.may("selector/{user}/undo");
  const mayClear = controls.may("selector/{user}/clear");
  if (!canLocalize && !canCancel && !mayUndo && !mayClear) return null;
  return (
    <div class="pairs">
      {canLocalize && (
        <Button name="Localize" icon="place" shortcut="L" onClick={() => controls.localize()} />
      )}
      {canCancel && <Button name="Cancel" icon="close" shortcut="C" onClick={() => controls.cancel()} />}
      {mayUndo && (
        <Button
          name="Undo"
          icon="undo"
          shortcut="U"
          isOff={!controls.canUndo}
          title={controls.canUndo ? "" : "There is nothing to undo"}
          onClick={() => controls.undo()}
        />
      )}
      {mayClear && (
        <Button
          name="Clear"
          icon="clear"
          shortcut="X"
          isOff={!controls.canClear}
          title={controls.canClear ? "" : "There is nothing to clear"}
          onClick={() => controls.clear()}
        />
      )}
    </div>
  );
}

function Remembered({ controls }: { controls: Controls }) {
  const sentence = rememberedSentence(controls.person?.pose ?? null);
  if (!sentence) return null;
  // While a person is localized, it would cancel that
  const mayForget = !isLocalizing(controls) && controls.may("localizer/{user}/cancel");
  return (
    <>
      <p class="muted">{sentence}</p>
      {mayForget && (
        <Button
          name="Forget"
          label="Forget the elevation bias"
          onClick={() => controls.cancel({ forget_bias: true })}
        />
      )}
    </>
  );
}

function isLocalizing({ person }: Controls): boolean {
  return person?.interaction?.state === "localizing" || person?.localization?.phase === "sampling";
}
