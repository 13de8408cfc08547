// The colour of a cluster, the same as in every file that the service writes (src/export/colour.rs).

const SATURATIONS = [0.75, 0.5, 0.9];
const VALUES = [0.95, 0.75, 0.85, 0.65];

export function colour(cluster: number): [number, number, number] {
  const hue = 6 * ((0.61803398875 * cluster) % 1);
  const saturation = SATURATIONS[cluster % 3] ?? 0;
  const value = VALUES[cluster % 4] ?? 0;
  const channel = (shift: number): number => {
    const place = (shift + hue) % 6;
    const lack = Math.min(Math.max(Math.min(place, 4 - place), 0), 1);
    return Math.floor(255 * value * (1 - saturation * lack) + 0.5);
  };
  return [channel(5), channel(3), channel(1)];
}

export const css = (cluster: number): string => `rgb(${colour(cluster).join(" ")})`;

/** The same in GLSL. The hue is exact for every u32: a product modulo 2³² is the fraction times 2³². */
export const GLSL = `
vec3 colour(uint cluster) {
  float hue = 6.0 * float((cluster * 2654435769u) >> 8) / 16777216.0;
  float saturation = float[](0.75, 0.5, 0.9)[cluster % 3u];
  float value = float[](0.95, 0.75, 0.85, 0.65)[cluster % 4u];
  vec3 place = mod(vec3(5.0, 3.0, 1.0) + hue, 6.0);
  return value * (1.0 - saturation * clamp(min(place, 4.0 - place), 0.0, 1.0));
}
`;
