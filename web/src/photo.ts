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

/** The size of a PNG or JPEG file; null where its head has none. */
export async function sizeOf(file: Blob): Promise<Size | null> {
  const head = await view(file, 0, 24);
  if (head.byteLength < 24) return null;
  if (head.getUint32(0) === 0x89504e47) return { width: head.getUint32(16), height: head.getUint32(20) };
  if (head.getUint16(0) !== 0xffd8) return null;
  for (let at = 2, segment = 0; segment < MOST_SEGMENTS; segment++) {
    const part = await view(file, at, 9);
    if (part.byteLength < 9 || part.getUint8(0) !== 0xff) return null;
    const marker = part.getUint8(1);
    // frames of all processes; C4, C8 and CC are tables
    if (marker >= 0xc0 && marker <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(marker))
      return { width: part.getUint16(7), height: part.getUint16(5) };
    // a marker may be filled up before
    at += marker === 0xff ? 1 : 2 + part.getUint16(2);
  }
  return null;
}

/** The pixels of an image in the order of the file, which labels have: no tag turns them. */
export const pixelsOf = (file: Blob): Promise<ImageBitmap> => createImageBitmap(file, { imageOrientation: "none" });

/** Superpixels where no number is given: of some 1,000 pixels, as long as these are few. */
export const usualNumber = ({ width, height }: Size): number =>
  Math.min(Math.max(2, Math.round((width * height) / 1000)), 250);
