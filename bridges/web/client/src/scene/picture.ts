/** The picture itself: WebGL, its size, how much can be asked of it, light and shadow. */

import * as THREE from "three";
import type { Bounds } from "../geometry/bounds";
import type { Theme } from "./mesh_factory";

THREE.Object3D.DEFAULT_UP.set(0, 0, 1);

const SOFTWARE = /SwiftShader|llvmpipe|softpipe|Software|Basic Render/i;
const SOFTWARE_RATIO = 0.8;
const LEAST_RATIO = 0.35;
/** Slower than this for `PATIENCE_MS`: fewer pixels. */
const TOO_SLOW_FPS = 12;
/** The same with a graphics processor. */
const TOO_SLOW_GPU_FPS = 24;
const PATIENCE_MS = 3000;
/** A context that does not come back in this time is lost for good. */
const LOST_MS = 5000;

/** What draws here, as WebGL names it. @throws Error when there is no WebGL. */
function probedRenderer(): string {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) throw new Error("This browser draws no 3-D pictures: WebGL 2 is missing or switched off.");
  const detail = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(detail ? detail.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/** What may become of the graphics context. */
export interface PictureEvents {
  /** It is gone: whatever it held must be let go. */
  away(): void;
  /** It is there again, and empty. */
  back(): void;
  /** It does not come back. */
  lost(): void;
}

/** Renderer, scene, camera. */
export class Picture {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(42, 1, 0.1, 200);
  readonly stats: { fps: number; renderer: string; software: boolean };
  readonly canvas: HTMLCanvasElement;
  /** There is no context to draw with, for now. */
  isLost = false;
  width = 1;
  height = 1;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly sky = new THREE.HemisphereLight(0xffffff, 0x777777, 1);
  private readonly sun = new THREE.DirectionalLight(0xffffff, 1);
  private readonly observer: ResizeObserver;
  private ratio: number;
  private readonly fog = new THREE.Fog(0);
  private readonly background = new THREE.Color();
  /** Camera of the session's views. */
  private eye: THREE.PerspectiveCamera | null = null;
  private radius = 5;
  private frames: number[] = [];
  private slowSince = 0;
  private lostTimer = 0;

  constructor(
    private readonly host: HTMLElement,
    private readonly changed: () => void,
    on: PictureEvents,
  ) {
    const name = probedRenderer();
    const software = SOFTWARE.test(name);
    this.stats = { fps: 0, renderer: name, software };
    try {
      this.renderer = new THREE.WebGLRenderer({ antialias: !software, powerPreference: "high-performance" });
    } catch {
      throw new Error("This browser could not start its 3-D pictures (WebGL).");
    }
    this.canvas = this.renderer.domElement;
    this.canvas.style.display = "block";
    this.canvas.style.touchAction = "none";
    this.canvas.tabIndex = -1;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The room in 3-D; the list below has the same as text");
    this.ratio = software ? SOFTWARE_RATIO : Math.min(devicePixelRatio, 2);
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.shadowMap.enabled = !software;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    if (!software) {
      this.sun.castShadow = true;
      this.sun.shadow.mapSize.set(2048, 2048);
      this.sun.shadow.radius = 4;
      this.sun.shadow.bias = -0.0005;
      this.sun.shadow.normalBias = 0.02;
    }
    this.scene.add(this.sky, this.sun, this.sun.target);
    this.canvas.addEventListener("webglcontextlost", (event) => {
      if (!this.canvas.isConnected) return; // `dispose` loses it too, and is told of it later
      event.preventDefault();
      this.isLost = true;
      on.away();
      this.lostTimer = window.setTimeout(on.lost, LOST_MS);
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.isLost = false;
      window.clearTimeout(this.lostTimer);
      on.back();
    });
    host.append(this.canvas);
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(host);
    this.fit();
  }

  private fit(): void {
    if (this.isImmersed) return;
    this.width = Math.max(this.host.clientWidth, 1);
    this.height = Math.max(this.host.clientHeight, 1);
    this.renderer.setSize(this.width, this.height);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  /** Whether a WebXR session shows the scene. */
  get isImmersed(): boolean {
    return this.renderer.xr.isPresenting;
  }

  /** The session's own space. */
  get sessionSpace(): XRReferenceSpace | null {
    return this.renderer.xr.getReferenceSpace();
  }

  /**
   * Show the scene by `session` until it ends, through `eye`.
   *
   * @param onFrame draws a frame
   * @param onEnd called when the page shows the scene again
   */
  async immerse(
    session: XRSession,
    eye: THREE.PerspectiveCamera,
    onFrame: (frame: XRFrame) => void,
    onEnd: () => void,
  ): Promise<void> {
    const { xr } = this.renderer;
    const end = (): void => {
      xr.removeEventListener("sessionend", end);
      xr.enabled = false;
      this.eye = null;
      this.renderer.setAnimationLoop(null);
      this.renderer.setPixelRatio(this.ratio);
      this.fit();
      onEnd();
    };
    xr.addEventListener("sessionend", end);
    xr.enabled = true;
    xr.setReferenceSpaceType("local-floor");
    this.eye = eye;
    this.renderer.setAnimationLoop((_, frame) => {
      try {
        if (frame && xr.isPresenting) onFrame(frame);
      } catch (error) {
        void session.end(); // no further frame comes
        throw error;
      }
    });
    await xr.setSession(session);
  }

  /** Viewport of an eye in a session, px, or null. */
  private get viewport(): THREE.Vector4 | null {
    return this.isImmersed ? (this.renderer.xr.getCamera().cameras[0]?.viewport ?? null) : null;
  }

  /** Size of the picture, px, as an eye sees it. */
  get size(): readonly [number, number] {
    const { viewport } = this;
    return viewport ? [viewport.z, viewport.w] : [this.width, this.height];
  }

  /** Size, m, of a pixel of the picture 1 m before the camera. */
  get pixel(): number {
    const { viewport } = this;
    if (viewport)
      return 2 / (this.renderer.xr.getCamera().cameras[0]!.projectionMatrix.elements[5]! * viewport.w);
    return (2 * Math.tan((this.camera.fov * Math.PI) / 360)) / this.height;
  }

  /** Matrix from {W} to clip coordinates, of the left eye in a session, 4 x 4 by columns. */
  get lens(): number[] {
    const camera = (this.isImmersed && this.renderer.xr.getCamera().cameras[0]) || this.camera;
    return camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).toArray();
  }

  /** Light a room of this size in this theme. */
  light(theme: Theme, bounds: Bounds): void {
    const { low, high } = bounds;
    const x = (low[0] + high[0]) / 2;
    const y = (low[1] + high[1]) / 2;
    const radius = Math.max(Math.hypot(high[0] - low[0], high[1] - low[1]) / 2 + 1.5, 3);
    this.background.set(theme.background);
    this.fog.color.copy(this.background);
    this.radius = radius;
    this.sky.color.set(theme.dark ? 0xcfdcf0 : 0xffffff);
    this.sky.groundColor.set(theme.dark ? 0x3a3f47 : 0xa7a9ad);
    this.sky.intensity = theme.dark ? 1.6 : 2.1;
    this.sun.intensity = theme.dark ? 1.9 : 1.7;
    this.sun.target.position.set(x, y, 0.8);
    this.sun.position.set(x + 0.35 * radius, y - 0.5 * radius, 1.25 * radius + 2);
    const eye = this.sun.shadow.camera;
    eye.left = eye.bottom = -radius;
    eye.right = eye.top = radius;
    eye.near = 0.5;
    eye.far = 4 * radius + 6;
    eye.updateProjectionMatrix();
    this.camera.far = radius * 12 + 60;
    this.camera.updateProjectionMatrix();
  }

  /**
   * Draw.
   *
   * @param busy the next frame is wanted at once, so that the time between them tells how fast it goes
   * @param distance to what is looked at, m
   */
  render(now: number, busy: boolean, distance: number): void {
    if (this.isLost) return;
    // beyond what is looked at, wherever from
    this.fog.near = distance + 1.4 * this.radius + 3;
    this.fog.far = distance + 4 * this.radius + 14;
    const { isImmersed } = this; // then the room is the background
    this.scene.background = isImmersed ? null : this.background;
    this.scene.fog = isImmersed ? null : this.fog;
    this.renderer.render(this.scene, (isImmersed && this.eye) || this.camera);
    this.frames.push(now);
    this.measure(now);
    if (!isImmersed) this.adapt(now, busy);
  }

  /** Keep the figures true, also when nothing is drawn. */
  measure(now: number): void {
    while (this.frames.length && this.frames[0]! < now - 1000) this.frames.shift();
    this.stats.fps = this.frames.length;
  }

  /** Ask less of a machine that is too slow for a while: first no shadows, then fewer pixels, step by step. */
  private adapt(now: number, busy: boolean): void {
    if (
      !busy ||
      this.stats.fps >= (this.stats.software ? TOO_SLOW_FPS : TOO_SLOW_GPU_FPS) ||
      document.hidden
    ) {
      this.slowSince = now;
      return;
    }
    if (now - this.slowSince < PATIENCE_MS) return;
    this.slowSince = now;
    if (this.sun.castShadow) this.sun.castShadow = false;
    else if (this.ratio > LEAST_RATIO) {
      this.ratio = Math.max(this.ratio * 0.8, LEAST_RATIO);
      this.renderer.setPixelRatio(this.ratio);
    }
  }

  dispose(): void {
    this.observer.disconnect();
    window.clearTimeout(this.lostTimer);
    this.sun.shadow.map?.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }
}
