// GLB files of the service as triangles and edges, and the sharp edges of triangles.

import { BufferAttribute, BufferGeometry, EdgesGeometry, type Mesh, Vector3, WireframeGeometry } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

import type { Triangles } from "./drawable";

/** The mesh of a job: `mesh?format=glb&colours=none`. */
export async function triangles(bytes: ArrayBuffer): Promise<Triangles> {
  const { geometry, centre, view } = await load(bytes);
  const indexed = geometry.getAttribute("position").array;
  const index = geometry.getIndex();
  if (!index) return { positions: indexed as Float32Array, centre, faces: null, corners: null };
  const corners = new Uint32Array(index.array);
  const positions = new Float32Array(3 * corners.length);
  for (let i = 0; i < corners.length; i++) {
    const from = 3 * (corners[i] ?? 0);
    for (let axis = 0; axis < 3; axis++) positions[3 * i + axis] = indexed[from + axis] ?? 0;
  }
  return { positions, centre, faces: view && new Uint32Array(view), corners };
}

/** The edges of a remesh as segments. */
export async function edges(bytes: ArrayBuffer): Promise<Edges> {
  const { geometry, centre } = await load(bytes);
  return { segments: new WireframeGeometry(geometry).getAttribute("position").array as Float32Array, centre };
}

/** Edges at which the surface bends by more than an angle in degrees, or ends. */
export function sharpEdges({ positions, centre }: Triangles, angle: number): Edges {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(positions.slice(), 3));
  geometry.computeBoundingSphere();
  // vertices with four digits in common are one
  const scale = 1000 / (geometry.boundingSphere?.radius || 1);
  const sharp = new EdgesGeometry(geometry.scale(scale, scale, scale), angle);
  const segments = sharp.scale(1 / scale, 1 / scale, 1 / scale).getAttribute("position").array as Float32Array;
  return { segments, centre };
}

interface Edges {
  segments: Float32Array;
  centre: Vector3;
}

interface Loaded {
  geometry: BufferGeometry;
  centre: Vector3;
  /** What `extras.faces` of the mesh refers to. */
  view: ArrayBuffer | null;
}

async function load(bytes: ArrayBuffer): Promise<Loaded> {
  const file = await new GLTFLoader().parseAsync(bytes, "");
  let mesh: Mesh | undefined;
  file.scene.traverse((object) => {
    if ("isMesh" in object) mesh ??= object as Mesh;
  });
  if (!mesh) throw new Error("the file has no mesh");
  mesh.updateWorldMatrix(true, false);
  const number: unknown = file.parser.json.meshes[0].extras?.faces;
  const view =
    typeof number === "number" ? ((await file.parser.getDependency("bufferView", number)) as ArrayBuffer) : null;
  return { geometry: mesh.geometry, centre: mesh.getWorldPosition(new Vector3()), view };
}
