// What a pointer does over the canvas, besides turning the mesh.

interface Listener {
  /** A press and a release at one place; a drag turns the mesh. */
  click(x: number, y: number, withShift: boolean): void;
  /** At most once a frame. */
  hover(x: number, y: number): void;
  leave(): void;
}

/** Pixels up to which a press and a release are at one place. */
const NEAR = 4;

export function listen(canvas: HTMLCanvasElement, listener: Listener): void {
  let [x, y, hovering] = [0, 0, 0];
  canvas.addEventListener("pointerdown", (event) => ([x, y] = [event.offsetX, event.offsetY]));
  canvas.addEventListener("pointerup", (event) => {
    const moved = Math.hypot(event.offsetX - x, event.offsetY - y);
    if (event.button === 0 && moved < NEAR) listener.click(event.offsetX, event.offsetY, event.shiftKey);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons > 0 || event.pointerType !== "mouse") return;
    const { offsetX, offsetY } = event;
    cancelAnimationFrame(hovering);
    hovering = requestAnimationFrame(() => listener.hover(offsetX, offsetY));
  });
  canvas.addEventListener("pointerleave", () => {
    cancelAnimationFrame(hovering);
    listener.leave();
  });
}
