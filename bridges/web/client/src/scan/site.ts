/** What the page says to the site, and hears of it. */

import type {
  ScanBegin,
  ScanLight,
  ScanLook,
  ScanRoom,
  ScanSave,
  ScanState,
  ScanThing,
  ScanUndo,
  ScanView,
} from "../wire";

import { sentence } from "../format";
import type { Colour } from "./code";

/** The site refuses, and says why; or it is not reachable. */
export class Refused extends Error {}

type Said = ScanBegin | ScanView | ScanUndo | ScanThing | ScanSave | ScanLook;

const GONE = "The site does not answer: is it still running, and the phone in the same network?";
const PATIENCE_MS = 10_000;

async function post(said: object): Promise<Response> {
  const sent = fetch("/scan", {
    method: "POST",
    body: JSON.stringify(said),
    headers: { "Content-Type": "application/json" },
    keepalive: true,
    signal: AbortSignal.timeout(PATIENCE_MS),
  });
  const answer = await sent.catch(() => {
    throw new Refused(GONE);
  });
  if (!answer.ok) throw new Refused(sentence(await answer.text()));
  return answer;
}

export async function ask(said: Said): Promise<ScanState> {
  return (await post(said)).json() as Promise<ScanState>;
}

/** Show the lights in colours, or none, or give them back (null); returns when it was sent to them. */
export async function light(colors: Colour[] | null, brightness = 1): Promise<void> {
  await post({ kind: "light", colors, brightness } satisfies ScanLight);
}

export async function simulatedRoom(): Promise<ScanRoom> {
  return (await fetch("/scan/room")).json() as Promise<ScanRoom>;
}

let seq = "";

/** Wait for the next change of the lights, a second at most. */
export async function lights(): Promise<Record<string, string>> {
  const heard = (await (await fetch(`/scan/lights?after=${seq}`)).json()) as {
    seq: number;
    strips: Record<string, string>;
  };
  seq = String(heard.seq);
  return heard.strips;
}
