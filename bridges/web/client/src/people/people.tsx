/** Number of people, and whether they are localized first; a button restarts the scenario with them. */

import { useState } from "preact/hooks";
import type { Controls } from "../controls";
import type { Scenario } from "../scenario";
import { Choice } from "../ui/choice";
import { Button } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";

const NUMBERS = ["1", "2", "3", "4"].map((value) => ({ value, label: value }));

export function peoplePart(controls: Controls, scenario: Scenario): PanelPart {
  return titledPart(
    "People",
    () => controls.may("run/scenario"),
    () => <People controls={controls} scenario={scenario} />,
  );
}

interface PeopleProps {
  controls: Controls;
  scenario: Pick<Scenario, "run">;
}

export function People({ controls, scenario }: PeopleProps) {
  const { site } = controls;
  /** Chosen and not yet running; null: as it runs. */
  const [wanted, setWanted] = useState<number | null>(null);
  const [localizes, setLocalizes] = useState<boolean | null>(null);
  const isRunning = site.status?.run === "runs";
  if (wanted !== null && (wanted === site.people.size || !isRunning)) setWanted(null);
  if (localizes !== null && (localizes === controls.localizes || !isRunning)) setLocalizes(null);
  const people = wanted ?? site.people.size;
  const ways = localizes ? ", found by pointing" : ", at known places";

  function restart(): void {
    scenario.run(controls.scenario, {
      ...(wanted ? { users: wanted } : {}),
      ...(localizes === null ? {} : { localizes }),
    });
  }

  return (
    <>
      <Choice
        legend="How many"
        options={NUMBERS}
        value={String(people)}
        onChoose={(value) => setWanted(Number(value))}
      />
      {(site.map?.lamps.length ?? 0) > 0 && (
        <label class="check">
          <input
            type="checkbox"
            checked={localizes ?? controls.localizes}
            onChange={({ currentTarget }) => setLocalizes(currentTarget.checked)}
          />
          <span>Find them by their pointing at lamps</span>
        </label>
      )}
      <Button
        name={`Restart with ${people === 1 ? "1 person" : `${people} people`}${localizes === null ? "" : ways}`}
        hidden={wanted === null && localizes === null}
        onClick={restart}
      />
    </>
  );
}
