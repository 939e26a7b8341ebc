/** The scene in the viewer's own room: a WebXR session, and its alignment with {W} by touches. */

import * as THREE from "three";
import {
  alignmentFrom,
  assess,
  canAlign,
  headingOf,
  landmarksOf,
  leveled,
  reoriented,
  TOUCHES,
  type Alignment,
  type Landmark,
  type Touch,
} from "../geometry/alignment";
import { add, scale, subtract, turn, type Vec3 } from "../geometry/vec";
import type { Environment } from "../messages";
import type { Arm, Immersion } from "../view";
import { keepAnchor, keptAnchor, type KeptAnchor } from "./kept_anchor";
import type { Theme } from "./mesh_factory";
import type { Picture } from "./picture";
import { SessionTime } from "./session_time";
import { disposeSprite, inLines, Sprites, textSprite, type Text } from "./sprites";
import { HeadsetInput } from "./headset_input";

/** A press that lasts longer skips a position, or starts the alignment again, ms. */
const HOLD_MS = 1500;
/** A pinch moves the finger tip: its mean position in this interval before the pinch counts, ms. */
const BEFORE_PINCH_MS = [200, 500] as const;
/** The same of a hand that points, which may have moved until then, ms. */
const BEFORE_PRESS_MS = [200, 250] as const;
/** Greatest age of a position that counts if there is none in that interval, ms. */
const MAX_TIP_AGE_MS = 1000;
/** Maximum number of positions of a finger tip that are kept; enough for that interval at 120 Hz. */
const MAX_TIPS = 64;
/** Size of the note in that of a label: its letters are at least 0.6° high. */
export const NOTE_SCALE = 1.4;
/** The note begins so far above the gaze, at 1 m. */
const NOTE_ABOVE_M = 0.09;
/** Time for which a result is shown, ms. */
const RESULT_MS = 12_000;

interface Press {
  /** Time of the session, ms. */
  readonly began: number;
  /** The same by the page's clock, ms. */
  readonly since: number;
  /** In the session's space, levelled; null: not tracked. */
  readonly at: Vec3 | null;
}

export class Immersive implements Immersion {
  private session: XRSession | null = null;
  private isEntering = false;
  private viewer: XRReferenceSpace | null = null;
  private alignment: Alignment | null = null;
  private landmarks: readonly Landmark[] = [];
  private mapName = "";
  /** Index of the landmark to touch now. */
  private next = 0;
  /** Last step of the wearer that was shown. */
  private step = "";
  private touches: Touch[] = [];
  private anchor: { readonly anchor: XRAnchor; readonly kept: KeptAnchor } | null = null;
  /** Position of a new anchor, {W}; null: none is wanted. */
  private anchored: Vec3 | null = null;
  private readonly time = new SessionTime();
  private readonly presses = new Map<XRInputSource, Press>();
  private readonly tips = new Map<XRInputSource, [time: number, at: Vec3][]>();
  private note: THREE.Sprite | null = null;
  /** Eyes of the wearer, {W}; null: not known. */
  viewerAt: Vec3 | null = null;
  /** What the wearer reads before the eyes, or "". */
  noteText = "";
  private noteUntil = Infinity;
  /** The session's space in {W}: all that is drawn stays where it is. */
  private readonly rig = new THREE.Group();
  private readonly eye = new THREE.PerspectiveCamera(42, 1, 0.05, 200);
  private readonly sprites: Sprites;
  private readonly input: HeadsetInput;
  private theme: Theme | null = null;

  /** @param map returns the current map. @param draw draws a frame of the scene. @param arm what the wearer may move. @param changed called when a session has begun or ended. */
  constructor(
    private readonly picture: Picture,
    private readonly map: () => Environment,
    private readonly draw: () => void,
    private readonly arm: Arm,
    private readonly changed: () => void,
  ) {
    this.rig.rotation.order = "ZYX";
    this.rig.add(this.eye);
    this.sprites = new Sprites(picture.scene);
    this.input = new HeadsetInput(arm);
  }

  get isActive(): boolean {
    return this.picture.isImmersed;
  }

  get isAligned(): boolean {
    return this.alignment !== null;
  }

