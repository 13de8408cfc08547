// Small pictures of jobs that were shown, for the list; they are gone with the page.

const SIDE = 88;

const pictures = new Map<string, string>();

/** Keeps the middle of a canvas that was drawn just now, as the picture of a job. */
export function keepThumbnail(job: string, canvas: HTMLCanvasElement): void {
  const small = document.createElement("canvas");
  small.width = small.height = SIDE;
  const side = Math.min(canvas.width, canvas.height);
  const [x, y] = [(canvas.width - side) / 2, (canvas.height - side) / 2];
  small.getContext("2d")?.drawImage(canvas, x, y, side, side, 0, 0, SIDE, SIDE);
  pictures.set(job, small.toDataURL());
}

export const thumbnail = (job: string): string | undefined => pictures.get(job);
