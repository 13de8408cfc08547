// What the service takes, looked at before anything is sent.

import { json } from "./api";
import { count, size } from "./dom";
import { isImage } from "./kinds";
import { sizeOf } from "./photo";

interface Limits {
  max_upload_bytes: number;
  max_faces: number;
}

/** Bytes of a file in which the number of its faces is looked for. */
const HEAD = 4096;

/** Bytes above which the faces of an OBJ file are not counted. */
const MOST_BYTES = 3e7;

/** Bytes before the triangles of a binary STL file, and of each. */
const [BEFORE, TRIANGLE] = [84, 50];

/** Why a mesh with what belongs to it, or an image, will be refused; empty where nothing is known against it. */
export async function refusalOf(files: File[]): Promise<string> {
  // a service that does not say takes the mesh, or refuses it itself
  const limits = await json<Limits>("/v1/limits").catch(() => null);
  const [mesh] = files;
  const empty = files.find((file) => file.size === 0);
  if (empty) return `${empty.name} is empty.`;
  if (!limits || !mesh) return "";
  const bytes = files.reduce((sum, file) => sum + file.size, 0);
  if (bytes > limits.max_upload_bytes)
    return `${mesh.name} has ${size(bytes)}. This service takes ${size(limits.max_upload_bytes)} at most.`;
  const { width = 0, height = 0 } = (isImage(mesh.name) && (await sizeOf(mesh))) || {};
  if (width * height > limits.max_faces)
    return `${mesh.name} has ${count(width * height)} pixels. This service clusters ${count(limits.max_faces)} at most.`;
  const faces = await facesOf(mesh);
  if (faces > limits.max_faces)
    return `${mesh.name} has ${count(faces)} faces. This service clusters ${count(limits.max_faces)} at most.`;
  return "";
}

/** Why a mesh has fewer faces than clusters are wanted; empty where its faces are not known. */
export async function refusalOfClusters(mesh: File, clusters: number): Promise<string> {
  // `send` reports an unreadable file
  const faces = await facesOf(mesh).then(
    (found) => found || rowsOf(mesh),
    () => 0,
  );
  const many = faces > 0 && clusters > faces;
  return many
    ? `${mesh.name} has ${faces === 1 ? "1 face" : `${count(faces)} faces`}, and there are at most as many clusters.`
    : "";
}

/** The faces of an OBJ file that is not large; 0 of any other. */
async function rowsOf(file: File): Promise<number> {
  if (!/\.obj$/i.test(file.name) || file.size > MOST_BYTES) return 0;
  return (await file.text()).match(/^[ \t]*f[ \t]/gm)?.length ?? 0;
}

/** The faces that the head of a file names; 0 where it names none. */
async function facesOf(file: File): Promise<number> {
  const head = await file.slice(0, HEAD).arrayBuffer();
  const text = new TextDecoder("latin1").decode(head);
  if (/\.ply$/i.test(file.name)) return Number(/^element\s+face\s+(\d+)/m.exec(text)?.[1] ?? 0);
  if (/\.off$/i.test(file.name)) return Number(/^\s*\S*OFF\s+(?:#.*\s+)*\d+\s+(\d+)/.exec(text)?.[1] ?? 0);
  if (!/\.stl$/i.test(file.name) || head.byteLength < BEFORE) return 0;
  const triangles = new DataView(head).getUint32(BEFORE - 4, true);
  return file.size === BEFORE + TRIANGLE * triangles ? triangles : 0;
}
