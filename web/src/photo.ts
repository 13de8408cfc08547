// Images as files: how large they are, by their heads, and their pixels.

/** Segments of a JPEG file in which its size is looked for. */
const MOST_SEGMENTS = 256;

export interface Size {
  width: number;
  height: number;
}

/** Reads so many bytes of a file. */
async function view(file: Blob, from: number, bytes: number): Promise<DataView> {
  return new DataView(await file.slice(from, from + bytes).arrayBuffer());
}

interface Segment {
  marker: number;
  at: number;
  end: number;
}

/** The segments of a JPEG file up to its first frame, which is the last of them; none of another file. */
async function segmentsOf(file: Blob): Promise<Segment[]> {
  const found: Segment[] = [];
  const head = await view(file, 0, 2);
  if (head.byteLength < 2 || head.getUint16(0) !== 0xffd8) return found;
  for (let at = 2; found.length < MOST_SEGMENTS;) {
    const part = await view(file, at, 4);
    if (part.byteLength < 4 || part.getUint8(0) !== 0xff) return [];
    const marker = part.getUint8(1);
    // a marker may be filled up before
    const end = at + (marker === 0xff ? 1 : 2 + part.getUint16(2));
    found.push({ marker, at, end });
    // frames of all processes; C4, C8 and CC are tables
    if (marker >= 0xc0 && marker <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(marker)) return found;
    at = end;
  }
  return [];
}

/** The size of a PNG or JPEG file; null where its head has none. */
export async function sizeOf(file: Blob): Promise<Size | null> {
  const head = await view(file, 0, 24);
  if (head.byteLength === 24 && head.getUint32(0) === 0x89504e47)
    return { width: head.getUint32(16), height: head.getUint32(20) };
  const frame = (await segmentsOf(file)).at(-1);
  const part = frame && (await view(file, frame.at, 9));
  return part?.byteLength === 9 ? { width: part.getUint16(7), height: part.getUint16(5) } : null;
}

/** The pixels of an image in the order of the file, which labels have: without the tags by which browsers turn it. */
export async function pixelsOf(file: Blob): Promise<ImageBitmap> {
  const kept: Blob[] = [];
  let from = 0;
  for (const { marker, at, end } of await segmentsOf(file)) {
    if (marker !== 0xe1) continue;
    kept.push(file.slice(from, at));
    from = end;
  }
  return await createImageBitmap(new Blob([...kept, file.slice(from)]));
}

/** The bytes of an image. */
export function dataOf(image: ImageBitmap): ImageData {
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
  if (!context) throw new Error("the browser has no canvas");
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height);
}

/** Superpixels where no number is given: of some 1,000 pixels, 250 at most. */
export const usualNumber = ({ width, height }: Size): number =>
  Math.min(Math.max(2, Math.round((width * height) / 1000)), 250);
