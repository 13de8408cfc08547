// What a job clusters: a mesh, an image, or other points with neighbours. The page makes jobs of the first two; others
// come from elsewhere.

export type Kind = "mesh" | "image" | "points";

export const isMesh = (name: string): boolean => /\.(obj|glb|gltf|ply|stl|off)$/i.test(name);
export const isImage = (name: string): boolean => /\.(png|jpe?g)$/i.test(name);

export function kindOf({ mesh: { format } }: { mesh: { format: string } }): Kind {
  if (format === "png" || format === "jpeg") return "image";
  return format === "npy" || format === "npz" ? "points" : "mesh";
}

/** The words for each kind: of a sentence's subject with its verb, of its items, and of their clusters. */
export const WORDS: Record<Kind, { has: string; items: string; cluster: string; clusters: string }> = {
  mesh: { has: "The mesh has", items: "faces", cluster: "cluster", clusters: "clusters" },
  image: { has: "The image has", items: "pixels", cluster: "superpixel", clusters: "superpixels" },
  points: { has: "The points have", items: "items", cluster: "cluster", clusters: "clusters" },
};
