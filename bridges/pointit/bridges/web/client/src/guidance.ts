/** Guidance for new users over the scene: one sentence, and its actions. */

import type { Hover, Interaction } from "./messages";

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
  /** This person has selected what is hovered. */
  isTheirs: boolean;
  scenario: string;
  /** Objects can be selected here. */
  canSelect: boolean;
  /** What was selected in the last seconds by this person, in words; empty: nothing. */
  success: string;
  /** It was not one of those to select. */
  isWrong: boolean;
  /** How much this person has selected now. */
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
export function goal(scenario: string, canSelect: boolean): string {
  return GOALS[scenario] ?? (canSelect ? "Move onto an object and stay on it until it is full." : "Move the mouse: the arm follows it.");
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
    return { ...none, mode: "wrong", title: `You selected ${now.success}, which is not wanted.`, text: "Stay on it again to take it back." };
  }
  if (now.success) {
    return { ...none, mode: "success", title: `You selected ${now.success}!`, text: now.count > 1 ? `${now.count} are yours now. Go on with the next.` : "Go on with the next." };
  }
  const title = "You are the arm now.";
  const { hover } = now;
  if (hover?.object_id && now.canSelect) {
    if (hover.action === "refuse") return { mode: "point", title, text: `${now.hovered} cannot be had: ${hover.taken_by ? `${hover.taken_by} has it` : "it is too late for it"}.`, progress: null };
    if (hover.action === "deselect") return { mode: "point", title, text: `${now.hovered} is yours; staying takes it back.`, progress: hover.progress };
    if (now.isTheirs || (hover.is_selected && hover.action === "")) {
      const text = hover.taken_by ? `${now.hovered} belongs to ${hover.taken_by}. Go on with the next.` : `${now.hovered} is yours. Go on with the next.`;
      return { mode: "point", title, text, progress: null };
    }
    return { mode: "point", title, text: `${now.hovered}: stay on it …`, progress: hover.progress };
  }
  return { mode: "point", title, text: goal(now.scenario, now.canSelect), progress: null };
}
