/** The message log, newest first, with a filter. */

import { useState } from "preact/hooks";
import type { Controls } from "../controls";
import { time } from "../format";
import { matching } from "../site/log";
import type { LogLine } from "../site/site";
import { Icon } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";

const MAX_SHOWN = 100;
const SIGNS = { info: "info", warning: "warning", error: "warning" } as const;

export function messagesPart(controls: Controls): PanelPart {
  return titledPart(
    "Messages",
    () => true,
    () => <Messages controls={controls} />,
  );
}

export function Messages({ controls }: { controls: Controls }) {
  const [filter, setFilter] = useState("");
  const lines = matching(controls.site.log, filter, MAX_SHOWN);
  return (
    <>
      <input
        type="search"
        placeholder="Filter"
        aria-label="Filter the messages"
        value={filter}
        onInput={({ currentTarget }) => setFilter(currentTarget.value)}
      />
      <ol class="log" tabindex={0} aria-label="Messages, newest first">
        {lines.map((line) => (
          <Message key={line.id} line={line} />
        ))}
        {lines.length === 0 && (
          <li class="muted">{filter ? "No message fits." : "Nothing has happened yet."}</li>
        )}
      </ol>
    </>
  );
}

function Message({ line }: { line: LogLine }) {
  const { at, severity, who, text } = line;
  return (
    <li data-severity={severity}>
      <Icon name={SIGNS[severity]} />
      <span>
        <time>{time(at)}</time> {who && <b>{who}</b>} {text}
        {severity !== "info" && <span class="unseen">{` (${severity})`}</span>}
      </span>
    </li>
  );
}
