// HADR-plus in the reader's browser: the arithmetic of hadr.models.hadr_plus, on plain arrays.
// A map is {c, h, w, data}: channels, rows and columns of 32-bit floats.
"use strict";
const live = { tensors: {}, layers: {} };

live.bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
live.half = (bits) => {
  const exponent = (bits >> 10) & 31, part = bits & 1023, sign = bits >> 15 ? -1 : 1;
  if (exponent === 0) return sign * part * 2 ** -24;
  return sign * (1024 + part) * 2 ** (exponent - 25);
};

// What live_weights.js calls: the configuration, [name, shape, steps] of each tensor in order, the
// tensors. With steps, one an output, it is 8-bit integers; without, 16-bit floats.
live.weights = (config, constants, names, text) => {
  Object.assign(live, { config, constants });
  const bytes = new DataView(live.bytes(text).buffer);
  let at = 0;
  for (const [name, shape, steps] of names) {
    const data = new Float32Array(shape.reduce((a, b) => a * b, 1));
    for (let i = 0, each = data.length / (steps?.length ?? 1); i < data.length; i++, at += steps ? 1 : 2)
      data[i] = steps ? bytes.getInt8(at) * steps[Math.floor(i / each)] : live.half(bytes.getUint16(at, true));
    live.tensors[name] = { shape, data };
  }
};

// What live_frames.js holds, with its pictures as arrays; depth in metres.
live.unpacked = (stored) => {
  const bits = live.bytes(stored.mask), size = stored.width * stored.height;
  const metres = (text) => Float32Array.from(new Uint16Array(live.bytes(text).buffer), (step) => step * stored.unit);
  const inside = Uint8Array.from({ length: size }, (_, i) => (bits[i >> 3] >> (7 - (i & 7))) & 1);
  return { ...stored, inside, color: live.bytes(stored.color), depth: metres(stored.depth), truth: metres(stored.truth) };
};

const map = (c, h, w) => ({ c, h, w, data: new Float32Array(c * h * w) });
const relu6 = (x) => { x.data.forEach((v, i) => { x.data[i] = Math.min(Math.max(v, 0), 6); }); return x; };
const silu = (x) => { x.data.forEach((v, i) => { x.data[i] = v / (1 + Math.exp(-v)); }); return x; };
const added = (a, b) => { b.data.forEach((v, i) => { a.data[i] += v; }); return a; };
const joined = (maps) => {
  const all = map(maps.reduce((n, m) => n + m.c, 0), maps[0].h, maps[0].w);
  let at = 0;
  for (const one of maps) { all.data.set(one.data, at); at += one.data.length; }
  return all;
};

// A convolution's weights and bias; its batch normalisation is multiplied in.
const folded = (conv, norm, tiny = 1e-5) => {
  const key = conv + norm;
  if (live.layers[key]) return live.layers[key];
  const get = (name) => live.tensors[name];
  const { shape, data } = get(conv + ".weight");
  const weight = Float32Array.from(data), bias = new Float32Array(shape[0]);
  if (get(conv + ".bias")) bias.set(get(conv + ".bias").data);
  if (norm) for (let o = 0, each = data.length / shape[0]; o < shape[0]; o++) {
    const factor = get(norm + ".weight").data[o] / Math.sqrt(get(norm + ".running_var").data[o] + tiny);
    for (let i = 0; i < each; i++) weight[o * each + i] *= factor;
    bias[o] = get(norm + ".bias").data[o] + factor * (bias[o] - get(norm + ".running_mean").data[o]);
  }
  return (live.layers[key] = { out: shape[0], size: shape[2], weight, bias });
};

// Rows and columns of zeros before the first ones; those behind the last follow from the size.
const convolved = (x, { out, size, weight, bias }, stride = 1, before = size >> 1) => {
  const y = map(out, Math.ceil(x.h / stride), Math.ceil(x.w / stride));
  const area = y.h * y.w, length = x.c * size * size, patches = new Float32Array(area * length);
  for (let v = 0, at = 0; v < y.h; v++) for (let u = 0; u < y.w; u++)
    for (let c = 0; c < x.c; c++) for (let j = 0; j < size; j++) for (let i = 0; i < size; i++, at++) {
      const row = v * stride + j - before, column = u * stride + i - before;
      if (row >= 0 && row < x.h && column >= 0 && column < x.w) patches[at] = x.data[(c * x.h + row) * x.w + column];
    }
  for (let o = 0; o < out; o++) for (let p = 0; p < area; p++) {
    let sum = 0, from = o * length, at = p * length;
    for (const end = at + length; at < end; at++, from++) sum += weight[from] * patches[at];
    y.data[o * area + p] = sum + bias[o];
  }
  return y;
};

