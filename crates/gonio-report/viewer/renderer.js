// Draws the sphere of viewer.js: shaders, what they need of materials and lights, and the calls to WebGL 2.
const GonioRenderer = (() => {
  "use strict";

  const CELLS = 90; // samples of a table along either angle
  const FRAME = 1.03; // half the side of the picture, in radii of the sphere
  const LAMP = 3; // what of the light is brighter than so many times its mean counts as a lamp
  const LAMP_ENTRIES = 2048; // of the list that lamps are drawn from
  const PROBE = 48; // side of the picture that the exposure is measured on
  const PROBE_SAMPLES = 32;

  const FILL = `#version 300 es
    void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }`;

  const HEADER = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    const float PI = ${Math.PI};
    const int CELLS = ${CELLS};
    const float FRAME = ${FRAME};
    uniform mat3 toLight;     // from camera coordinates to those of the light
    uniform float side;       // of the picture, in pixels
    uniform sampler2D room;   // the light without its lamps, over its mean, with mips
    uniform float mean;
    out vec4 colour;

    vec2 latLong(vec3 d) { return vec2(atan(d.x, -d.z) / (2.0 * PI) + 0.5, atan(length(d.xz), d.y) / PI); }

    vec3 roomAt(vec2 uv, float solidAngle) {
      // By the height of a texel alone: a level that made up for their being narrow near the poles would blur far down.
      return mean * textureLod(room, uv, log2(sqrt(solidAngle) / PI * float(textureSize(room, 0).y))).rgb;
    }`;

  // Adds samples to a picture. The light is split: "lamps" are what exceeds a few times its mean, "room" is the rest.
  //
  // Directions are drawn by the BRDF, with a mixture of two strategies: half angles by the lobe of the table, and the
  // cosine for its flat part. Each sample reads the room at a mip level as wide as the part of the hemisphere that the
  // sample represents (Křivánek and Colbert 2008). A few samples thus give a smooth picture, which more samples sharpen.
  // Such a filter would blur a lamp over its surroundings. Lamps are therefore excluded from the mips and have separate
  // samples aimed at them; the balance heuristic (Veach and Guibas 1995) combines the strategies.
  const ACCUMULATE = `${HEADER}
    uniform sampler2D before;     // mean of the samples so far
    uniform sampler2D table;      // BRDF: difference angle across, half angle down
    uniform sampler2D sampling;   // see samplingOf
    uniform sampler2D lamps;      // radiance over peak; density of lamp samples times the sine of the polar angle
    uniform sampler2D lampList;   // texels of lamps, each as often as it is to be drawn
    uniform float peak;           // of the lamps; none if zero
    uniform vec2 jitter;          // within the pixel, -0.5 to 0.5
    uniform int first, count;     // samples so far and to be added

    const vec3 VIEW = vec3(0, 0, 1);

    // Four well mixed words for each pixel: they shift its sequences, so that the errors of neighbours differ.
    uvec4 hash(uvec2 p) {
      uvec4 x = uvec4(p, p.x ^ 0x9e3779b9u, p.y + 0x85ebca6bu);
      for (int pass = 0; pass < 3; pass++) {
        x = x * 1664525u + 1013904223u;
        x += x.yzwx * x.wxyz;
        x ^= x >> 16;
      }
      return x;
    }

    // The golden section's kin in two dimensions: any stretch of the sequence covers the square evenly.
    vec2 evenly(int index, uvec2 shift) {
      return vec2((uint(index) * uvec2(3242174889u, 2447445414u) + shift) >> 8) * exp2(-24.0);
    }

    // BRDF times cosine for light from l, and the density with which directions are drawn after the BRDF.
    vec3 reflected(vec3 normal, vec3 l, int row, out float density) {
      density = 0.0;
      float cosine = dot(normal, l);
      if (cosine <= 0.0) return vec3(0);
      vec3 h = normalize(l + VIEW);
      // From the chord: the cosine of a small angle has forgotten it.
      float chord = distance(h, normal);
      float thetaH = 2.0 * asin(min(0.5 * chord, 1.0));
      vec2 at = vec2(degrees(acos(min(h.z, 1.0))), sqrt(thetaH / (0.5 * PI)) * float(CELLS));
      int node = min(int(at.y), CELLS - 1);
      vec4 a = texelFetch(sampling, ivec2(node, row), 0), b = texelFetch(sampling, ivec2(node + 1, row), 0);
      float part = clamp((0.25 * chord * chord - a.z) / (b.z - a.z), 0.0, 1.0);
      density = a.w * mix(a.y, b.y, part) / (4.0 * h.z) + (1.0 - a.w) * cosine / PI;
      at = min(at, float(CELLS - 1));
      ivec2 low = ivec2(min(at, float(CELLS - 2)));
      at -= vec2(low);
      vec3 above = mix(texelFetch(table, low, 0).rgb, texelFetch(table, low + ivec2(1, 0), 0).rgb, at.x);
      vec3 below = mix(texelFetch(table, low + ivec2(0, 1), 0).rgb, texelFetch(table, low + 1, 0).rgb, at.x);
      return cosine * mix(above, below, at.y);
    }

    // A half vector in the frame of the normal, with a density that is linear in the haversine between the nodes.
    vec3 halfVector(float u, float azimuth, int row) {
      int low = 0, high = CELLS;
      while (high - low > 1) {
        int middle = (low + high) / 2;
        if (texelFetch(sampling, ivec2(middle, row), 0).x > u) high = middle; else low = middle;
      }
      vec4 a = texelFetch(sampling, ivec2(low, row), 0), b = texelFetch(sampling, ivec2(high, row), 0);
      u = clamp((u - a.x) / max(b.x - a.x, 1e-20), 0.0, 1.0);
      float s = mix(a.z, b.z, u * (a.y + b.y) / (a.y + sqrt(mix(a.y * a.y, b.y * b.y, u)) + 1e-20));
      return vec3(2.0 * sqrt(s * (1.0 - s)) * vec2(cos(azimuth), sin(azimuth)), 1.0 - 2.0 * s);
    }

    // Radiance of the lamps and density of lamp samples at a point of the lat-long map.
    vec4 lampAt(vec2 uv) {
      return textureLod(lamps, uv, 0.0) * vec4(vec3(peak), 1.0 / max(sin(PI * uv.y), 1e-6));
    }

    // A point of the map: a texel of the list, and around it as the bilinear look-up spreads it.
    vec2 lampSample(vec2 u) {
      int entry = int(u.x * ${LAMP_ENTRIES}.0);
      u.x = fract(u.x * ${LAMP_ENTRIES}.0);
      vec2 spread = mix(sqrt(2.0 * u) - 1.0, 1.0 - sqrt(2.0 - 2.0 * u), step(0.5, u));
      vec2 uv = (texelFetch(lampList, ivec2(entry, 0), 0).xy + 0.5 + spread) / vec2(textureSize(lamps, 0));
      // The look-up repeats the first and the last row beyond the poles; folding them back is the same.
      return vec2(uv.x, uv.y > 1.0 ? 2.0 - uv.y : abs(uv.y));
    }

    vec3 radiance(vec3 normal, uvec4 shift) {
      // The rotation that takes the z axis to the normal gives the other two axes.
      vec3 fold = (normal + VIEW) / (1.0 + normal.z);
      mat3 frame = mat3(vec3(1, 0, 0) - fold * normal.x, vec3(0, 1, 0) - fold * normal.y, normal);
      int row = min(int(degrees(acos(min(normal.z, 1.0))) + 0.5), CELLS - 1);
      float share = texelFetch(sampling, ivec2(0, row), 0).w;
      vec3 sum = vec3(0);
      float density;
      for (int k = first; k < first + count; k++) {
        vec2 u = evenly(k, shift.xy);
        float azimuth = 2.0 * PI * u.y;
        vec3 l;
        if (u.x < share) {
          vec3 h = frame * halfVector(u.x / share, azimuth, row);
          // No light has a half vector that faces away from the camera.
          l = h.z > 0.0 ? 2.0 * h.z * h - VIEW : -normal;
        } else {
          float height = (u.x - share) / (1.0 - share);
          l = frame * vec3(sqrt(height) * vec2(cos(azimuth), sin(azimuth)), sqrt(1.0 - height));
        }
        vec3 f = reflected(normal, l, row, density);
        if (density > 0.0) {
          vec2 uv = latLong(toLight * l);
          vec4 lamp = peak > 0.0 ? lampAt(uv) : vec4(0);
          sum += f * (roomAt(uv, 1.0 / (density * float(first + count))) / density + lamp.rgb / (density + lamp.a));
        }
        if (peak > 0.0) {
          vec2 uv = lampSample(evenly(k, shift.zw));
          float turn = 2.0 * PI * (uv.x - 0.5);
          vec3 d = vec3(sin(PI * uv.y) * vec2(sin(turn), -cos(turn)), cos(PI * uv.y)).xzy;
          f = reflected(normal, d * toLight, row, density);
          vec4 lamp = lampAt(uv);
          if (density > 0.0) sum += f * lamp.rgb / (density + lamp.a);
        }
      }
      return sum / float(count);
    }

    void main() {
      vec2 p = FRAME * (2.0 * (gl_FragCoord.xy + jitter) / side - 1.0);
      colour = vec4(0);
      // A little more than the disc, for whoever interpolates at the rim.
      if (length(p) > 1.0 + 4.0 * FRAME / side) return;
      p *= min(1.0, 0.9995 / length(p));
      vec3 added = radiance(vec3(p, sqrt(1.0 - dot(p, p))), hash(uvec2(gl_FragCoord.xy)));
      vec3 old = first > 0 ? texelFetch(before, ivec2(gl_FragCoord.xy), 0).rgb : vec3(0);
      colour = vec4(mix(old, added, float(count) / float(first + count)), 1);
    }`;

  const SHOW = `${HEADER}
    uniform sampler2D picture;
    uniform float exposure;
    uniform bool showLight;

    // Bilinear by hand: not every device filters 32-bit floats.
    vec3 pictureAt(vec2 p) {
      vec2 at = clamp(p * vec2(textureSize(picture, 0)) - 0.5, vec2(0), vec2(textureSize(picture, 0) - 2));
      ivec2 low = ivec2(at);
      at -= vec2(low);
      vec3 below = mix(texelFetch(picture, low, 0).rgb, texelFetch(picture, low + ivec2(1, 0), 0).rgb, at.x);
      vec3 above = mix(texelFetch(picture, low + ivec2(0, 1), 0).rgb, texelFetch(picture, low + 1, 0).rgb, at.x);
      return mix(below, above, at.y);
    }

    // Itself up to 0.76, so that colours are those of the material; brighter ones approach white slowly. sRGB.
    vec3 display(vec3 radiance) {
      vec3 x = radiance * exposure;
      float top = max(max(x.r, x.g), x.b);
      if (top > 0.76) {
        float mapped = 1.0 - 0.0576 / (top - 0.52);
        x = mix(x * mapped / top, vec3(mapped), 1.0 - 1.0 / (0.15 * (top - mapped) + 1.0));
      }
      return mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, x));
    }

    void main() {
      vec2 at = gl_FragCoord.xy / side;
      vec2 p = FRAME * (2.0 * at - 1.0);
      float cover = clamp(0.5 + (1.0 - length(p)) * 0.5 * side / FRAME, 0.0, 1.0);
      // Half a step of noise keeps wide gradients from banding.
      float noise = (fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584)))) - 0.5) / 255.0;
      colour = vec4(0);
      if (cover > 0.0) colour = vec4(display(pictureAt(at)) + noise, 1) * cover;
      if (showLight && cover < 1.0) {
        // A wide view along -z, out of focus. Lamps need not be in it: cut at a few times the mean they are white still.
        vec2 behind = latLong(toLight * vec3(0.6 * p, -1));
        colour += vec4(display(roomAt(behind, 0.03)) + noise, 1) * (1.0 - cover);
      }
    }`;

  const luminance = (rgb, i = 0) => 0.2126 * rgb[i] + 0.7152 * rgb[i + 1] + 0.0722 * rgb[i + 2];
  const radians = (degrees) => (degrees * Math.PI) / 180;
  const total = (values) => values.reduce((sum, x) => sum + x, 0);

  /** The numbers of a packed table or map: zero, or two to the power of an even step from `low` to `high`. */
  function unpack({ low, high, codes }) {
    const bytes = atob(codes);
    return Float32Array.from({ length: bytes.length / 2 }, (_, i) => {
      const code = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
      return code === 0 ? 0 : 2 ** (low + ((high - low) * (code - 1)) / 65534);
    });
  }

  /** Four numbers for every three. */
  function padded(rgb, alpha = () => 1) {
    const value = (_, i) => (i % 4 < 3 ? rgb[i - (i >> 2)] : alpha(i >> 2));
    return Float32Array.from({ length: (rgb.length / 3) * 4 }, value);
  }

  /**
   * Returns data for drawing half vectors for a table. It has a row for each degree between normal and camera, with a
   * node for each sample of the half angle and one at 90 degrees. A node has the cumulative probability up to it, the
   * density over the sphere of half vectors, and the haversine of its angle. It also has the share of directions of the
   * row that are drawn in this way. The cosine draws the others, for the flat part of the table, which is its lowest
   * value at moderate half angles.
   */
  function samplingOf(table) {
    const value = Float32Array.from({ length: CELLS * CELLS }, (_, i) => luminance(table, 3 * i));
    const flat = value.slice(0, CELLS).map((_, j) => {
      return Math.min(...value.slice(0, 0.8 * CELLS * CELLS).filter((_, i) => i % CELLS === j));
    });
    const azimuths = Array.from({ length: 12 }, (_, k) => Math.cos(((k + 0.5) / 12) * Math.PI));
    const out = new Float32Array(CELLS * (CELLS + 1) * 4);
    for (let row = 0; row < CELLS; row++) {
      const [z, x] = [Math.cos(radians(row)), Math.sin(radians(row))];
      let [lobe, all, before] = [0, 0, [0, 0, 0]];
      const nodes = Array.from({ length: CELLS + 1 }, (_, i) => {
        const thetaH = radians(i ** 2 / CELLS);
        // The integrand in even light, averaged over the azimuth: of the lobe alone, and of everything.
        let [density, whole] = [0, 0];
        for (const azimuth of azimuths) {
          const across = Math.cos(thetaH) * z + Math.sin(thetaH) * azimuth * x;
          const cosine = 2 * across * Math.cos(thetaH) - z;
          if (across <= 0 || cosine <= 0) continue;
          const j = Math.min(Math.round(Math.acos(Math.min(across, 1)) / radians(1)), CELLS - 1);
          const f = value[Math.min(i, CELLS - 1) * CELLS + j];
          density += Math.max(f - flat[j], 0) * across * cosine;
          whole += f * across * cosine;
        }
        const haversine = Math.sin(thetaH / 2) ** 2;
        lobe += 2 * Math.PI * (haversine - before[0]) * (density + before[1]);
        all += 2 * Math.PI * (haversine - before[0]) * (whole + before[2]);
        before = [haversine, density, whole];
        return [lobe, density, haversine];
      });
      const share = all > 0 ? Math.min(lobe / all, 0.98) : 0;
      const unit = lobe || 1;
      out.set(nodes.flatMap(([sum, density, s]) => [sum / unit, density / unit, s, share]), row * nodes.length * 4);
    }
    return out;
  }

  /** A light split into lamps and room, with the list of texels that lamps are drawn from. */
  function splitLight({ width, height, ...packed }) {
    const rgb = unpack(packed);
    const texels = Array.from({ length: width * height }, (_, i) => i);
    const area = texels.map((i) => Math.sin((Math.PI * (Math.floor(i / width) + 0.5)) / height));
    const mean = total(texels.map((i) => luminance(rgb, 3 * i) * area[i])) / total(area) || 1;
    const lamps = rgb.map((x, i) => x * Math.max(0, 1 - (LAMP * mean) / luminance(rgb, i - (i % 3))));
    const room = rgb.map((x, i) => (x - lamps[i]) / mean);
    const flux = texels.map((i) => luminance(lamps, 3 * i) * area[i]);
    const step = total(flux) / LAMP_ENTRIES;
    const times = new Uint16Array(width * height);
    const list = new Float32Array(4 * LAMP_ENTRIES);
    for (let k = 0, texel = 0, sum = flux[0]; k < LAMP_ENTRIES && step > 0; k++) {
      while (sum < (k + 0.5) * step && texel < flux.length - 1) sum += flux[++texel];
      times[texel]++;
      list.set([texel % width, Math.floor(texel / width)], 4 * k);
    }
    const density = (i) => ((times[i] / LAMP_ENTRIES) * width * height) / (2 * Math.PI ** 2);
    const peak = lamps.reduce((a, b) => Math.max(a, b));
    return { room: padded(room), mean, list, peak, lamps: padded(lamps.map((x) => x / peak || 0), density) };
  }

  /** From camera coordinates to those of a light turned about the vertical axis and then tilted, by columns. */
  function turned(yaw, pitch) {
    const [ca, sa, cb, sb] = [yaw, pitch].flatMap((angle) => [Math.cos(radians(angle)), Math.sin(radians(angle))]);
    return [ca, 0, sa, -sa * sb, cb, ca * sb, -sa * cb, -sb, ca * cb];
  }

  /** Renders on the graphics device. Throws if the device does not support it. */
  return class Renderer {
    constructor(gl, data) {
      Object.assign(this, { gl, data, materials: [], lights: [], exposures: new Map() });
      const full = gl.getExtension("EXT_color_buffer_float");
      if (!full && !gl.getExtension("EXT_color_buffer_half_float")) throw new Error("no float pictures");
      this.format = full ? gl.RGBA32F : gl.RGBA16F;
      gl.bindVertexArray(gl.createVertexArray());
      [this.accumulation, this.display] = [ACCUMULATE, SHOW].map((source) => this.program(source));
      this.probe = this.target(PROBE);
    }

    program(source) {
      const { gl } = this;
      const program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, FILL], [gl.FRAGMENT_SHADER, source]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
        throw new Error(gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader)).join("\n"));
      }
      const uniforms = Array.from({ length: gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) }, (_, i) => {
        const { name, type } = gl.getActiveUniform(program, i);
        return { name, type, place: gl.getUniformLocation(program, name) };
      });
      return { program, uniforms };
    }

    /** Draws over the whole of a target, the canvas if null. */
    draw({ program, uniforms }, framebuffer, values) {
      const { gl } = this;
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      gl.viewport(0, 0, values.side, values.side);
      gl.useProgram(program);
      let unit = 0;
      for (const { name, type, place } of uniforms) {
        const value = values[name];
        if (type === gl.SAMPLER_2D) {
          gl.activeTexture(gl.TEXTURE0 + unit);
          gl.bindTexture(gl.TEXTURE_2D, value);
          gl.uniform1i(place, unit++);
        } else if (type === gl.FLOAT) gl.uniform1f(place, value);
        else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, value);
        else if (type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(place, false, value);
        else gl.uniform1i(place, value);
      }
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }

    /** Columns wrap around, rows end. */
    texture(format, width, height, pixels, smaller = this.gl.NEAREST, larger = smaller) {
      const { gl } = this;
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, gl.RGBA, gl.FLOAT, pixels);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, smaller);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, larger);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      return texture;
    }

    /** A picture that samples are added to: two textures, each made from the other. */
    target(side) {
      const { gl } = this;
      const halves = [0, 1].map(() => {
        const texture = this.texture(this.format, side, side, null);
        const framebuffer = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
        return { texture, framebuffer };
      });
      return { side, halves, row: 0, frames: 0, samples: 0 };
    }

    free({ halves }) {
      for (const { texture, framebuffer } of halves) {
        this.gl.deleteTexture(texture);
        this.gl.deleteFramebuffer(framebuffer);
      }
    }

    material(index) {
      const make = () => {
        const rgb = unpack(this.data.materials[index]);
        const table = this.texture(this.gl.RGBA32F, CELLS, CELLS, padded(rgb));
        return { table, sampling: this.texture(this.gl.RGBA32F, CELLS + 1, CELLS, samplingOf(rgb)) };
      };
      return (this.materials[index] ??= make());
    }

    light(index) {
      const make = () => {
        const { gl } = this;
        const { width, height } = this.data.lights[index];
        const { room, mean, list, peak, lamps } = splitLight(this.data.lights[index]);
        // Between levels the nearest will do, at half the price: the samples of a pixel differ in level anyway.
        const roomMap = this.texture(gl.RGBA16F, width, height, room, gl.LINEAR_MIPMAP_NEAREST, gl.LINEAR);
        gl.generateMipmap(gl.TEXTURE_2D);
        const lampMap = this.texture(gl.RGBA16F, width, height, lamps, gl.LINEAR);
        return { mean, peak, room: roomMap, lamps: lampMap, lampList: this.texture(gl.RGBA32F, LAMP_ENTRIES, 1, list) };
      };
      return (this.lights[index] ??= make());
    }

    /**
     * Adds to a target as many samples of each pixel as `budget` (samples times pixels) has room for, up to `most`. If
     * there is not room for one, adds it to some rows, and the next call goes on there. Gives what was spent.
     */
    add(target, budget, most, { material, light, yaw, pitch }) {
      const { gl } = this;
      const { side, row, frames, samples, halves: [before, after] } = target;
      const count = row > 0 ? 1 : Math.max(1, Math.min(Math.floor(budget / side ** 2), most));
      const rows = Math.min(Math.ceil(side / Math.ceil(side ** 2 / budget)), side - row);
      const jitter = [0.7548776662, 0.569840291].map((step) => ((frames * step + 0.5) % 1) - 0.5);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, row, side, rows);
      this.draw(this.accumulation, after.framebuffer, {
        ...this.material(material), ...this.light(light), toLight: turned(yaw, pitch), side,
        before: before.texture, jitter, first: samples, count,
      });
      gl.disable(gl.SCISSOR_TEST);
      target.row += rows;
      if (target.row === side) {
        Object.assign(target, { row: 0, frames: frames + 1, samples: samples + count, halves: [after, before] });
      }
      return count * rows * side;
    }

    restart(target) {
      Object.assign(target, { row: 0, frames: 0, samples: 0 });
    }

    show(target, side, state) {
      this.draw(this.display, null, {
        ...this.light(state.light), toLight: turned(state.yaw, state.pitch), side, showLight: state.showLight,
        picture: target.halves[0].texture, exposure: this.exposure(state) * 2 ** state.stops,
      });
    }

    /** Linear radiance at a point of the sphere, -1 to 1 to the right and up. Waits for the device. */
    radianceAt(target, x, y) {
      const { gl } = this;
      const at = [x, y].map((c) => (0.5 + (0.5 * c) / FRAME) * target.side - 0.5);
      const [s, t] = at.map((c) => c % 1);
      const pixels = new Float32Array(16);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.halves[0].framebuffer);
      gl.readPixels(Math.floor(at[0]), Math.floor(at[1]), 2, 2, gl.RGBA, gl.FLOAT, pixels);
      const weights = [(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t];
      return [0, 1, 2].map((c) => total(weights.map((weight, i) => weight * pixels[4 * i + c])));
    }

    /** Begins to measure how bright a material is in a light; gives what is to be called when the device has done it. */
    measure({ material, light }) {
      const { gl, probe } = this;
      this.restart(probe);
      // In the light as it came: turning it does not change the exposure.
      this.add(probe, PROBE_SAMPLES * PROBE ** 2, PROBE_SAMPLES, { material, light, yaw: 0, pitch: 0 });
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.bufferData(gl.PIXEL_PACK_BUFFER, 16 * PROBE ** 2, gl.STREAM_READ);
      gl.readPixels(0, 0, PROBE, PROBE, gl.RGBA, gl.FLOAT, 0);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      return () => {
        const pixels = new Float32Array(4 * PROBE ** 2);
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
        gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, pixels);
        gl.deleteBuffer(buffer);
        this.exposures.set(`${material} ${light}`, this.exposureFor(pixels));
      };
    }

    /** Brings the mean of the sphere in a probe to 0.3; the brightest tenth counts as the least bright of it. */
    exposureFor(pixels) {
      const to = (n) => FRAME * ((2 * (n + 0.5)) / PROBE - 1);
      const isSeen = (_, i) => Math.hypot(to(i % PROBE), to(Math.floor(i / PROBE))) < 1;
      const seen = Float32Array.from({ length: PROBE ** 2 }, (_, i) => luminance(pixels, 4 * i)).filter(isSeen).sort();
      const top = seen[Math.floor(0.9 * (seen.length - 1))];
      const level = total(seen.map((value) => Math.min(value, top))) / seen.length;
      return level > 0 ? 0.3 / level : 1;
    }

    exposure({ material, light }) {
      return this.exposures.get(`${material} ${light}`);
    }
  };
})();
