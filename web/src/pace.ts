// How finely a frame is drawn. At rest it is as fine as the screen; the first frame is drawn as one of a move. Where
// frames take long, as with a software renderer, a move of the camera draws a coarse mesh, and other labels are drawn
// in fewer pixels.

/** Triangles up to which the picture at rest has four samples a pixel. */
const MOST_SMOOTHED = 500_000;

/** Time of a frame above which a coarse mesh is drawn while the camera moves, in milliseconds. */
const SLOW = 60;

/** Triangles above which there is a coarse mesh. */
const MANY = 100_000;

/** Time of a frame up to which there are four samples a pixel in moves too, in milliseconds. */
const QUICK = 10;

/** Time of a frame up to which other labels are drawn in all pixels, in milliseconds. */
const EASY = 10;

export class Pace {
  isResting = true;
  isMoving = false;
  /** Milliseconds of a frame in a move; null until one was measured. */
  moved: number | null = null;
  /** Milliseconds of a frame with other labels in all pixels. */
  private relabelled: number | null = null;

  constructor(
    private readonly triangles: number,
    private readonly ratio: number,
  ) {}

  get isQuick(): boolean {
    return this.moved !== null && this.moved <= QUICK;
  }

  get isCoarse(): boolean {
    return this.isMoving && (this.moved ?? 0) > SLOW && this.triangles > MANY;
  }

  /** Samples of what is seen along a pixel of the screen. */
  get finer(): number {
    const isFine = this.triangles <= MOST_SMOOTHED && this.ratio < 2;
    return isFine && (!this.isMoving || this.isQuick) ? 2 : 1;
  }

  /**
   * Pixels of the screen along one of the canvas. With two, the first visit has 41 to 49 frames a second for 55 to 60
   * (SwiftShader, two cores).
   */
  get shrink(): number {
    return !this.isResting && !this.isMoving && (this.relabelled ?? 0) > EASY ? 3 : 1;
  }

  /** Samples of what is seen along a pixel of the canvas, of those there are. */
  get samples(): number {
    return this.isResting || this.isQuick ? this.finer : 1;
  }

  /** Differs between frames that are not equally fine. */
  get quality(): string {
    return [this.isCoarse, this.finer, this.shrink, this.samples].join();
  }

  /** Whether the time of the next frame is to be measured. */
  get isTimed(): boolean {
    return !this.isResting && (this.isMoving ? this.moved : this.relabelled) === null;
  }

  /** Takes the time until what was drawn since is there: a pixel can be read only then. */
  time(gl: WebGLRenderingContext | WebGL2RenderingContext, began: number): void {
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    const milliseconds = performance.now() - began;
    if (this.isMoving) this.moved = milliseconds;
    else this.relabelled = milliseconds;
  }
}