// Each channel by itself.
const depthwise = (x, { size, weight, bias }, stride, before) => {
  const y = map(x.c, Math.ceil(x.h / stride), Math.ceil(x.w / stride));
  for (let c = 0, at = 0; c < x.c; c++) for (let v = 0; v < y.h; v++) for (let u = 0; u < y.w; u++, at++) {
    let sum = bias[c];
    for (let j = 0; j < size; j++) for (let i = 0; i < size; i++) {
      const row = v * stride + j - before, column = u * stride + i - before;
      if (row >= 0 && row < x.h && column >= 0 && column < x.w)
        sum += weight[(c * size + j) * size + i] * x.data[(c * x.h + row) * x.w + column];
    }
    y.data[at] = sum;
  }
  return y;
};

const layer = (name, x, stride = 1) => silu(convolved(x, folded(name + ".0", name + ".1"), stride));
const residual = (name, x) =>
  silu(added(convolved(layer(name + ".first", x), folded(name + ".second", name + ".norm")), x));
const head = (name, x) => convolved(layer(name + ".0", x), folded(name + ".1", ""));
const linear = (name, x) => {
  const { shape: [out, count], data } = live.tensors[name + ".weight"];
  const y = Float32Array.from(live.tensors[name + ".bias"].data);
  for (let o = 0; o < out; o++) for (let i = 0; i < count; i++) y[o] += data[o * count + i] * x[i];
  return y;
};

// Values between the cells of a row of them: the lower cell and the share of the next.
const between = (count, scale) => Array.from({ length: count * scale }, (_, i) => {
  const at = Math.max((i + 0.5) / scale - 0.5, 0), low = Math.min(Math.floor(at), count - 1);
  return [low, Math.min(low + 1, count - 1), at - low];
});
const enlarged = (x, scale) => {
  const y = map(x.c, x.h * scale, x.w * scale);
  const rows = between(x.h, scale), columns = between(x.w, scale);
  let at = 0;
  for (let c = 0; c < x.c; c++) for (const [top, below, down] of rows) for (const [left, next, right] of columns) {
    const value = (v, u) => x.data[(c * x.h + v) * x.w + u];
    y.data[at++] = (1 - down) * ((1 - right) * value(top, left) + right * value(top, next)) +
      down * ((1 - right) * value(below, left) + right * value(below, next));
  }
  return y;
};

// Blocks of n x n pixels as channels, and back.
const unshuffled = (x, n) => {
  const y = map(x.c * n * n, x.h / n, x.w / n);
  for (let c = 0; c < x.c; c++) for (let v = 0; v < x.h; v++) for (let u = 0; u < x.w; u++)
    y.data[((c * n + (v % n)) * n + (u % n)) * y.h * y.w + Math.floor(v / n) * y.w + Math.floor(u / n)] =
      x.data[(c * x.h + v) * x.w + u];
  return y;
};
const shuffled = (x, n) => {
  const y = map(x.c / n / n, x.h * n, x.w * n);
  for (let c = 0; c < y.c; c++) for (let v = 0; v < y.h; v++) for (let u = 0; u < y.w; u++)
    y.data[(c * y.h + v) * y.w + u] =
      x.data[((c * n + (v % n)) * n + (u % n)) * x.h * x.w + Math.floor(v / n) * x.w + Math.floor(u / n)];
  return y;
};
const pooled = (x, size) => {
  const y = [];
  for (let c = 0; c < x.c; c++) for (let v = 0; v < size; v++) for (let u = 0; u < size; u++) {
    let sum = 0, count = 0;
    for (let j = Math.floor((v * x.h) / size); j < Math.ceil(((v + 1) * x.h) / size); j++)
      for (let i = Math.floor((u * x.w) / size); i < Math.ceil(((u + 1) * x.w) / size); i++, count++)
        sum += x.data[(c * x.h + j) * x.w + i];
    y.push(sum / count);
  }
  return y;
};

// Where the crop lies in the frame, as hadr.models.hand.crop lays it.
const cropOf = (frame, keypoints, mask) => {
  const { width, height, camera: [fx, fy] } = frame;
  const depths = keypoints.map((k) => k[2]).sort((a, b) => a - b), prior = depths[10];
  if (!(prior > 0)) throw new Error("the hand is not in front of the camera");
  let [left, right, top, bottom] = [width, -1, height, -1];
  mask.forEach((inside, i) => {
    if (!inside) return;
    const u = i % width, v = (i - u) / width;
    left = Math.min(left, u); right = Math.max(right, u);
    top = Math.min(top, v); bottom = Math.max(bottom, v);
  });
  if (right < 0) throw new Error("nothing is to be restored");
  const step = [fx, fy].map((f) => (live.config.pixel_m * f) / prior);
  return { prior, step, center: [(left + right) / 2, (top + bottom) / 2], size: live.config.crop };
};

