"use strict";
// Shows a tileset (3D Tiles 1.1 with GLB content, boxes or spheres, refinement by replacement or addition) or one mesh that the page itself holds.
//
//   asraViewer(element, {title, tileset: "tileset.json"})            tiles are fetched beside the page
//   asraViewer(element, {title, mesh: "id", channels, …})            packed in the element of that id
//
// All is drawn in the frame of the tileset's root: z is up, places are about its middle. The root's transform, which leads from there to the mesh's own
// coordinates or to the Earth, only shows in the numbers that are told. Nothing is drawn unless something has changed.
function asraViewer(host, source) {
  // Vectors, and matrices of 16 numbers column by column.
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const mul = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => mul(a, 1 / (Math.hypot(a[0], a[1], a[2]) || 1));
  const SAME = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const product = (a, b) => {
    const out = new Array(16).fill(0);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
    return out;
  };
  const moved = (m, p) => [0, 1, 2].map(r => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
  const turned = (m, p) => [0, 1, 2].map(r => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2]);
  // Of the upper left three by three, as three columns.
  const inverse3 = m => {
    const [a, b, c] = [[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]];
    const rows = [cross(b, c), cross(c, a), cross(a, b)], d = dot(a, rows[0]) || 1;
    return [0, 1, 2].map(k => rows.map(row => row[k] / d));
  };
  const inverse = m => {
    const [a, b, c] = inverse3(m), t = [m[12], m[13], m[14]];
    const back = add(add(mul(a, -t[0]), mul(b, -t[1])), mul(c, -t[2]));
    return [...a, 0, ...b, 0, ...c, 0, ...back, 1];
  };
  const composed = node => {
    if (node.matrix) return node.matrix;
    const [x, y, z, w] = node.rotation || [0, 0, 0, 1], [sx, sy, sz] = node.scale || [1, 1, 1], t = node.translation || [0, 0, 0];
    return [
      (1 - 2 * (y * y + z * z)) * sx, 2 * (x * y + z * w) * sx, 2 * (x * z - y * w) * sx, 0,
      2 * (x * y - z * w) * sy, (1 - 2 * (x * x + z * z)) * sy, 2 * (y * z + x * w) * sy, 0,
      2 * (x * z + y * w) * sz, 2 * (y * z - x * w) * sz, (1 - 2 * (x * x + y * y)) * sz, 0, ...t, 1,
    ];
  };
  // glTF has y up, tiles z.
  const UPRIGHT = [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1];

  // The page's part. What comes from files is put there as text only.
  const made = (name, kind, parent, text) => {
    const element = document.createElement(name);
    if (kind) element.className = kind;
    if (text !== undefined) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  };
  host.classList.add("viewer");
  const canvas = made("canvas", "", host);
  canvas.tabIndex = 0;
  canvas.setAttribute("aria-label", "The mesh. Arrows turn it, with Shift they move it, + and - zoom.");
  const SVG = "http://www.w3.org/2000/svg";
  const marks = document.createElementNS(SVG, "svg");
  marks.setAttribute("class", "marks");
  host.append(marks);
  const panel = made("details", "box panel", host);
  panel.open = host.clientWidth > 600;
  made("summary", "", panel, source.title || "Mesh");
  const labelled = (words, element) => {
    const label = made("label", "", panel);
    if (element.type === "checkbox") label.append(element, words); else label.append(words, element);
    return element;
  };
  const input = (type, more) => Object.assign(document.createElement("input"), {type, ...more});
  const colourOf = labelled("Colour", document.createElement("select"));
  const detailOf = labelled("Detail", input("range", {min: 0, max: 100, value: 60, title: "How many pixels the surface may be off"}));
  const wire = labelled("Wireframe", input("checkbox")), parallel = labelled("Parallel view", input("checkbox"));
  const measuring = labelled("Measure distances", input("checkbox"));
  const row = made("div", "row", panel);
  const legend = made("div", "legend", panel);
  made("div", "keys", panel, "Drag turns, right button or Shift moves, wheel zooms, click asks, double click goes there. Keys: arrows, + -, H all, T top, W wires, M measure, C colour.");
  const found = made("div", "box found", host), status = made("div", "box status", host, "Loading …"), wrong = made("div", "box wrong", host);
  found.hidden = wrong.hidden = true;
  const stats = {triangles: 0, tiles: 0, loaded: 0, loading: 0, waiting: 0, failed: 0, level: null, error: null, bytes: 0, full: false, frames: 0, first: null, idle: false, renderer: ""};
  const viewer = {stats};
  const failures = new Set();
  const fail = words => {
    failures.add(String(words));
    wrong.hidden = false;
    wrong.textContent = [...failures].slice(0, 3).join("\n");
    stats.message = wrong.textContent;
  };
  const gl = canvas.getContext("webgl2", {antialias: true, alpha: false});
  if (!gl) {
    status.hidden = true;
    panel.open = false;
    fail("This browser has no WebGL 2, which the view needs. A recent Firefox, Chrome, Edge or Safari has it, unless hardware acceleration is turned off.");
    return viewer;
  }
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  stats.renderer = String(gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  canvas.addEventListener("webglcontextlost", () => fail("The graphics were lost. Load the page again."));

  // Colours and light are those of the pictures that `render` draws. Light is added in linear values.
  const SCALE = [[84, 58, 146], [76, 88, 174], [58, 116, 186], [44, 142, 182], [40, 166, 168], [70, 188, 144], [124, 208, 110], [188, 222, 84], [250, 234, 92]];
  const CLASSES = [
    [178, 178, 178], [206, 206, 206], [190, 140, 92], [188, 214, 130], [122, 180, 84], [50, 124, 66], [214, 94, 40], [204, 60, 140], [160, 150, 210], [46, 110, 190],
    [110, 84, 100], [98, 102, 112], [226, 200, 226], [240, 206, 60], [228, 168, 32], [140, 116, 20], [244, 226, 140], [120, 196, 214], [170, 40, 100], [86, 196, 186],
  ];
  const NAMES = ["never classified", "unclassified", "ground", "low vegetation", "medium vegetation", "high vegetation", "building", "low noise", "key point", "water", "rail", "road",
    "overlap", "wire, guard", "wire, conductor", "tower", "connector", "bridge", "high noise"];
  const classColour = number => CLASSES[number < CLASSES.length ? number : 2 + number % (CLASSES.length - 3)];
  const VERTEX = `#version 300 es
uniform mat4 seen; uniform mat3 across; uniform int mode; uniform vec2 range;
in vec3 at; in vec3 normal; in vec4 colour; in float value;
out vec3 facing; out vec3 own; out float along; flat out float label;
void main() {
  gl_Position = seen * vec4(at, 1.);
  facing = across * normal; own = colour.rgb; label = value;
  along = (value - range.x) / (range.y - range.x);
}`;
  const FRAGMENT = `#version 300 es
precision highp float; precision highp int;
uniform int mode; uniform vec3 scale[9]; uniform vec3 classes[20]; uniform vec4 over; uniform bool skirt;
in vec3 facing; in vec3 own; in float along; flat in float label;
out vec4 light;
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + .055) / 1.055, vec3(2.4)), step(.04045, c)); }
vec3 encoded(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1. / 2.4)) - .055, step(.0031308, c)); }
void main() {
  if (over.a > 0.) { light = vec4(over.rgb, 1.); return; }
  vec3 base = linear(vec3(208., 203., 195.) / 255.);
  if (mode == 1) base = clamp(own, 0., 1.);
  if (mode == 2) {
    bool known = along == along;
    float t = clamp(known ? along : 0., 0., 1.) * 8.;
    int k = min(int(t), 7);
    base = linear(known ? mix(scale[k], scale[k + 1], t - float(k)) : vec3(150. / 255.));
  }
  if (mode == 3) { int k = int(label + .5); base = linear(classes[k < 20 ? k : 2 + k % 17]); }
  vec3 n = normalize(facing);
  if (any(isnan(n))) n = vec3(0., 0., 1.);
  // Not along outlines, where front and back are as far away as each other.
  if (!gl_FrontFacing && n.z < -.15 && !skirt) { base = mix(linear(vec3(176., 92., 60.) / 255.), base, .3); n = -n; }
  if (n.z < 0.) n = normalize(vec3(n.xy, 1e-4));
  vec3 key = vec3(-.4837, .5805, .6547);
  vec3 sum = vec3(1.04, 1., .94) * max(dot(n, key), 0.) + vec3(.12, .13, .15) * max(dot(n, vec3(.8018, 0., .5976)), 0.)
    + mix(vec3(.13, .115, .10), vec3(.27, .30, .36), .5 + .5 * n.y);
  float gloss = .06 * pow(max(dot(n, normalize(key + vec3(0., 0., 1.))), 0.), 32.);
  light = vec4(encoded(clamp(base * sum + gloss, 0., 1.)), 1.);
}`;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) fail(`The graphics do not take the shader: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  ["at", "normal", "colour", "value"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
  gl.linkProgram(program);
  gl.useProgram(program);
  const uniforms = Object.fromEntries(["seen", "across", "mode", "range", "scale", "classes", "over", "skirt"].map(name => [name, gl.getUniformLocation(program, name)]));
  const floats = colours => new Float32Array(colours.flat().map(c => c / 255));
  gl.uniform3fv(uniforms.scale, floats(SCALE));
  gl.uniform3fv(uniforms.classes, floats(CLASSES));

  // GLB: what is drawn of it, in typed arrays.
  const READ = {5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array};
  const WIDE = {SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4};
  const KNOWN = ["KHR_mesh_quantization", "KHR_materials_unlit", "EXT_mesh_features", "EXT_structural_metadata", "EXT_meshopt_compression"];
  const parsed = (buffer, name) => {
    const head = new DataView(buffer), magic = buffer.byteLength < 20 ? 0 : head.getUint32(0, true);
    if (magic !== 0x46546c67) throw new Error(`${name}: is no GLB, the only content that is shown here`);
    const length = head.getUint32(12, true), start = 28 + length;
    const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
    const strange = (json.extensionsRequired || []).filter(extension => !KNOWN.includes(extension));
    if (strange.length) throw new Error(`${name}: needs ${strange.join(", ")}, which is not shown here. A tileset of asra-stream is.`);
    // The bytes of a view: its buffer, and where in it they begin.
    const decoded = new Map();
    const bytesOf = number => {
      const view = json.bufferViews[number], told = (view.extensions || {}).EXT_meshopt_compression;
      if (!told) return {held: buffer, from: start + (view.byteOffset || 0), stride: view.byteStride};
      if (!decoded.has(number)) {
        try {
          decoded.set(number, asraMeshopt(new Uint8Array(buffer, start + (told.byteOffset || 0), told.byteLength), told).buffer);
        } catch (error) {
          throw new Error(`${name}: ${error.message}`);
        }
      }
      return {held: decoded.get(number), from: 0, stride: view.byteStride};
    };
    const accessors = new Map();
    const values = number => {
      if (accessors.has(number)) return accessors.get(number);
      const accessor = json.accessors[number], type = READ[accessor.componentType], wide = WIDE[accessor.type];
      if (accessor.sparse || accessor.bufferView === undefined || !type || !wide) throw new Error(`${name}: has values that are not shown here`);
      const {held, from: begin, stride} = bytesOf(accessor.bufferView), size = type.BYTES_PER_ELEMENT;
      const step = stride || wide * size, first = begin + (accessor.byteOffset || 0), count = wide * accessor.count;
      let data;
      if (step === wide * size && first % size === 0) {
        // A copy: the file's own buffer is let go.
        data = new type(held, first, count).slice();
      } else {
        data = new type(count);
        const from = new Uint8Array(held), to = new Uint8Array(data.buffer);
        for (let i = 0; i < accessor.count; i++) to.set(from.subarray(first + i * step, first + i * step + wide * size), i * wide * size);
      }
      const most = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}[accessor.componentType];
      const out = {data, wide, count: accessor.count, type: accessor.componentType, normalized: !!accessor.normalized, unit: accessor.normalized ? 1 / most : 1};
      accessors.set(number, out);
      return out;
    };
    const parts = [];
    const primitive = (own, place, below) => {
      if ((own.mode === undefined ? 4 : own.mode) !== 4) return;
      const named = Object.fromEntries(Object.entries(own.attributes).map(([key, number]) => [key, values(number)]));
      const at = named.POSITION, count = at.count;
      let indices = own.indices === undefined ? Uint32Array.from({length: count}, (_, i) => i) : values(own.indices).data;
      if (indices instanceof Uint8Array) indices = Uint16Array.from(indices);
      const sheet = json.materials && own.material !== undefined && json.materials[own.material].doubleSided;
      parts.push({named, indices, place: product(place, SAME), count, skirt: below, sheet: !!sheet, values: {}});
    };
    const visit = (number, above) => {
      const node = json.nodes[number], place = product(above, composed(node));
      if (node.mesh !== undefined) {
        const seen = new Set();
        for (const own of json.meshes[node.mesh].primitives) {
          // A skirt has the same vertices once more.
          primitive(own, place, seen.has(own.attributes.POSITION));
          seen.add(own.attributes.POSITION);
        }
      }
      (node.children || []).forEach(child => visit(child, place));
    };
    const scene = (json.scenes || [])[json.scene || 0];
    (scene ? scene.nodes : []).forEach(root => visit(root, UPRIGHT));
    for (const part of parts) if (!part.named.NORMAL) part.named.NORMAL = normals(part);
    return parts;
  };
  const corner = (part, v) => {
    const {data, unit: u} = part.named.POSITION;
    return [data[3 * v] * u, data[3 * v + 1] * u, data[3 * v + 2] * u];
  };
  // By area, where a file has none.
  const normals = part => {
    const out = new Float32Array(3 * part.count);
    for (let i = 0; i < part.indices.length; i += 3) {
      const [i0, i1, i2] = [part.indices[i], part.indices[i + 1], part.indices[i + 2]], a = corner(part, i0);
      const n = cross(sub(corner(part, i1), a), sub(corner(part, i2), a));
      for (const v of [i0, i1, i2]) for (let k = 0; k < 3; k++) out[3 * v + k] += n[k];
    }
    for (let v = 0; v < out.length; v += 3) out.set(unit([out[v], out[v + 1], out[v + 2]]), v);
    return {data: out, wide: 3, count: part.count, type: 5126, normalized: false, unit: 1};
  };

  // The tree.
  let tree = null, levels = [], origin = null, frameNumber = 0, bytes = 0, shown = [], size = 1;
  const ranges = {}, samples = {}, classesThere = new Set();
  const all = new Set();
  const BOUND = Math.min(1024, Math.max(256, 128 * (navigator.deviceMemory || 4))) * 1048576, AT_ONCE = 6, SAMPLE = 20000;
  const grown = (tile, above, matrix, base, depth) => {
    const own = above && tile.transform ? product(matrix, tile.transform) : matrix, volume = tile.boundingVolume || {};
    let middle, half;
    if (volume.box) {
      const b = volume.box;
      middle = moved(own, b.slice(0, 3));
      const axes = [3, 6, 9].map(i => turned(own, b.slice(i, i + 3)));
      half = [0, 1, 2].map(i => axes.reduce((sum, axis) => sum + Math.abs(axis[i]), 0));
    } else if (volume.sphere) {
      const stretch = Math.max(...[0, 4, 8].map(i => Math.hypot(own[i], own[i + 1], own[i + 2])));
      middle = moved(own, volume.sphere.slice(0, 3));
      half = [1, 1, 1].map(() => volume.sphere[3] * stretch);
    } else {
      throw new Error("The tileset has bounding volumes that are neither boxes nor spheres, which are not shown here.");
    }
    const node = {error: tile.geometricError || 0, middle, half, above, matrix: own, depth, state: "away", used: -1, bytes: 0, parts: null};
    node.adds = tile.refine ? tile.refine.toUpperCase() === "ADD" : !!above && above.adds;
    const content = tile.content || (tile.contents || [])[0];
    if (content) [node.uri, node.url] = [content.uri || content.url, new URL(content.uri || content.url, base)];
    else node.state = "there";
    node.children = (tile.children || []).map(child => grown(child, node, own, base, depth + 1));
    all.add(node);
    return node;
  };
  const begun = (json, base) => {
    tree = grown(json.root, null, SAME, base, 0);
    size = 2 * Math.hypot(...tree.half) || 1;
    levels = ((json.asset || {}).extras || {}).levels || [];
    origin = json.root.transform || null;
    home();
    redraw();
  };
  const upload = (target, data) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, data, gl.STATIC_DRAW);
    return buffer;
  };
  // What was read of a tile, to where it is drawn from.
  const settled = (node, parts) => {
    node.parts = parts;
    const buffers = new Map();
    const buffered = (data, target) => {
      if (!buffers.has(data)) {
        buffers.set(data, upload(target, data));
        node.bytes += 2 * data.byteLength;
      }
      return buffers.get(data);
    };
    for (const part of parts) {
      part.place = product(node.matrix, part.place);
      part.at = buffered(part.named.POSITION.data, gl.ARRAY_BUFFER);
      part.normal = buffered(part.named.NORMAL.data, gl.ARRAY_BUFFER);
      if (part.named.COLOR_0) part.colour = buffered(part.named.COLOR_0.data, gl.ARRAY_BUFFER);
      part.elements = buffered(part.indices, gl.ELEMENT_ARRAY_BUFFER);
      part.across = inverse3(part.place);
      if (!part.skirt) sampled(part, node.depth);
    }
    node.buffers = [...buffers.values()];
    bytes += node.bytes;
    node.state = "there";
  };
  const offered = part => ["", "height", ...(part.named.COLOR_0 ? ["COLOR_0"] : []), ...Object.keys(part.named).filter(name => name.startsWith("_") && part.named[name].wide === 1).sort()];
  let choices = [];
  // Ends of scales are those of the coarsest tiles, of which a few values far off do not count: so colours stay as tiles come.
  const sampled = (part, depth) => {
    const names = offered(part), more = names.filter(name => !choices.includes(name));
    if (more.length) {
      const first = !choices.length, kept = colourOf.value;
      choices = [...choices, ...more];
      colourOf.replaceChildren(...choices.map(name => {
        const words = {"": "plain", COLOR_0: "RGB"}[name] || name.replace(/^_/, "").toLowerCase().replaceAll("_", " ");
        return Object.assign(document.createElement("option"), {value: name, textContent: words});
      }));
      colourOf.value = !first ? kept : source.colour && names.includes(source.colour) ? source.colour : part.named.COLOR_0 ? "COLOR_0" : part.sheet ? "height" : "";
    }
    const step = Math.max(1, Math.floor(part.count / SAMPLE));
    for (const name of names) {
      const data = name && name !== "height" && name !== "COLOR_0" && part.named[name].data;
      if (name === "_CLASSIFICATION") for (let i = 0; i < part.count; i += step) classesThere.add(data[i]);
      const sample = samples[name] = samples[name] || {depth, list: []};
      if (!(data || name === "height") || depth > sample.depth || sample.list.length > 8 * SAMPLE) continue;
      for (let i = 0; i < part.count; i += step) {
        const value = data ? data[i] * part.named[name].unit : moved(part.place, corner(part, i))[2];
        if (isFinite(value)) sample.list.push(value);
      }
      sample.list.sort((a, b) => a - b);
      const of = share => sample.list[Math.round(share * (sample.list.length - 1))];
      ranges[name] = [of(.005), of(.995)];
    }
    shownLegend();
  };
  const released = node => {
    node.buffers.forEach(buffer => gl.deleteBuffer(buffer));
    for (const part of node.parts) [part.edges, ...Object.values(part.values)].forEach(buffer => buffer && gl.deleteBuffer(buffer));
    bytes -= node.bytes;
    Object.assign(node, {parts: null, buffers: null, bytes: 0, state: "away"});
  };
  const fetched = async node => {
    node.state = "coming";
    stats.loading++;
    try {
      const answer = await fetch(node.url);
      if (!answer.ok) throw new Error(`${node.uri}: ${answer.status} ${answer.statusText}`);
      if (/\.json$/i.test(node.url.pathname)) {
        const json = await answer.json();
        // Another tileset, whose root takes this tile's place.
        node.children = [grown({...json.root, transform: json.root.transform || SAME}, node, node.matrix, node.url, node.depth + 1)];
        node.uri = undefined;
        node.parts = [];
        node.buffers = [];
        node.state = "there";
      } else {
        settled(node, parsed(await answer.arrayBuffer(), node.uri));
      }
    } catch (error) {
      node.state = "lost";
      stats.failed++;
      fail(error.message || error);
    }
    stats.loading--;
    redraw();
  };

  // Where the eye is: at a distance from a place, in a direction as `render` names it.
  const FIELD = .75, eye = {target: [0, 0, 0], distance: 1, azimuth: 305, elevation: 30};
  const axes = () => {
    const [a, e] = [eye.azimuth, eye.elevation].map(degrees => degrees * Math.PI / 180), out = [Math.cos(a), Math.sin(a), 0];
    const back = add(mul(out, Math.cos(e)), [0, 0, Math.sin(e)]);
    return {right: [-Math.sin(a), Math.cos(a), 0], up: sub([0, 0, Math.cos(e)], mul(out, Math.sin(e))), back};
  };
  const place = () => add(eye.target, mul(axes().back, eye.distance));
  const corners = box => [0, 1, 2, 3, 4, 5, 6, 7].map(i => box.middle.map((c, a) => c + (i >> a & 1 ? 1 : -1) * box.half[a]));
  const tangents = () => {
    const y = Math.tan(FIELD / 2);
    return [y * (canvas.clientWidth || 1) / (canvas.clientHeight || 1), y];
  };
  const fit = () => {
    if (!tree) return;
    const {right, up, back} = axes(), [tx, ty] = tangents();
    eye.target = tree.middle;
    eye.distance = 1.08 * Math.max(size * 1e-3, ...corners(tree).map(c => {
      const p = sub(c, eye.target), across = Math.max(Math.abs(dot(p, right)) / tx, Math.abs(dot(p, up)) / ty);
      return parallel.checked ? across : across + dot(p, back);
    }));
  };
  const home = () => {
    [eye.azimuth, eye.elevation] = [305, 30];
    fit();
    redraw();
  };
  const seenMatrix = () => {
    const {right, up, back} = axes(), at = place(), [tx, ty] = tangents();
    const view = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, at), -dot(up, at), -dot(back, at), 1];
    const depths = corners(tree).map(c => dot(sub(at, c), back)), farthest = Math.max(...depths), nearest = Math.min(...depths), slack = .01 * size;
    if (parallel.checked) {
      const [near, far] = [nearest - slack, farthest + slack], h = eye.distance * ty, w = eye.distance * tx;
      return product([1 / w, 0, 0, 0, 0, 1 / h, 0, 0, 0, 0, -2 / (far - near), 0, 0, 0, -(far + near) / (far - near), 1], view);
    }
    const far = Math.max(farthest + slack, eye.distance * 2), near = Math.max(nearest - slack, eye.distance * .01, far * 1e-5);
    return product([1 / tx, 0, 0, 0, 0, 1 / ty, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0], view);
  };

  // What is drawn: a tile whose error would be seen gives way to those below it once all of these that are in view are there, so no hole opens.
  const limit = () => Math.pow(2, 4 - .05 * detailOf.value);
  const pixelsOff = node => {
    const height = canvas.clientHeight || 1, ty = Math.tan(FIELD / 2);
    if (parallel.checked) return node.error * height / (2 * ty * eye.distance);
    const at = place(), off = node.middle.map((c, a) => Math.max(0, Math.abs(at[a] - c) - node.half[a]));
    return node.error * height / (2 * ty * Math.max(Math.hypot(...off), 1e-9 * size));
  };
  const inView = (node, m) => {
    const out = [0, 0, 0, 0, 0, 0];
    for (const p of corners(node)) {
      const [x, y, z, w] = [0, 1, 2, 3].map(r => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
      [x < -w, x > w, y < -w, y > w, z < -w, z > w].forEach((is, i) => { out[i] += is; });
    }
    return out.every(count => count < 8);
  };
  const chosen = matrix => {
    const out = [], wanted = [], most = limit();
    // Whether what is in view of a tile is covered.
    const visit = node => {
      if (!inView(node, matrix)) return true;
      const there = node.state === "there", drawn = there && node.parts && node.parts.length;
      if (there) node.used = frameNumber;
      if (node.state === "away") wanted.push(node);
      const finer = node.children.length && (there || node.state === "lost") && (!drawn || pixelsOff(node) > most);
      if (!finer) {
        if (drawn) out.push(node);
        return there;
      }
      const before = out.length, ready = node.children.map(visit).every(Boolean);
      if (drawn && (node.adds || !ready)) {
        if (!node.adds) out.length = before;
        out.push(node);
        return true;
      }
      return ready;
    };
    visit(tree);
    return {out, wanted: wanted.sort((a, b) => a.depth - b.depth || pixelsOff(b) - pixelsOff(a))};
  };
  // Keeps to the bound, by letting go what was not looked at for the longest time.
  const trimmed = () => {
    if (bytes <= BOUND) return;
    const idle = [...all].filter(node => node.bytes && node.used < frameNumber).sort((a, b) => a.used - b.used || b.depth - a.depth);
    while (bytes > BOUND && idle.length) released(idle.shift());
  };

  const TYPES = {5120: gl.BYTE, 5121: gl.UNSIGNED_BYTE, 5122: gl.SHORT, 5123: gl.UNSIGNED_SHORT, 5126: gl.FLOAT};
  const bind = (number, buffer, values) => {
    if (!buffer) {
      gl.disableVertexAttribArray(number);
      gl.vertexAttrib4f(number, 0, 0, 0, 1);
      return;
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(number);
    gl.vertexAttribPointer(number, values.wide, TYPES[values.type], values.normalized, 0, 0);
  };
  // An attribute of vertices, or their height, in single precision.
  const valueBuffer = (node, part, name) => {
    if (!part.values[name]) {
      const data = new Float32Array(part.count), own = part.named[name];
      for (let i = 0; i < part.count; i++) data[i] = own ? own.data[i] * own.unit : moved(part.place, corner(part, i))[2];
      part.values[name] = upload(gl.ARRAY_BUFFER, data);
      node.bytes += data.byteLength;
      bytes += data.byteLength;
    }
    return part.values[name];
  };
  const SINGLE = {wide: 1, type: 5126, normalized: false};
  const edged = (node, part) => {
    if (!part.edges) {
      const from = part.indices, out = new from.constructor(2 * from.length);
      for (let i = 0; i < from.length; i += 3) {
        const [a, b, c] = [from[i], from[i + 1], from[i + 2]];
        out[2 * i] = a; out[2 * i + 1] = b; out[2 * i + 2] = b; out[2 * i + 3] = c; out[2 * i + 4] = c; out[2 * i + 5] = a;
      }
      part.edges = upload(gl.ELEMENT_ARRAY_BUFFER, out);
      node.bytes += out.byteLength;
      bytes += out.byteLength;
    }
    return part.edges;
  };
  const drawPart = (node, part, matrix, axis, what) => {
    const has = what === "height" || part.named[what], mode = !has ? 0 : what === "COLOR_0" ? 1 : what === "_CLASSIFICATION" ? 3 : 2;
    gl.uniformMatrix4fv(uniforms.seen, false, new Float32Array(product(matrix, part.place)));
    // Normals to the view's frame: by the transpose of the inverse of how places are moved.
    const to = part.across, turn = [axis.right, axis.up, axis.back];
    const normal = [0, 1, 2].map(i => turn.map(t => t[0] * to[0][i] + t[1] * to[1][i] + t[2] * to[2][i]));
    gl.uniformMatrix3fv(uniforms.across, false, new Float32Array(normal.flat()));
    gl.uniform1i(uniforms.mode, mode);
    gl.uniform1i(uniforms.skirt, part.skirt ? 1 : 0);
    gl.uniform4f(uniforms.over, 0, 0, 0, 0);
    const [low, high] = ranges[what] || [0, 1];
    gl.uniform2f(uniforms.range, high > low ? low : low - .5, high > low ? high : low + .5);
    bind(0, part.at, part.named.POSITION);
    bind(1, part.normal, part.named.NORMAL);
    bind(2, mode === 1 && part.colour, part.named.COLOR_0);
    bind(3, mode > 1 && valueBuffer(node, part, what), SINGLE);
    const type = part.indices instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.elements);
    gl.drawElements(gl.TRIANGLES, part.indices.length, type, 0);
    if (wire.checked && !part.skirt) {
      gl.uniform4f(uniforms.over, .08, .1, .14, 1);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, edged(node, part));
      gl.drawElements(gl.LINES, 2 * part.indices.length, type, 0);
    }
  };
  const draw = () => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2), [w, h] = [canvas.clientWidth, canvas.clientHeight].map(side => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(.933, .945, .957, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!tree) return;
    frameNumber++;
    gl.enable(gl.DEPTH_TEST);
    if (wire.checked) gl.enable(gl.POLYGON_OFFSET_FILL); else gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    const matrix = seenMatrix(), axis = axes(), {out, wanted} = chosen(matrix), what = colourOf.value;
    trimmed();
    // With all in use, no more is asked for: what is drawn stays coarser.
    const full = bytes > BOUND;
    const next = full ? [] : wanted.slice(0, Math.max(0, AT_ONCE - stats.loading));
    let triangles = 0;
    for (const node of out) {
      for (const part of node.parts) {
        drawPart(node, part, matrix, axis, what);
        if (!part.skirt) triangles += part.indices.length / 3;
      }
    }
    shown = out;
    next.forEach(fetched);
    const errors = out.map(node => node.error), numbers = errors.map(levelOf).filter(number => number >= 0);
    const rough = full || out.some(node => node.children.length && pixelsOff(node) > limit());
    Object.assign(stats, {
      triangles, tiles: out.length, waiting: wanted.length - next.length, bytes, full,
      loaded: [...all].filter(node => node.parts && node.parts.length).length, frames: stats.frames + 1, level: numbers.length ? [Math.min(...numbers), Math.max(...numbers)] : null,
      error: errors.length ? Math.max(...errors) : null, drawn: out.map(node => node.uri || ""),
    });
    stats.idle = !stats.loading && (!wanted.length || full);
    if (stats.first === null && triangles) stats.first = performance.now();
    tell(rough);
    drawMarks(matrix);
    if (viewer.onframe) viewer.onframe();
  };
  const levelOf = error => levels.findIndex(level => level.error === error);
  const grouped = number => Math.round(number).toLocaleString("en");
  const short = number => number === 0 ? "0" : Math.abs(number) >= 1e5 || Math.abs(number) < 1e-4 ? number.toExponential(2) : String(Number(number.toPrecision(3)));
  const tell = rough => {
    const {triangles, tiles, loaded, level, error} = stats, many = (count, word) => `${grouped(count)} ${word}${count === 1 ? "" : "s"}`;
    const words = [many(triangles, "triangle")];
    if (source.tileset) words.push(`${many(tiles, "tile")} of ${grouped(loaded)} loaded`);
    if (level) words.push(level[0] === level[1] ? `level ${level[0]}` : `levels ${level[0]} to ${level[1]}`);
    if (error !== null) words.push(error > 0 ? `within ${short(error)} of the mesh` : "the mesh itself");
    if (source.rounded) words.push(`places rounded to ${short(source.rounded)}`);
    if (stats.full) words.push("memory for tiles is used up: less detail");
    else if (stats.loading || rough) words.push("loading …");
    status.textContent = words.join(" · ");
  };
  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      try { draw(); } catch (error) { fail(error.message || error); throw error; }
    });
  };
  const shownLegend = () => {
    const what = colourOf.value, range = ranges[what];
    legend.replaceChildren();
    if (what === "_CLASSIFICATION") {
      for (const number of [...classesThere].sort((a, b) => a - b).slice(0, 40)) {
        const line = made("div", "class", legend);
        made("i", "", line).style.background = `rgb(${classColour(number)})`;
        line.append(`${number} ${NAMES[number] || ""}`);
      }
    } else if (range) {
      made("div", "bar", legend).style.background = `linear-gradient(90deg,${SCALE.map(c => `rgb(${c})`).join(",")})`;
      const ends = made("div", "ends", legend), up = what === "height" && isPlain(origin) ? origin[14] : 0;
      const digits = Math.max(0, Math.min(9, 2 - Math.floor(Math.log10(range[1] - range[0] || 1))));
      range.forEach(end => made("span", "", ends, (end + up).toFixed(digits)));
    }
  };

  // The place under the pointer: of all triangles that are drawn the nearest, exactly.
  const ray = (x, y) => {
    const {right, up, back} = axes(), [tx, ty] = tangents();
    const u = (2 * x / canvas.clientWidth - 1) * tx, v = (1 - 2 * y / canvas.clientHeight) * ty;
    if (parallel.checked) {
      const on = add(eye.target, add(mul(right, u * eye.distance), mul(up, v * eye.distance)));
      return {from: add(on, mul(back, 4 * size + eye.distance)), way: mul(back, -1)};
    }
    return {from: place(), way: unit(sub(add(mul(right, u), mul(up, v)), back))};
  };
  const meets = (node, from, way) => {
    let [low, high] = [0, Infinity];
    for (let a = 0; a < 3; a++) {
      // A little wider, for what is flat.
      const wide = node.half[a] + 1e-6 * size, [t0, t1] = [-1, 1].map(side => (node.middle[a] + side * wide - from[a]) / way[a]);
      if (Number.isNaN(t0) || Number.isNaN(t1)) continue;
      [low, high] = [Math.max(low, Math.min(t0, t1)), Math.min(high, Math.max(t0, t1))];
    }
    return low <= high;
  };
  const pick = (x, y) => {
    const {from, way} = ray(x, y);
    let best = null;
    for (const node of shown.filter(node => meets(node, from, way))) {
      for (const part of node.parts.filter(part => !part.skirt)) {
        const back = inverse(part.place), [ox, oy, oz] = moved(back, from), [dx, dy, dz] = turned(back, way);
        const {data, unit: s} = part.named.POSITION, own = part.indices;
        for (let i = 0; i < own.length; i += 3) {
          const a = 3 * own[i], b = 3 * own[i + 1], c = 3 * own[i + 2];
          const ax = data[a] * s, ay = data[a + 1] * s, az = data[a + 2] * s;
          const ux = data[b] * s - ax, uy = data[b + 1] * s - ay, uz = data[b + 2] * s - az;
          const vx = data[c] * s - ax, vy = data[c + 1] * s - ay, vz = data[c + 2] * s - az;
          const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx, d = ux * px + uy * py + uz * pz;
          if (d === 0) continue;
          const tx = ox - ax, ty = oy - ay, tz = oz - az, f = (tx * px + ty * py + tz * pz) / d;
          if (!(f >= 0 && f <= 1)) continue;
          const qx = ty * uz - tz * uy, qy = tz * ux - tx * uz, qz = tx * uy - ty * ux, g = (dx * qx + dy * qy + dz * qz) / d;
          if (!(g >= 0 && f + g <= 1)) continue;
          const far = (vx * qx + vy * qy + vz * qz) / d;
          if (far > 0 && (!best || far < best.far)) best = {far, node, part, face: i};
        }
      }
    }
    if (!best) return null;
    best.at = add(from, mul(way, best.far));
    const vertices = [0, 1, 2].map(k => best.part.indices[best.face + k]).map(v => ({v, at: moved(best.part.place, corner(best.part, v))}));
    const off = p => Math.hypot(...sub(p.at, best.at));
    best.vertex = vertices.reduce((a, b) => off(b) < off(a) ? b : a);
    return best;
  };
  const isPlain = m => !!m && [0, 1, 2, 4, 5, 6, 8, 9, 10].every((i, k) => m[i] === (k % 4 ? 0 : 1));
  const told3 = p => {
    const digits = Math.max(0, Math.min(9, 6 - Math.ceil(Math.log10(size))));
    return p.map(c => c.toFixed(digits)).join("  ");
  };
  // Longitude and latitude in degrees, and the height above WGS 84's ellipsoid, of a place from the Earth's middle (Bowring; off by less than a micrometre near the ground).
  const geographic = ([x, y, z]) => {
    const a = 6378137, f = 1 / 298.257223563, b = a * (1 - f), e2 = f * (2 - f), p = Math.hypot(x, y), t = Math.atan2(z * a, p * b);
    const lat = Math.atan2(z + e2 / (1 - e2) * b * Math.sin(t) ** 3, p - e2 * a * Math.cos(t) ** 3), n = a / Math.sqrt(1 - e2 * Math.sin(lat) ** 2);
    const high = Math.abs(lat) < 1 ? p / Math.cos(lat) - n : z / Math.sin(lat) - n * (1 - e2);
    return [Math.atan2(y, x), lat].map(r => r * 180 / Math.PI).concat(high);
  };
  const coordinates = p => {
    if (!origin) return [["x y z", told3(p)]];
    if (isPlain(origin)) return [["x y z", told3(add(p, origin.slice(12, 15)))]];
    const there = moved(origin, p), rows = [["east north up", told3(p)]];
    if (Math.abs(Math.hypot(...there) - 6.37e6) < 1e5) {
      const [lon, lat, high] = geographic(there);
      rows.push(["longitude", `${lon.toFixed(8)}°`], ["latitude", `${lat.toFixed(8)}°`], ["height", high.toFixed(3)]);
    } else {
      rows.push(["x y z", told3(there)]);
    }
    return rows;
  };
  const attributes = ({part, vertex}) => {
    const rows = [];
    for (const [name, own] of Object.entries(part.named)) {
      const here = [...own.data.slice(vertex.v * own.wide, (vertex.v + 1) * own.wide)];
      if (name === "COLOR_0") {
        const encoded = c => Math.round(255 * (c <= .0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - .055));
        rows.push(["RGB", here.slice(0, 3).map(c => encoded(c * own.unit)).join("  ")]);
      } else if (name.startsWith("_")) {
        const value = here.map(c => Number((c * own.unit).toPrecision(9))).join("  ");
        rows.push([name.slice(1).toLowerCase().replaceAll("_", " "), name === "_CLASSIFICATION" ? `${value} ${NAMES[here[0]] || ""}` : value]);
      }
    }
    return rows;
  };
  const marked = [];
  const inspect = (x, y) => {
    const hit = pick(x, y);
    if (!hit) {
      if (!measuring.checked) { marked.length = 0; found.hidden = true; redraw(); }
      return null;
    }
    const rows = [];
    if (measuring.checked) {
      if (marked.length !== 1) marked.length = 0;
      marked.push(hit.at);
      rows.push(...coordinates(hit.at));
      if (marked.length === 2) {
        const d = sub(marked[1], marked[0]);
        rows.push(["distance", short4(Math.hypot(...d))], ["level", short4(Math.hypot(d[0], d[1]))], ["up", short4(d[2])]);
      } else {
        rows.push(["", "click the other place"]);
      }
    } else {
      marked.splice(0, marked.length, hit.vertex.at);
      rows.push(...coordinates(hit.vertex.at), ...attributes(hit));
      if (hit.node.error > 0) rows.push(["", `within ${short(hit.node.error)} of the mesh`]);
    }
    tabled(measuring.checked ? "Distance" : "Nearest vertex", rows);
    viewer.found = {at: hit.at, vertex: hit.vertex.at, rows};
    redraw();
    return viewer.found;
  };
  const short4 = number => Number(number.toPrecision(6)).toString();
  const tabled = (title, rows) => {
    found.replaceChildren();
    made("button", "", found, "×").onclick = () => { found.hidden = true; marked.length = 0; redraw(); };
    const table = made("table", "", found);
    made("caption", "", table, title);
    for (const [name, value] of rows) {
      const line = made("tr", "", table);
      made("th", "", line, name);
      made("td", "", line, value);
    }
    found.hidden = false;
  };
  const drawMarks = matrix => {
    marks.replaceChildren();
    const on = marked.map(p => {
      const [x, y, w] = [0, 1, 3].map(r => matrix[r] * p[0] + matrix[4 + r] * p[1] + matrix[8 + r] * p[2] + matrix[12 + r]);
      return w > 0 ? [(x / w + 1) / 2 * canvas.clientWidth, (1 - y / w) / 2 * canvas.clientHeight] : null;
    });
    const put = (name, values) => {
      const element = document.createElementNS(SVG, name);
      Object.entries(values).forEach(([key, value]) => element.setAttribute(key, value));
      marks.append(element);
    };
    if (on.length === 2 && on[0] && on[1]) {
      for (const [stroke, width] of [["#fff", 4], ["#b3261e", 2]]) put("line", {x1: on[0][0], y1: on[0][1], x2: on[1][0], y2: on[1][1], stroke, "stroke-width": width});
    }
    for (const p of on) if (p) put("circle", {cx: p[0], cy: p[1], r: 5, fill: "#b3261e", stroke: "#fff", "stroke-width": 2});
  };

  // Turning, moving, zooming.
  const held = new Map();
  let moves = 0;
  const step = () => 2 * eye.distance * Math.tan(FIELD / 2) / (canvas.clientHeight || 1);
  const turn = (dx, dy) => {
    eye.azimuth = (eye.azimuth - dx + 720) % 360;
    eye.elevation = Math.max(-90, Math.min(90, eye.elevation + dy));
  };
  const shift = (dx, dy) => {
    const {right, up} = axes();
    eye.target = add(eye.target, add(mul(right, -dx * step()), mul(up, dy * step())));
  };
  // About a place of the canvas, which stays where it is.
  const zoom = (factor, x, y) => {
    const before = step();
    eye.distance = Math.max(size * 1e-6, Math.min(size * 20, eye.distance * factor));
    const {right, up} = axes(), more = before - step();
    const [dx, dy] = [x - canvas.clientWidth / 2, canvas.clientHeight / 2 - y];
    eye.target = add(eye.target, add(mul(right, dx * more), mul(up, dy * more)));
  };
  const on = (name, act, options) => canvas.addEventListener(name, act, options);
  const where = event => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  on("pointerdown", event => {
    canvas.focus({preventScroll: true});
    canvas.setPointerCapture(event.pointerId);
    if (!held.size) moves = 0;
    held.set(event.pointerId, {at: where(event), pan: event.button !== 0 || event.shiftKey || event.ctrlKey});
    canvas.classList.add("held");
  });
  on("pointermove", event => {
    const own = held.get(event.pointerId);
    if (!own) return;
    const at = where(event), [dx, dy] = [at[0] - own.at[0], at[1] - own.at[1]];
    if (held.size === 1) {
      moves += Math.abs(dx) + Math.abs(dy);
      // A click may tremble.
      if (moves < 4) return;
      if (own.pan) shift(dx, dy); else turn(dx * .35, dy * .35);
    } else {
      const other = [...held].find(([id]) => id !== event.pointerId)[1].at;
      const apart = p => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1, middle = [(at[0] + other[0]) / 2, (at[1] + other[1]) / 2];
      moves = Infinity;
      zoom(apart(own.at) / apart(at), ...middle);
      shift(dx / 2, dy / 2);
    }
    own.at = at;
    redraw();
  });
  const letGo = event => {
    const own = held.get(event.pointerId);
    held.delete(event.pointerId);
    if (!held.size) canvas.classList.remove("held");
    if (own && event.type === "pointerup" && moves < 4 && !held.size && event.button === 0) inspect(...where(event));
  };
  on("pointerup", letGo);
  on("pointercancel", letGo);
  on("wheel", event => {
    // In a report the page scrolls until the view was clicked.
    if (!source.tileset && document.activeElement !== canvas) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : event.deltaMode === 2 ? 300 : 1;
    zoom(Math.exp(Math.max(-300, Math.min(300, event.deltaY * lines)) * .0015), ...where(event));
    redraw();
  }, {passive: false});
  on("contextmenu", event => event.preventDefault());
  on("dblclick", event => {
    const hit = pick(...where(event));
    if (!hit) return;
    eye.target = hit.at;
    eye.distance *= .5;
    redraw();
  });
  const top = () => { [eye.azimuth, eye.elevation] = [270, 90]; fit(); redraw(); };
  const toggled = box => { box.checked = !box.checked; box.dispatchEvent(new Event("input")); };
  on("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const go = event.shiftKey ? shift : turn, far = event.shiftKey ? 40 : 5, middle = [canvas.clientWidth / 2, canvas.clientHeight / 2];
    const act = {
      ArrowLeft: () => go(far, 0), ArrowRight: () => go(-far, 0), ArrowUp: () => go(0, far), ArrowDown: () => go(0, -far),
      "+": () => zoom(.8, ...middle), "=": () => zoom(.8, ...middle), "-": () => zoom(1.25, ...middle),
      h: home, t: top, w: () => toggled(wire), m: () => toggled(measuring), p: () => toggled(parallel),
      c: () => { colourOf.selectedIndex = (colourOf.selectedIndex + 1) % colourOf.length; colourOf.dispatchEvent(new Event("input")); },
      Escape: () => { marked.length = 0; found.hidden = true; },
    }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
    redraw();
  });
  for (const [words, act] of [["All", home], ["Top", top], ["Closer", () => zoom(.7, canvas.clientWidth / 2, canvas.clientHeight / 2)], ["Farther", () => zoom(1.4, canvas.clientWidth / 2, canvas.clientHeight / 2)]]) {
    const button = made("button", "", row, words);
    button.type = "button";
    button.onclick = () => { act(); redraw(); };
  }
  colourOf.addEventListener("input", () => { shownLegend(); redraw(); });
  measuring.addEventListener("input", () => { canvas.classList.toggle("measuring", measuring.checked); marked.length = 0; found.hidden = true; redraw(); });
  for (const box of [detailOf, wire, parallel]) box.addEventListener("input", redraw);
  new ResizeObserver(redraw).observe(host);

  // For pages and programs around this one.
  Object.assign(viewer, {
    look: ({fit: fitted, parallel: flat, ...more}) => {
      if (flat !== undefined) parallel.checked = flat;
      Object.assign(eye, more);
      if (fitted) fit();
      redraw();
    },
    set: ({colour, wire: wires, detail, measure}) => {
      if (colour !== undefined) colourOf.value = colour;
      if (wires !== undefined) wire.checked = wires;
      if (detail !== undefined) detailOf.value = detail;
      if (measure !== undefined) { measuring.checked = measure; marked.length = 0; }
      shownLegend();
      redraw();
    },
    eye: () => ({...eye}), choices: () => [...choices], pick, inspect,
  });

  // A mesh that the page holds: base64 of what is deflated. Channels of 16 bits a vertex, each number less the one before; then corners of triangles, each as how
  // far below the next new vertex it is. All low bytes come first, then the higher ones.
  const held16 = async () => {
    const text = atob(document.getElementById(source.mesh).textContent.trim()), raw = Uint8Array.from(text, c => c.charCodeAt(0));
    if (!window.DecompressionStream) throw new Error("This browser is too old to unpack the mesh: it needs one of 2023 or later.");
    const bytes = new Uint8Array(await new Response(new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
    const n = source.vertices, m = 3 * source.triangles, indices = new Uint32Array(m), places = new Float32Array(3 * n), half = [0, 0, 0];
    const named = {POSITION: {data: places, wide: 3, count: n, type: 5126, normalized: false, unit: 1}}, light = {};
    source.channels.forEach(({name, low, step}, k) => {
      const own = k < 3 ? null : new Float32Array(n);
      let number = 0;
      for (let i = 0, at = 2 * n * k; i < n; i++, at++) {
        const code = bytes[at] | bytes[at + n] << 8;
        number = (number + ((code >> 1) ^ -(code & 1))) & 65535;
        const value = number === 65535 ? NaN : low + step * number;
        if (own) own[i] = value; else { places[3 * i + k] = value; half[k] = Math.max(half[k], Math.abs(value)); }
      }
      if (own && ["red", "green", "blue"].includes(name)) light[name] = own;
      else if (own) named["_" + name.toUpperCase()] = {data: own, wide: 1, count: n, type: 5126, normalized: false, unit: 1};
    });
    const {red, green, blue} = light;
    if (red && green && blue) {
      // In 8 bits or in 16; to linear light, as GLB has it.
      const most = [red, green, blue].some(list => list.some(c => c > 255)) ? 65535 : 255, data = new Float32Array(3 * n);
      const linear = c => c <= .04045 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4;
      for (let i = 0; i < n; i++) [red, green, blue].forEach((list, k) => { data[3 * i + k] = linear(list[i] / most); });
      named.COLOR_0 = {data, wide: 3, count: n, type: 5126, normalized: false, unit: 1};
    }
    for (let i = 0, at = 2 * n * source.channels.length, next = 0; i < m; i++, at++) {
      const code = bytes[at] | bytes[at + m] << 8 | bytes[at + 2 * m] << 16;
      indices[i] = next - code;
      if (code === 0) next++;
    }
    const part = {named, indices, place: SAME, count: n, skirt: false, sheet: !!source.sheet, values: {}};
    named.NORMAL = normals(part);
    return {part, half};
  };
  (async () => {
    if (source.tileset) {
      const base = new URL(encodeURIComponent(source.tileset), location.href), answer = await fetch(base);
      if (!answer.ok) throw new Error(`${source.tileset}: ${answer.status} ${answer.statusText}`);
      begun(await answer.json(), base);
      return;
    }
    const {part, half: [x, y, z]} = await held16();
    const root = {boundingVolume: {box: [0, 0, 0, x, 0, 0, 0, y, 0, 0, 0, z]}, geometricError: source.error};
    begun({root: {...root, transform: source.origin.some(c => c) ? [...SAME.slice(0, 12), ...source.origin, 1] : null}}, location.href);
    settled(tree, [part]);
    redraw();
  })().catch(error => fail(error.message || error));
  return viewer;
}
