// A file as it was dropped, in grey, to look at while the service works on it. three.js reads it; no label depends on
// that.

import { type Mesh, type Object3D, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { OBJLoader } from "three/addons/loaders/OBJLoader.js";

import type { Triangles } from "./view";

/** Bytes above which a file is not read: that would keep the page from answering for seconds. */
const MOST_BYTES = 30e6;

export async function preview(file: File): Promise<Triangles | null> {
  const root = file.size > MOST_BYTES ? null : await read(file);
  if (!root) return null;
  root.updateMatrixWorld(true);
  const parts: Float32Array[] = [];
  root.traverse((object) => {
    if (!("isMesh" in object)) return;
    const { geometry, matrixWorld } = object as Mesh;
    const flat = geometry.index ? geometry.toNonIndexed() : geometry;
    parts.push(new Float32Array(flat.applyMatrix4(matrixWorld).getAttribute("position").array));
  });
  const positions = new Float32Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    positions.set(part, at);
    at += part.length;
  }
  return at === 0 ? null : { positions, centre: new Vector3(), faces: null };
}

async function read(file: File): Promise<Object3D | null> {
  if (/\.glb$/i.test(file.name)) return (await new GLTFLoader().parseAsync(await file.arrayBuffer(), "")).scene;
  if (/\.obj$/i.test(file.name)) return new OBJLoader().parse(await file.text());
  return null;
}