// The pictures that the U-Net sees, and the vector of what else is known.
const seenOf = (frame, keypoints, mask, crop) => {
  const { width, height, camera: [fx, fy, cx, cy] } = frame, { size, center, step, prior } = crop;
  const { DEPTH_M, NEAR_M, GROUPS } = live.constants, groups = GROUPS.length;
  const seen = map(8 + 2 * groups, size, size), area = size * size;
  const value = (get, v, u) => (u < 0 || v < 0 || u >= width || v >= height ? 0 : get(v * width + u));
  const smooth = (get, v, u) => {
    const top = Math.floor(v), left = Math.floor(u), down = v - top, right = u - left;
    return (1 - down) * ((1 - right) * value(get, top, left) + right * value(get, top, left + 1)) +
      down * ((1 - right) * value(get, top + 1, left) + right * value(get, top + 1, left + 1));
  };
  const middle = [(center[0] - cx) / fx, (center[1] - cy) / fy];
  for (let j = 0, at = 0; j < size; j++) for (let i = 0; i < size; i++, at++) {
    const u = center[0] + (i - (size - 1) / 2) * step[0], v = center[1] + (j - (size - 1) / 2) * step[1];
    for (let c = 0; c < 3; c++) seen.data[c * area + at] = smooth((p) => frame.color[3 * p + c] / 255, v, u) - 0.5;
    seen.data[3 * area + at] = smooth((p) => mask[p], v, u);
    const measured = value((p) => (mask[p] ? 0 : frame.depth[p]), Math.round(v), Math.round(u));
    const off = (measured - prior) / NEAR_M, known = measured > 0 ? 1 : 0;
    seen.data[4 * area + at] = known * Math.min(Math.max(off, -1), 1);
    seen.data[5 * area + at] = known * (Math.abs(off) < 1 ? 1 : 0);
    seen.data[(6 + 2 * groups) * area + at] = middle[0];
    seen.data[(7 + 2 * groups) * area + at] = middle[1];
  }
  const uv = keypoints.map(([x, y, z]) => [(fx * x) / z + cx, (fy * y) / z + cy]);
  GROUPS.forEach((group, g) => group.forEach((k) => {
    const [x, y] = uv[k].map((p, axis) => (p - center[axis]) / step[axis] + (size - 1) / 2);
    const height = (keypoints[k][2] - prior) / DEPTH_M;
    for (let j = 0, at = 0; j < size; j++) for (let i = 0; i < size; i++, at++) {
      const blob = Math.exp(-((i - x) ** 2 + (j - y) ** 2) / 12.5);
      seen.data[(6 + g) * area + at] += blob;
      seen.data[(6 + groups + g) * area + at] += blob * height;
    }
  }));
  const known = keypoints.flatMap((k, n) => [
    ((uv[n][0] - center[0]) / fx) * prior / DEPTH_M, ((uv[n][1] - center[1]) / fy) * prior / DEPTH_M,
    (k[2] - prior) / DEPTH_M]);
  return [seen, known.concat(middle.map((m) => 3 * m))];
};

// EfficientNet-Lite0's maps of strides 4, 8 and 16, from the crop's colour; its padding changes sides.
const lite = (crop) => {
  const { rows, ends } = live.config.lite, area = crop.h * crop.w;
  const before = (size, stride, left) => (stride > 1 ? size - stride + left : size - 1) >> 1;
  const normed = (name, n) => folded(`${name}.${n}`, `${name}.${n + 1}`, 1e-3);
  let x = { c: 3, h: crop.h, w: crop.w, data: crop.data.slice(0, 3 * area).map((v) => ((v + 0.5) * 255 - 127) / 128) };
  x = relu6(convolved(x, normed("lite.stem", 1), 2, before(3, 2, 0)));
  let halved = 1;
  const maps = [];
  rows.forEach(([expand, channels, size, first, blocks], r) => {
    for (let n = 0; n < blocks; n++) {
      const name = `lite.rows.${r}.${n}.layers`, stride = n ? 1 : first, wide = expand > 1 ? 4 : 0;
      let y = wide ? relu6(convolved(x, normed(name, 1))) : x;
      y = relu6(depthwise(y, normed(name, wide + 1), stride, before(size, stride, halved % 2)));
      y = convolved(y, normed(name, wide + 5));
      x = stride === 1 && x.c === channels ? added(y, x) : y;
      if (stride === 2) halved++;
    }
    if (ends.includes(r)) maps.push(x);
  });
  return maps;
};