  async isSupported(): Promise<boolean> {
    try {
      return (await navigator.xr?.isSessionSupported("immersive-ar")) ?? false;
    } catch {
      return false; // a policy forbids it, or the browser has a draft of WebXR only
    }
  }

  /** @throws Error with one sentence if no session can begin. */
  async enter(turn: () => void): Promise<void> {
    if (this.session || this.isEntering) return;
    if (!canAlign(landmarksOf(this.map())))
      throw new Error(
        "The map has no two lamps or things at least 0.5 m apart, by which it could be aligned with your room: add them in the map.",
      );
    this.isEntering = true;
    try {
      const session = await navigator.xr!.requestSession("immersive-ar", {
        requiredFeatures: ["local-floor"],
        optionalFeatures: ["hand-tracking", "anchors"],
      });
      this.session = session;
      session.addEventListener("selectstart", (event) => this.press(event));
      session.addEventListener("selectend", ({ inputSource }) => this.release(inputSource));
      try {
        this.picture.scene.add(this.rig);
        this.viewer = await session.requestReferenceSpace("viewer");
        await this.picture.immerse(
          session,
          this.eye,
          (frame) => {
            turn();
            this.update(frame);
            this.draw();
          },
          () => {
            this.end();
            turn(); // the page's frame that it awaits may have been refused for good
          },
        );
      } catch (error) {
        await session.end().catch(() => undefined);
        this.session = null;
        throw error;
      }
      this.space.addEventListener("reset", ({ transform }) => this.reset(transform));
      this.restart();
      this.changed();
      await this.restore(session);
    } catch (error) {
      throw new Error(entryError(error));
    } finally {
      this.isEntering = false;
    }
  }

  leave(): void {
    void this.session?.end().catch(() => undefined);
  }

  tell(sentence: string): void {
    if (this.session) this.say(`${sentence}${this.invitation}`, RESULT_MS);
  }

  /** Show the wearer's next step for a while, once until it is another one. */
  tellStep(step: string): void {
    if (!this.session || !this.isAligned || step === this.step) return;
    if (this.noteText && this.time.ms <= this.noteUntil) return; // another note is before the eyes: afterwards
    this.step = step;
    this.say(step, RESULT_MS);
  }

  /** Show texts in the session, and a note before the eyes. */
  show(texts: readonly Text[], theme: Theme): void {
    this.theme = theme;
    this.sprites.show(this.isAligned ? texts : [], theme);
  }

  private get space(): XRReferenceSpace {
    return this.picture.sessionSpace!;
  }

  private end(): void {
    this.session = null;
    this.alignment = null;
    this.anchor = this.viewerAt = null;
    this.arm.give();
    this.presses.clear();
    this.tips.clear();
    this.say("");
    this.rig.removeFromParent();
    this.sprites.clear();
    this.changed();
  }

  /** Ask for the touches, from the first on. @param reason why, or "". */
  private restart(reason = ""): void {
    const map = this.map();
    this.mapName = map.name;
    this.landmarks = landmarksOf(map);
    this.alignment = this.anchor = this.anchored = null;
    this.touches = [];
    this.next = 0;
    this.arm.give();
    this.ask(reason);
  }

  private ask(reason = ""): void {
    const landmark = this.landmarks[this.next];
    this.say(
      landmark
        ? `${reason} Touch ${landmark.name} (${this.touches.length + 1} of ${Math.min(TOUCHES, this.landmarks.length)}) with the tip of your controller, your index finger or your phone, and press the trigger, pinch or tap. A press of 1.5 s skips it.`
        : "The map has nothing to touch by which it could be aligned with your room.",
    );
  }

