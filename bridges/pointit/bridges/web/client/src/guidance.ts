/** Guidance for new users over the scene: one sentence, and its actions. */

import type { Hover, Interaction, TrackedObject } from "./messages";

export interface Situation {
  /** This page may take the person's wrist; may pair a phone. */
  mayTake: boolean;
  mayPair: boolean;
  /** The person is simulated. */
  isSimulated: boolean;
  movedBy: "own" | "mouse" | "phone";
  isMine: boolean;
  interaction: Interaction | null;
  hover: Hover | null;
  /** What is hovered, in words. */
  hovered: string;
  /** Effect of selecting what is hovered. */
  mode: TrackedObject["mode"];
  /** It is selected by the button. */
  isPressed: boolean;
  /** All objects here are. */
  areAllPressed: boolean;
  /** This person has selected what is hovered. */
  isTheirs: boolean;
  scenario: string;
  /** Objects can be selected here. */
  canSelect: boolean;
  /** What this person selected in the last seconds, as "fired the kettle"; empty: nothing. */
  success: string;
  /** It was not one of those to select. */
  isWrong: boolean;
  /** How many objects are this person's own now. */
  count: number;
}

export interface Guidance {
  mode: "none" | "invite" | "idle" | "point" | "success" | "wrong" | "phone";
  title: string;
  text: string;
  /** How full the gauge is; null: none shows. */
  progress: number | null;
}

const GOALS: Record<string, string> = {
  scenario_1: "Move the mouse over a lamp: its colour shows how close you point.",
  scenario_2: "Move the mouse along a strip: the light follows you.",
  scenario_3: "Move onto a red segment and stay on it until it is full.",
  scenario_4: "Move onto a red package and stay on it until it is full.",
  scenario_5: "Point at the quadrotor and press the button: it takes off and follows you. Press again: it lands there.",
  scenario_6: "Point at the robot and press the button. Then stay on each place of its way, and press again: it goes there.",
};

/** What there is to do in a scenario for who points with the mouse. */
export function goal(scenario: string, canSelect: boolean, areAllPressed: boolean): string {
  const select = areAllPressed ? "Move onto an object and press the button." : "Move onto an object and stay on it until it is full.";
  return GOALS[scenario] ?? (canSelect ? select : "Move the mouse: the arm follows it.");
}

/** The object under the cursor: its state, and what staying or pressing does. */
function hoveredText({ hovered, mode, isPressed, isTheirs }: Situation, hover: Hover): { text: string; progress: number | null } {
  if (hover.action === "refuse") {
    const why = !hover.taken_by ? "it is too late for it" : mode === "claim" ? `${hover.taken_by} has it` : `${hover.taken_by} is about to use it`;
    return { text: `${hovered} cannot be had: ${why}.`, progress: null };
  }
  const isPress = isPressed || hover.progress >= 1; // a full one that has not fired waits for the button
  if (hover.action === "deselect") {
    const does = mode === "switch" ? "is on" : "is yours", ends = mode === "switch" ? "switches it off" : "takes it back";
    return { text: `${hovered} ${does}; ${isPress ? "the button" : "staying"} ${ends}.`, progress: hover.progress };
  }
  if (isTheirs || hover.action === "") {
    const isOn = isTheirs || hover.is_selected, owned = hover.taken_by ? `belongs to ${hover.taken_by}` : isOn ? "is yours" : "is free again";
    return { text: `${hovered} ${{ claim: owned, button: "has fired", switch: isOn ? "is on" : "is off" }[mode]}. Go on with the next.`, progress: null };
  }
  return { text: isPress ? `${hovered}: press the button.` : `${hovered}: stay on it …`, progress: hover.progress };
}

/** Choose the guidance. */
export function guidance(now: Situation): Guidance {
  const none: Guidance = { mode: "none", title: "", text: "", progress: null };
  if (!now.isMine) {
    if (now.movedBy === "phone") return { ...none, mode: "phone", title: "A phone points.", text: now.interaction?.next_step ?? "" };
    if (now.movedBy === "mouse" || !now.isSimulated || !(now.mayTake || now.mayPair)) return none;
    return { ...none, mode: "invite", title: "This is a simulation. Take over:", text: "" };
  }
  const state = now.interaction?.state ?? "pointing";
  if (state === "idle") return { ...none, mode: "idle", title: "Your arm rests.", text: now.interaction?.next_step ?? "" };
  if (state === "localizing") {
    return { ...none, mode: "point", title: "You are the arm. First the system finds your place.", text: now.interaction?.next_step ?? "" };
  }
  if (now.success && now.isWrong) {
    return { ...none, mode: "wrong", title: `You ${now.success}, which is not wanted.`, text: "Select it again to take it back." };
  }
  if (now.success) {
    return { ...none, mode: "success", title: `You ${now.success}!`, text: now.count > 1 ? `${now.count} are yours now. Go on with the next.` : "Go on with the next." };
  }
  const title = "You are the arm now.";
  if (now.hover?.object_id && now.canSelect) return { mode: "point", title, ...hoveredText(now, now.hover) };
  return { mode: "point", title, text: goal(now.scenario, now.canSelect, now.areAllPressed), progress: null };
}
