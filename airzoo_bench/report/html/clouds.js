// Clouds of points, coloured by their errors, which turn and zoom; WebGL draws them.
const VERTEX = `
attribute vec3 place; attribute float code;
uniform mat3 turn; uniform vec2 zoom; uniform float size;
uniform sampler2D palette; varying vec3 colour;
void main() {
  vec3 seen = turn * (place / 65535.0 - 0.5);
  gl_Position = vec4(seen.xy * zoom, seen.z * 0.5, 1.0);
  gl_PointSize = size;
  colour = texture2D(palette, vec2((code + 0.5) / 256.0, 0.5)).rgb;
}`;
const FRAGMENT = `
precision mediump float; varying vec3 colour;
void main() { gl_FragColor = vec4(colour, 1.0); }`;

function cloudProgram(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, VERTEX],
    [gl.FRAGMENT_SHADER, FRAGMENT],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  const colours = new Uint8Array(page.palette.flat());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, colours);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  gl.enable(gl.DEPTH_TEST);
  return program;
}

async function cloudsView(part, box) {
  const canvas = box.querySelector(".cloud");
  const gl = canvas.getContext("webgl", { preserveDrawingBuffer: true });
  if (!gl) {
    canvas.replaceWith(el("p", { class: "note" }, "This browser has no WebGL to draw clouds."));
    return;
  }
  const program = cloudProgram(gl);
  const view = { round: 0.6, down: 0.9, zoom: 1.9, count: 0 };

  async function load(place) {
    const cloud = part.clouds[place];
    const arrays = [await unpack(cloud.points), await unpack(cloud.codes)];
    ["place", "code"].forEach((name, n) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, n ? arrays[n] : Uint16Array.from(arrays[n]), gl.STATIC_DRAW);
      const at = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, n ? 1 : 3, n ? gl.UNSIGNED_BYTE : gl.UNSIGNED_SHORT, false, 0, 0);
    });
    view.count = arrays[1].length;
    box.querySelector(".about").textContent = cloud.about;
    box.querySelector(".photo").hidden = cloud.photo < 0;
    if (cloud.photo >= 0) box.querySelector(".photo img").src = page.pictures[cloud.photo];
    draw();
  }

  function draw() {
    const uniform = (name) => gl.getUniformLocation(program, name);
    const [c, s] = [Math.cos(view.round), Math.sin(view.round)];
    const [u, v] = [Math.cos(view.down), Math.sin(view.down)];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.12, 0.13, 0.15, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    // Turned about the vertical, then tilted; columns of the matrix stand below each other.
    gl.uniformMatrix3fv(uniform("turn"), false, [c, s * v, s * u, -s, c * v, c * u, 0, u, -v]);
    const least = Math.min(canvas.width, canvas.height);
    const zoom = [canvas.width, canvas.height].map((side) => (view.zoom * least) / side);
    gl.uniform2fv(uniform("zoom"), zoom);
    gl.uniform1f(
      uniform("size"),
      Math.max(1.5, (least / (view.count < 10000 ? 180 : 350)) * Math.sqrt(view.zoom)),
    );
    gl.drawArrays(gl.POINTS, 0, view.count);
  }

  movable(canvas, {
    drag(dx, dy) {
      view.round -= dx / 150;
      view.down = Math.min(Math.PI / 2, Math.max(0, view.down + dy / 150));
      draw();
    },
    zoom(factor) {
      view.zoom *= factor;
      draw();
    },
  });
  fitted(canvas, draw);
  box.querySelector("select").addEventListener("change", (event) => load(event.target.value));
  await load(0);
}