  private update(frame: XRFrame): void {
    const now = performance.now();
    this.time.advance(now);
    if (this.map().name !== this.mapName) this.restart("The map has changed.");
    for (const source of this.session?.inputSources ?? []) {
      const tip = source.hand && this.tip(frame, source);
      if (!tip) continue;
      this.tips.set(source, [...(this.tips.get(source) ?? []).slice(-MAX_TIPS), [now, tip]]);
    }
    this.follow(frame);
    if (this.alignment) {
      const head = frame.getViewerPose(this.space);
      this.viewerAt = head
        ? add(this.alignment.origin, turn(leveled(head.transform.position), this.alignment.yaw))
        : null;
      if (head)
        this.input.update(
          now,
          this.session?.inputSources ?? [],
          this.presses,
          leveled(head.transform.position),
          (source) => this.tip(frame, source),
          this.alignment,
        );
      this.rig.position.set(...(this.alignment.origin as Vec3));
      this.rig.rotation.set(Math.PI / 2, 0, this.alignment.yaw);
    }
    if (this.time.ms > this.noteUntil) this.say("");
    if (!this.note && this.noteText && this.theme) {
      this.note = textSprite(inLines(this.noteText), this.theme);
      this.note.scale.multiplyScalar(NOTE_SCALE);
      this.note.center.set(0.5, 0); // above the gaze: what the wearer points at is seen
      this.note.position.set(0, NOTE_ABOVE_M, -1);
      this.note.renderOrder += 1;
      this.eye.add(this.note);
    }
  }

  /** Correct the alignment by its anchor; create the anchor that is wanted. */
  private follow(frame: XRFrame): void {
    const { anchored, alignment } = this;
    if (anchored && alignment && frame.createAnchor) {
      this.anchored = null;
      void this.place(frame, anchored, alignment);
    }
    const pose =
      this.anchor && frame.trackedAnchors?.has(this.anchor.anchor)
        ? frame.getPose(this.anchor.anchor.anchorSpace, this.space)
        : null;
    if (!pose || !this.anchor) return;
    if (!alignment)
      this.say(
        `The alignment of your last visit is used. Check that the names stand at their things. A press of 1.5 s starts a new alignment.${this.invitation}`,
        RESULT_MS,
      );
    const { at, yaw } = this.anchor.kept;
    this.alignment = alignmentFrom(
      at,
      yaw,
      leveled(pose.transform.position),
      headingOf(pose.transform.orientation),
    );
  }

  private async place(frame: XRFrame, at: Vec3, { yaw, origin }: Alignment): Promise<void> {
    const { mapName } = this;
    const [x, y, z] = turn(subtract(at, origin), -yaw);
    try {
      const anchor = await frame.createAnchor!(new XRRigidTransform({ x, y: z, z: -y }), this.space);
      if (!anchor || this.mapName !== mapName || !this.alignment) return;
      this.anchor = { anchor, kept: { map: mapName, handle: "", at, yaw } };
      const handle = await anchor.requestPersistentHandle?.();
      if (!handle) return;
      const former = keptAnchor();
      keepAnchor({ map: mapName, handle, at, yaw });
      if (former) await frame.session.deletePersistentAnchor?.(former.handle); // a headset keeps a few of each site only
    } catch {
      // without an anchor the alignment lasts as long as the session
    }
  }

  /** Take over the alignment of an earlier session, if the headset still knows its anchor. */
  private async restore(session: XRSession): Promise<void> {
    const kept = keptAnchor();
    if (kept?.map !== this.mapName || !session.restorePersistentAnchor) return;
    try {
      const anchor = await session.restorePersistentAnchor(kept.handle);
      if (this.mapName !== kept.map || this.touches.length) return;
      this.anchor = { anchor, kept };
    } catch {
      keepAnchor(null);
    }
  }

  /** The session's space has another origin from now on, e.g. since the wearer recentred the view. */
  private reset(transform: XRRigidTransform | undefined): void {
    const { anchor } = this;
    if (anchor && this.alignment) return; // the anchor corrects it
    if (!this.alignment || !transform) {
      this.restart("The headset has a new origin.");
      this.anchor = anchor; // which may be tracked later
    } else
      this.alignment = reoriented(
        this.alignment,
        leveled(transform.position),
        headingOf(transform.orientation),
      );
  }

  private press({ frame, inputSource }: XRInputSourceEvent): void {
    this.presses.set(inputSource, {
      began: this.time.ms,
      since: performance.now(),
      at: this.touched(frame, inputSource),
    });
  }

  private release(source: XRInputSource): void {
    const press = this.presses.get(source);
    const landmark = this.landmarks[this.next];
    this.presses.delete(source);
    if (!press) return;
    const isLong = this.time.ms - press.began > HOLD_MS;
    if (this.alignment) {
      if (isLong) this.restart();
      else void this.point(source, performance.now() - press.since);
      return;
    }
    if (!landmark) return;
    if (!isLong && !press.at)
      return this.ask("Your hand or controller is not tracked: hold it where the headset sees it.");
    this.next++;
    if (!isLong) this.touches.push({ ...landmark, touched: press.at! });
    if (this.touches.length === TOUCHES || (this.next === this.landmarks.length && this.touches.length > 1))
      this.align();
    else if (this.next === this.landmarks.length) this.restart("Two positions are needed.");
    else this.ask();
  }

