/** Robots: who steers each, what it does and why not; a button that stops it. And the button over the scene that stops all. */

import { render } from "preact";
import type { Controls } from "../controls";
import { capital } from "../format";
import { cssColor } from "../geometry/appearance";
import { robotLine, seenRobots, type SeenRobot } from "../site/robots";
import { Icon, Key } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";

const NO_ROBOT =
  "No robot is in this room. What you choose is sent as a goal, for a robot that joins; the quadrotor and the ground robot have scenarios of their own.";

/** The list of robots in the panel; also without any, where what people choose is sent as a goal. */
export function robotsPart(controls: Controls): PanelPart {
  return titledPart(
    "Robots",
    () => seenRobots(controls.site).length > 0 || controls.isPresent("goal", controls.user),
    () => <Robots controls={controls} />,
  );
}

export function Robots({ controls }: { controls: Controls }) {
  const robots = seenRobots(controls.site);
  return (
    <>
      {robots.length === 0 && <p class="muted">{NO_ROBOT}</p>}
      <ul class="cards robots">
        {robots.map((robot) => (
          <RobotCard key={robot.name} controls={controls} robot={robot} />
        ))}
      </ul>
    </>
  );
}

function RobotCard({ controls, robot }: { controls: Controls; robot: SeenRobot }) {
  const { name, state } = robot;
  const color = controls.site.people.get(state.user)?.profile?.cursor_color;
  return (
    <li data-phase={state.phase}>
      <div>
        <strong>
          {color && <span class="swatch" style={{ background: cssColor(color) }} />}
          {name}
        </strong>
        <p class="muted">{capital(robotLine(state))}</p>
        {state.reason && <p class="reason">{state.reason}</p>}
      </div>
      {controls.mayStop && (
        <button
          type="button"
          class="halt"
          aria-label={`Stop ${name}`}
          onClick={() => void controls.stopRobots([name])}
        >
          <Icon name="stop" />
          <span>Stop</span>
        </button>
      )}
    </li>
  );
}

/** Draw the button over the scene that stops all robots; `host` keeps its place. */
export function drawStop(host: HTMLElement, controls: Controls): void {
  const { stoppable } = controls;
  host.hidden = stoppable.length === 0;
  const robots = stoppable.length > 1 ? "all robots" : stoppable[0];
  render(
    <button type="button" class="halt" aria-keyshortcuts="R" onClick={() => void controls.stopRobots()}>
      <Icon name="stop" />
      <span>Stop</span> <span class="which">{robots}</span>
      <Key name="R" />
    </button>,
    host,
  );
}
