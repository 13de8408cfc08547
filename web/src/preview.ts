// A file as it was dropped, in grey, to look at while the service works on it. No label depends on what is read here.

import { Mesh, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { PLYLoader } from "three/addons/loaders/PLYLoader.js";
import { STLLoader } from "three/addons/loaders/STLLoader.js";

import { count } from "./dom";
import { geometry } from "./gltf";
import { obj } from "./obj";
import { off } from "./off";
import type { Triangles } from "./drawable";
import { weld } from "./weld";

/** Triangles above which nothing is shown before the mesh is clustered. */
const MOST_TRIANGLES = 5_000_000;

/** Triangles up to which clusters of a running job are shown, and neighbours among them are wanted. */
const MOST_RUNNING = 300_000;

/** Bytes above which a file is not read as a whole. */
const MOST_BYTES = 1e9;

/** The triangles of a mesh and the files that belong to it, or an error that says why they cannot be shown. */
export async function preview(files: File[]): Promise<Triangles> {
  const file = files[0] ?? new File([], "");
  try {
    const positions = await read(file, files);
    if (positions.length === 0) throw new Error("it has no triangles");
    const corners = positions.length <= 9 * MOST_RUNNING ? weld(positions) : null;
    return { positions, centre: new Vector3(), faces: null, corners };
  } catch (error) {
    // what arrays say that are too large
    if (error instanceof RangeError) throw new Error(`it has more than ${count(MOST_TRIANGLES)} triangles`);
    throw error;
  }
}

async function read(file: File, files: File[]): Promise<Float32Array> {
  const kind = /[^.]*$/.exec(file.name)?.[0].toLowerCase();
  if (kind === "obj") return await obj(file, MOST_TRIANGLES);
  if (file.size > MOST_BYTES) throw new Error("it is above 1 GB");
  if (kind === "glb" || kind === "gltf") return await ofScene(files);
  if (kind === "off") return off(await file.text(), MOST_TRIANGLES);
  if (kind === "ply" || kind === "stl") {
    const loader = kind === "ply" ? new PLYLoader() : new STLLoader();
    return joined([new Mesh(loader.parse(await file.arrayBuffer()))]);
  }
  throw new Error("its name has no extension that the page knows");
}

async function ofScene(files: File[]): Promise<Float32Array> {
  const { text, addresses } = await geometry(files);
  try {
    const { scene } = await new GLTFLoader().parseAsync(text, "");
    scene.updateMatrixWorld(true);
    const meshes: Mesh[] = [];
    scene.traverse((object) => {
      if ("isMesh" in object) meshes.push(object as Mesh);
    });
    return joined(meshes);
  } finally {
    addresses.forEach((address) => URL.revokeObjectURL(address));
  }
}

/** The triangles of all meshes, in the places where they are. */
function joined(meshes: Mesh[]): Float32Array {
  const corners = ({ geometry }: Mesh): number => geometry.index?.count ?? geometry.getAttribute("position").count;
  const total = meshes.reduce((sum, mesh) => sum + 3 * Math.floor(corners(mesh) / 3), 0);
  if (total > 3 * MOST_TRIANGLES) throw new RangeError();
  const positions = new Float32Array(3 * total);
  const place = new Vector3();
  let at = 0;
  for (const mesh of meshes) {
    const { index } = mesh.geometry;
    const attribute = mesh.geometry.getAttribute("position");
    const end = 3 * Math.floor(corners(mesh) / 3);
    for (let i = 0; i < end; i++, at += 3) {
      place.fromBufferAttribute(attribute, index ? index.getX(i) : i).applyMatrix4(mesh.matrixWorld);
      place.toArray(positions, at);
    }
  }
  return positions;
}