const unet = (crop, given) => {
  const maps = live.config.lite ? lite(crop) : [];
  const blocks = (name, x) => {
    for (let n = 0; live.tensors[`${name}.${n}.first.0.weight`]; n++) x = residual(`${name}.${n}`, x);
    return x;
  };
  let x = layer("unet.stem.1", layer("unet.stem.0", unshuffled(crop, 2)), 2);
  const skipped = [];
  for (let n = 0; n < 3; n++) {
    if (n) x = layer(`unet.down.${n - 1}`, x, 2);
    if (maps[n]) x = added(x, convolved(maps[n], folded(`unet.further.${n}`, "")));
    x = blocks(`unet.left.${n}`, x);
    skipped.push(x);
  }
  const view = pooled(convolved(x, folded("unet.seen", "")), 4);
  const gate = (v) => v.map((a) => a / (1 + Math.exp(-a)));
  const all = gate(linear("unet.join.2", gate(linear("unet.join.0", view.concat(given)))));
  const onto = linear("unet.to_map", all), area = x.h * x.w;
  x = { ...x, data: x.data.map((v, i) => v + onto[Math.floor(i / area)]) };
  for (const n of [1, 0]) x = residual(`unet.right.${n}`, layer(`unet.up.${n}`, joined([enlarged(x, 2), skipped[n]])));
  return [x, linear("unet.answer", all)];
};

// Depth of the masked pixels in metres, 0 elsewhere, as a Float32Array of the frame's size.
// frame: {width, height, camera: [fx, fy, cx, cy], color: RGB bytes, depth: metres, 0 = missing}.
live.restore = (frame, keypoints, mask) => {
  const crop = cropOf(frame, keypoints, mask), { size, center, step, prior } = crop;
  const [values, whole] = unet(...seenOf(frame, keypoints, mask, crop));
  const { DEPTH_M, UNITS } = live.constants, count = live.config.candidates;
  const coarse = enlarged(head("coarse", values), 4), fine = shuffled(head("fine", values), 4), area = size * size;
  for (let i = 0; i < 2 * count * area; i++) coarse.data[i] += fine.data[i];
  const plane = whole.map((v, i) => v * UNITS[i]);
  const pixel = step.map((s, axis) => (s * prior) / frame.camera[axis]);
  const depth = new Float32Array(frame.width * frame.height);
  mask.forEach((inside, p) => {
    if (!inside) return;
    const at = [p % frame.width, Math.floor(p / frame.width)].map((q, axis) =>
      Math.min(Math.max((q - center[axis]) / step[axis] + (size - 1) / 2, 0), size - 1));
    const [left, top] = at.map((q) => Math.min(Math.floor(q), size - 2)), [right, down] = [at[0] - left, at[1] - top];
    const value = (c) => {
      const i = c * area + top * size + left;
      return (1 - down) * ((1 - right) * coarse.data[i] + right * coarse.data[i + 1]) +
        down * ((1 - right) * coarse.data[i + size] + right * coarse.data[i + size + 1]);
    };
    let best = 0;
    for (let m = 1; m < count; m++) if (value(count + m) > value(count + best)) best = m;
    const lying = live.config.plane ? plane[0] + plane[1] * pixel[0] * (at[0] - (size - 1) / 2) +
      plane[2] * pixel[1] * (at[1] - (size - 1) / 2) : 0;
    depth[p] = Math.max(prior + lying + DEPTH_M * (value(best) + live.tensors.start.data[best]), 0);
  });
  return depth;
};

// What `hadr restore` does without a hand: each pixel of the hole takes the nearest measured depth.
live.nearest = (frame, mask) => {
  const { width } = frame, depth = new Float32Array(mask.length);
  const known = Array.from(mask.keys()).filter((p) => !mask[p] && frame.depth[p] > 0);
  if (!known.length) throw new Error("nothing was measured outside of the hole");
  const columns = known.map((p) => p % width), rows = known.map((p) => Math.floor(p / width));
  mask.forEach((inside, p) => {
    if (!inside) return;
    const u = p % width, v = Math.floor(p / width);
    let best = 0, least = Infinity;
    for (let n = 0; n < known.length; n++) {
      const far = (columns[n] - u) ** 2 + (rows[n] - v) ** 2;
      if (far < least) { least = far; best = n; }
    }
    depth[p] = frame.depth[known[best]];
  });
  return depth;
};
