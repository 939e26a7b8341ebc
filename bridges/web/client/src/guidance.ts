/** Guidance for new users over the scene: one sentence, and its actions. */

import type { Hover, Interaction, TrackedObject } from "./messages";
import { robotStep, type RobotSituation } from "./robot_guidance";
import type { PersonLine } from "./wire";

/** What there is to do: point at something, stay on it, press; or it does what was asked, or cannot. */
export type Step = "aim" | "hold" | "press" | "following" | "stopped";

export interface Situation {
  user: string;
  /** This page may take the person's wrist; may pair a phone. */
  mayTake: boolean;
  mayPair: boolean;
  /** The person is simulated. */
  isSimulated: boolean;
  movedBy: PersonLine["moved_by"];
  isMine: boolean;
  interaction: Interaction | null;
  hover: Hover | null;
  /** What is hovered, in words. */
  hovered: string;
  /** Why what is hovered is unavailable, with the remedy. Empty or left out if it is not. */
  unavailable?: string;
  /** Effect of selecting what is hovered. */
  mode: TrackedObject["mode"];
  /** All objects here want a press. */
  areAllPressed: boolean;
  /** This person has selected what is hovered; this page did it. */
  isTheirs: boolean;
  isOwn: boolean;
  /** Names are spoken to the person: a press confirms what was heard, and staying does nothing. */
  hasNames: boolean;
  /** Things that want a press, in words; "" if none or all do. */
  pressed: string;
  /** What is hovered is selected by the button. */
  wantsPress: boolean;
  /** Robots that the person steers or may steer; null where nobody steers any. */
  robots: RobotSituation | null;
  /** A place for a robot is proposed. */
  isProposed: boolean;
  /** Sentence that all packages have passed, with the result. Empty if they have not. */
  passed: string;
  /** Reason why there is nothing to select, and the remedy. Empty if there is something. */
  empty: string;
  scenario: string;
  /** Objects can be selected here. */
  canSelect: boolean;
  /** Last selection of this person, such as "fired the kettle". Empty after some seconds. */
  success: string;
  /** It was not one of those to select. */
  isWrong: boolean;
  /** How many objects of this person are their own now; this page selected them. */
  count: number;
}

export interface Guidance {
  mode: "none" | "invite" | "other" | "idle" | "point" | "success" | "wrong" | "phone" | "passed";
  step: Step;
  title: string;
  text: string;
  /** Label of the button that acts as a press at the wrist. Empty if it is hidden. */
  press: string;
  /** How full the gauge is; null: none shows. */
  progress: number | null;
}

const GOALS: Record<string, string> = {
  scenario_1: "Point at a lamp: its colour shows how close you point.",
  scenario_2: "Point along a strip: the light follows you.",
  scenario_3: "Move onto a red segment and stay on it until it is full.",
  scenario_4: "Move onto a red package and stay on it until it is full.",
  send_a_robot: "Stay on a place of the floor: it is proposed as a goal. No robot is here to see.",
  shelf: "Move onto a box and stay on it until it fires.",
};

/** What there is to do in a scenario for who points with the mouse. */
export function goal(scenario: string, canSelect: boolean, { areAllPressed, hasNames, pressed }: Pick<Situation, "areAllPressed" | "hasNames" | "pressed">): string {
  if (hasNames && canSelect) return "Point at things, or step by the arrow keys: their names are spoken. Press once you have heard the one that you want.";
  const select = areAllPressed ? "Move onto an object and press the button." : "Move onto an object and stay on it until it is full.";
  const usual = GOALS[scenario] ?? (canSelect ? select : "Point anywhere: the arm follows you.");
  return pressed ? `${usual} For ${pressed}, press the button.` : usual;
}

/** The object under the cursor: its state, and what staying or pressing does. */
function onObject({ hovered, unavailable, mode, hasNames, wantsPress, isTheirs, isOwn }: Situation, hover: Hover): Partial<Guidance> {
  const { taken_by: other, progress, action } = hover;
  if (action === "refuse") {
    if (unavailable && !other) return { step: "stopped", text: `${hovered} is unavailable: ${unavailable}` };
    const why = !other ? "it is too late for it" : mode === "claim" ? `${other} has it` : `${other} is about to use it`;
    return { step: "stopped", text: `${hovered} cannot be had: ${why}. Point at another${other ? ", or wait" : ""}.` };
  }
  if (action !== "deselect" && (isTheirs || action === "")) {
    const isOn = isTheirs || hover.is_selected;
    const owned = other ? `belongs to ${other}` : !isOn ? "is free again" : isOwn ? "is yours" : "is selected already";
    return { step: "following", text: `${hovered} ${{ claim: owned, button: "has fired", switch: isOn ? "is on" : "is off" }[mode]}. Go on with the next.` };
  }
  const step = wantsPress ? "press" as const : "hold" as const, press = wantsPress ? "Press" : "";
  if (action === "deselect") {
    const does = mode === "switch" ? "is on" : "is yours", ends = mode === "switch" ? "switches it off" : "takes it back";
    return { step, press, progress, text: `${hovered} ${does}; ${wantsPress ? "the button" : "staying"} ${ends}.` };
  }
  return { step, press, progress, text: `${hovered}: ${hasNames ? "press once you have heard its name." : wantsPress ? "press the button." : "stay on it …"}` };
}

/** Choose the guidance. */
export function guidance(now: Situation): Guidance {
  const none: Guidance = { mode: "none", step: "aim", title: "", text: "", press: "", progress: null };
  if (now.passed) return { ...none, mode: "passed", title: now.passed };
  if (!now.isMine) {
    if (now.movedBy === "phone" || now.movedBy === "headset") return { ...none, mode: "phone", title: `A ${now.movedBy} points.`, text: now.interaction?.next_step ?? "" };
    if (now.movedBy === "mouse") return now.mayTake ? { ...none, mode: "other", title: `Another page points as ${now.user}. Take over:` } : none;
    if (!now.isSimulated || !(now.mayTake || now.mayPair)) return none;
    return { ...none, mode: "invite", title: "This is a simulation. Take over:" };
  }
  const state = now.interaction?.state ?? "pointing";
  if (state === "idle") return { ...none, mode: "idle", step: "press", title: "Your arm rests.", text: now.interaction?.next_step ?? "", press: "Start pointing" };
  if (state === "localizing") {
    return { ...none, mode: "point", title: "You are the arm. First the system finds your place.", text: now.interaction?.next_step ?? "" };
  }
  if (now.success && now.isWrong) {
    return { ...none, mode: "wrong", title: `You ${now.success}, which is not wanted.`, text: "Select it again to take it back." };
  }
  if (now.success) {
    return { ...none, mode: "success", title: `You ${now.success}!`, text: now.count > 1 ? `${now.count} are yours now. Go on with the next.` : "Go on with the next." };
  }
  const here: Guidance = { ...none, mode: "point", title: "You are the arm now." };
  if (now.hover?.object_id && now.canSelect) return { ...here, ...onObject(now, now.hover) };
  if (now.robots) return { ...here, ...robotStep(now.robots) };
  if (now.empty) return { ...here, step: "stopped", text: now.empty };
  if (now.isProposed) return { ...here, step: "hold", text: "This place is proposed. Point elsewhere, then here again: that sends it." };
  return { ...here, text: goal(now.scenario, now.canSelect, now) };
}