  /** A short press of the aligned wearer: it is the person's button, or begins to point. */
  private async point({ handedness }: XRInputSource, heldMs: number): Promise<void> {
    const { arm } = this;
    const { user } = arm;
    if (!user || handedness === "none") return;
    this.input.hand = handedness;
    const isBeginning = !arm.pointing;
    const problem = await (isBeginning ? arm.take() : arm.press(heldMs));
    if (isBeginning && !this.alignment) return arm.give(); // the wearer has left, or aligns again
    if (problem) this.say(problem, RESULT_MS);
    else if (isBeginning)
      this.say(
        `You point as ${user}: look over your finger or the tip of the controller. A press is the button, the thumbstick goes to the thing beside. A press of 1.5 s ends it and aligns again.`,
        RESULT_MS,
      );
  }

  /** On a phone, whose taps have no hand, a press does nothing. */
  private get invitation(): string {
    const { session } = this;
    const isPhone =
      session?.interactionMode === "screen-space" ||
      [...(session?.inputSources ?? [])].some(({ handedness }) => handedness === "none");
    return isPhone || !this.arm.user ? "" : ` Press to point as ${this.arm.user}.`;
  }

  private align(): void {
    const { alignment, residual_m, fault, caution } = assess(this.touches);
    if (fault) return this.restart(fault);
    this.alignment = alignment;
    this.anchor = null;
    this.anchored = scale(
      this.touches.reduce<Vec3>((sum, { at }) => add(sum, at), [0, 0, 0]),
      1 / this.touches.length,
    );
    this.say(
      `Aligned: your touches agree with the map within ${Math.max(0.1, 100 * residual_m).toFixed(1)} cm. ${caution} An error that all touches share does not show: check that the names stand at their things. A press of 1.5 s starts again.${this.invitation}`,
      RESULT_MS,
    );
  }

  /** Position that `source` touched before it was pressed, levelled; null: it is not tracked. */
  private touched(frame: XRFrame, source: XRInputSource): Vec3 | null {
    const now = performance.now();
    const [least, most] = this.alignment ? BEFORE_PRESS_MS : BEFORE_PINCH_MS;
    const before = (this.tips.get(source) ?? []).filter(
      ([time]) => now - time >= least && now - time <= MAX_TIP_AGE_MS,
    );
    const counted = before
      .filter(([time], i) => now - time <= most || i === before.length - 1)
      .map(([, at]) => at);
    return counted.length
      ? scale(
          counted.reduce((sum, at) => add(sum, at)),
          1 / counted.length,
        )
      : this.tip(frame, source);
  }

  /** Position of the tip of a hand, controller or phone now, levelled; null: it is not tracked. */
  private tip(frame: XRFrame, { hand, targetRayMode, targetRaySpace }: XRInputSource): Vec3 | null {
    const joint = hand?.get("index-finger-tip");
    const space = targetRayMode === "tracked-pointer" ? targetRaySpace : this.viewer!;
    const pose = hand ? joint && frame.getJointPose?.(joint, this.space) : frame.getPose(space, this.space);
    return pose ? leveled(pose.transform.position) : null; // `emulatedPosition` is true of some tracked controllers, too
  }

  private say(text: string, forMs = Infinity): void {
    this.noteUntil = this.time.ms + forMs;
    if (text.trim() === this.noteText) return;
    this.noteText = text.trim();
    if (this.note) disposeSprite(this.note);
    this.note = null;
  }
}

function entryError(error: unknown): string {
  const name = error instanceof DOMException ? error.name : "";
  if (name === "SecurityError" || name === "NotAllowedError")
    return "The browser did not allow this page to show your room: allow it in the settings of the site, then try again.";
  if (name === "NotSupportedError")
    return "This device does not know where its floor is, which the room needs: set up its boundary, then try again.";
  return `Your room could not be shown: ${error instanceof Error ? error.message : String(error)}`;
}
