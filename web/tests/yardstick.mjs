// How slowly a machine draws: the budgets of the page hold where the yardstick takes YARDSTICK_MS, and grow with it.

/** Milliseconds of processors that the yardstick takes on the machine that the budgets are for. */
const YARDSTICK_MS = 1400;

/** Runs in a page: draws 20 frames of 20,000 triangles over a whole canvas, shaded by their normals, as a mesh is. */
async function yardstick() {
  const canvas = Object.assign(document.createElement("canvas"), { width: 1280, height: 720 });
  const gl = canvas.getContext("webgl2", { antialias: true });
  const program = gl.createProgram();
  for (const [type, source] of [
    [
      gl.VERTEX_SHADER,
      `#version 300 es
      uniform float turn;
      out vec3 place;
      void main() {
        int square = gl_VertexID / 6;
        int corner = gl_VertexID % 6;
        vec2 at = vec2(square % 100, square / 100) + vec2(corner % 3 > 0, corner > 1 && corner < 5);
        place = vec3(at / 50.0 - 1.0, sin(at.x / 9.0 + turn) * cos(at.y / 7.0) / 2.0);
        gl_Position = vec4(place, 1);
      }`,
    ],
    [
      gl.FRAGMENT_SHADER,
      `#version 300 es
      precision highp float;
      in vec3 place;
      out vec4 colour;
      void main() {
        vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
        colour = vec4(abs(normal) * pow(abs(place.x), 1.5), 1);
      }`,
    ],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  for (let frame = 0; frame < 20; frame++) {
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform1f(gl.getUniformLocation(program, "turn"), frame / 10);
    gl.drawArrays(gl.TRIANGLES, 0, 60_000);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

/** How much slower than that one this machine draws, 1 at least; the best of three turns. No other page may draw meanwhile. */
async function slowness(browser) {
  const page = await browser.open("about:blank", {}, undefined, "");
  const times = [];
  for (let turn = 0; turn < 3; turn++) {
    const before = await browser.spent(["GPU"]);
    await page.evaluate(yardstick);
    times.push((await browser.spent(["GPU"])) - before);
  }
  await page.close();
  console.log(`  the yardstick takes ${times.map(Math.round).join(", ")} ms of processors`);
  return Math.max(1, Math.min(...times) / YARDSTICK_MS);
}

/** What a budget is on this machine, for what was measured: the yardstick is drawn where that is not below the budget. */
export async function allowed(browser, budget, measured) {
  return measured < budget ? budget : budget * (await slowness(browser));
}
