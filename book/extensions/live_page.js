// The page on which a reader restores a glass: picture, hand and hole; depth or error; the cloud.
"use strict";
live.frames = [];
live.frame = (stored) => live.frames.push(stored);

live.open = (home, weights) => {
  const find = (name) => home.querySelector(`[data-part="${name}"]`);
  const picture = find("picture"), cloud = find("cloud"), told = find("told"), view = { turn: 0.5, lift: 0.25 };
  const sliders = ["right", "up", "away"].map((name) => find(name)), hidden = find("hidden"), map_ = find("map");
  const brush = find("brush"), FINGERS = [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12], [13, 14, 15, 16], [17, 18, 19, 20]];
  let frame, mask, window_, shown, first = null, restored = null, ready = false, wanted = 0;

  const hand = () => {
    const [right, up, away] = sliders.map((slider) => slider.value / 100);
    return frame.keypoints.map(([x, y, z]) => [x + right, y - up, z + away]);
  };
  const uv = ([x, y, z]) => [(frame.camera[0] * x) / z + frame.camera[2], (frame.camera[1] * y) / z + frame.camera[3]];

  const say = (slider) => { slider.nextElementSibling.textContent = `${slider.value} cm`; };

  live.show = (number) => {
    frame = live.unpacked(live.frames[number]);
    mask = frame.inside.slice();
    for (const slider of sliders) { slider.value = 0; slider.disabled = false; say(slider); }
    hidden.checked = false;
    first = restored = null;
    // A square around glass and hand, in pixels of the frame.
    const spots = frame.keypoints.map(uv);
    mask.forEach((inside, i) => { if (inside) spots.push([i % frame.width, Math.floor(i / frame.width)]); });
    const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((axis) => pick(...spots.map((s) => s[axis]))));
    const side = Math.min(1.15 * Math.max(high[0] - low[0], high[1] - low[1], 60), frame.height);
    const corner = [0, 1].map((axis) => Math.min(Math.max((low[axis] + high[axis] - side) / 2, 0), [frame.width, frame.height][axis] - side));
    window_ = { left: corner[0], top: corner[1], side };
    shown = Object.assign(document.createElement("canvas"), { width: frame.width, height: frame.height });
    const pixels = new ImageData(frame.width, frame.height);
    mask.forEach((_, i) => pixels.data.set([...frame.color.subarray(3 * i, 3 * i + 3), 255], 4 * i));
    shown.getContext("2d").putImageData(pixels, 0, 0);
    ask();
  };

  // ---- the picture, the hole and the hand ----
  const drawPicture = () => {
    const pen = picture.getContext("2d"), { left, top, side } = window_, zoom = picture.width / side;
    const at = ([u, v]) => [(u + 0.5 - left) * zoom, (v + 0.5 - top) * zoom];
    pen.drawImage(shown, left, top, side, side, 0, 0, picture.width, picture.width);
    pen.fillStyle = "rgb(0 114 178 / 45%)";
    mask.forEach((inside, i) => {
      if (!inside) return;
      const edges = [0.5, -0.5].map((half) => at([(i % frame.width) - half, Math.floor(i / frame.width) - half]).map(Math.round));
      pen.fillRect(...edges[0], edges[1][0] - edges[0][0], edges[1][1] - edges[0][1]);
    });
    if (hidden.checked) return;
    const spots = hand().map((k) => at(uv(k)));
    for (const finger of FINGERS) {
      pen.beginPath();
      [0, ...finger].forEach((k, n) => (n ? pen.lineTo(...spots[k]) : pen.moveTo(...spots[k])));
      for (const [color, wide] of [["white", 5], ["#D55E00", 2.5]]) { pen.strokeStyle = color; pen.lineWidth = wide; pen.stroke(); }
    }
  };
  let drawn = null, last = null;
  const dab = (u, v) => {
    const { left, top, side } = window_;
    for (let j = -3; j <= 3; j++) for (let i = -3; i <= 3; i++) {
      const [column, row] = [Math.round(u - 0.5) + i, Math.round(v - 0.5) + j];
      const seen = column >= left && row >= top && column < Math.min(left + side, frame.width) && row < Math.min(top + side, frame.height);
      if (i * i + j * j <= 9 && seen) mask[row * frame.width + column] = drawn;
    }
  };
  // A stroke is drawn from one place of the pointer to the next.
  const paint = (event) => {
    const box = picture.getBoundingClientRect(), { left, top, side } = window_;
    const here = [left + ((event.clientX - box.left) / box.width) * side, top + ((event.clientY - box.top) / box.height) * side];
    const from = last ?? here, steps = Math.ceil(Math.hypot(here[0] - from[0], here[1] - from[1]));
    for (let n = 0; n <= steps; n++) dab(...here.map((end, axis) => from[axis] + ((end - from[axis]) * n) / Math.max(steps, 1)));
    last = here;
    drawPicture();
  };
  brush.addEventListener("change", () => { picture.style.touchAction = brush.value ? "none" : "auto"; });
  picture.addEventListener("pointerdown", (event) => {
    if (!brush.value) return;
    drawn = brush.value === "adds" ? 1 : 0;
    last = null;
    picture.setPointerCapture(event.pointerId);
    paint(event);
  });
  picture.addEventListener("pointermove", (event) => { if (drawn !== null) paint(event); });
  for (const end of ["pointerup", "pointercancel"]) picture.addEventListener(end, () => { if (drawn !== null) { drawn = null; ask(); } });
  // All pixels with a neighbour that is, or is not, of the hole.
  const grown = (value) => {
    const old = mask.slice(), { width } = frame;
    old.forEach((inside, i) => {
      if (inside !== value) return;
      const column = i % width;
      if (column) mask[i - 1] = value;
      if (column < width - 1) mask[i + 1] = value;
      if (i >= width) mask[i - width] = value;
      if (i + width < old.length) mask[i + width] = value;
    });
    drawPicture();
    ask();
  };

  // ---- the network ----
  const draw = () => { drawPicture(); drawMap(); drawCloud(); };
  const WITHOUT = "Without a hand HADR-plus has no answer: it was never trained for that. As hadr restore does then, " +
    "each pixel of the hole takes the nearest measured depth. ";
  const ask = () => {
    const mine = ++wanted;
    drawPicture();
    if (!ready) return draw();
    told.textContent = "It computes.";
    setTimeout(() => {
      if (mine !== wanted) return;
      const started = performance.now();
      try {
        first ??= live.restore(frame, frame.keypoints, frame.inside);
        const same = !hidden.checked && sliders.every((slider) => +slider.value === 0) && mask.every((m, i) => m === frame.inside[i]);
        restored = same ? first : hidden.checked ? live.nearest(frame, mask) : live.restore(frame, hand(), mask);
        const count = restored.reduce((n, z) => n + (z > 0), 0);
        told.textContent = `${hidden.checked ? WITHOUT : ""}${count} pixels in ${(performance.now() - started).toFixed(0)} ms.`;
      } catch (problem) {
        restored = null;
        told.textContent = `No answer: ${problem.message}. The button "as it was" begins anew.`;
      }
      draw();
      tell();
    }, 20);
  };
  // What is right of an answer on the glass, and by how much it is farther than the first answer.
  const tell = () => [["first", first], ["now", restored]].forEach(([name, answer]) => {
    const off = [], moved = [];
    answer?.forEach((z, i) => {
      if (!(z > 0 && frame.inside[i] && frame.truth[i] > 0)) return;
      off.push(Math.abs(z - frame.truth[i]));
      moved.push(z - first[i]);
    });
    const cells = find(name).querySelectorAll("td"), centimetres = (x) => `${(100 * x).toFixed(1)} cm`;
    const root = Math.sqrt(off.reduce((sum, x) => sum + x * x, 0) / off.length), by = moved.sort((a, b) => a - b)[off.length >> 1];
    const right = Math.round((100 * off.filter((x) => x < 0.02).length) / off.length);
    const said = off.length ? [centimetres(root), `${right} %`, answer === first ? "" : (by > 0 ? "+" : "") + centimetres(by)] : ["", "", ""];
    cells.forEach((cell, n) => { cell.textContent = said[n]; });
  });

  // ---- the depth, or its error ----
  const SCALES = {
    depth: { colors: [[253, 231, 37], [94, 201, 98], [33, 145, 140], [59, 82, 139], [68, 1, 84]], range: () => [-0.1, 0.15].map((x) => median() + x) },
    error: { colors: [[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]], range: () => [-0.05, 0.05] },
  };
  const median = () => frame.keypoints.map((k) => k[2]).sort((a, b) => a - b)[10];
  const drawMap = () => {
    const pen = map_.getContext("2d"), size = map_.width, foot = size - 44, { left, top, side } = window_;
    const kind = find("kind").value, { colors, range } = SCALES[kind], [low, high] = range();
    const color = (value) => {
      const at = Math.min(Math.max((4 * (value - low)) / (high - low), 0), 4), n = Math.min(Math.floor(at), 3);
      return `rgb(${[0, 1, 2].map((c) => Math.round(colors[n][c] + (at - n) * (colors[n + 1][c] - colors[n][c]))).join(" ")})`;
    };
    pen.fillStyle = "#c9c9c9";
    pen.fillRect(0, 0, size, size);
    const zoom = size / side, edge = (p, from) => Math.round((p - from) * zoom);
    for (let v = Math.floor(top); v < top + side; v++) for (let u = Math.floor(left); u < left + side; u++) {
      const i = v * frame.width + u, z = mask[i] ? restored?.[i] : frame.depth[i];
      if (!(z > 0) || (kind === "error" && !(mask[i] && frame.truth[i] > 0))) continue;
      pen.fillStyle = color(kind === "error" ? z - frame.truth[i] : z);
      pen.fillRect(edge(u, left), edge(v, top), edge(u + 1, left) - edge(u, left), edge(v + 1, top) - edge(v, top));
    }
    pen.fillStyle = "white";
    pen.fillRect(0, foot, size, size - foot);
    for (let x = 0; x < size; x++) { pen.fillStyle = color(low + ((high - low) * x) / size); pen.fillRect(x, foot, 1, 14); }
    pen.fillStyle = "black";
    pen.font = "22px sans-serif";
    [low, (low + high) / 2, high].forEach((value, n) => {
      pen.textAlign = ["left", "center", "right"][n];
      pen.fillText(`${(100 * value).toFixed(0)} cm`, [6, size / 2, size - 6][n], size - 7);
    });
  };

  // ---- the cloud ----
  const points = () => {
    const { width, camera: [fx, fy, cx, cy] } = frame, found = [], far = median() + 0.15, truth = find("truth").checked;
    const add = (i, z, color) => {
      const u = i % width, v = Math.floor(i / width);
      found.push([((u - cx) * z) / fx, ((v - cy) * z) / fy, z, color]);
    };
    for (let i = 0; i < mask.length; i++) {
      if (!mask[i] && frame.depth[i] > 0 && frame.depth[i] < far) {
        const [r, g, b] = frame.color.subarray(3 * i, 3 * i + 3);
        add(i, frame.depth[i], `rgb(${r} ${g} ${b})`);
      }
      if (restored && restored[i] > 0) add(i, restored[i], "#0072B2");
      if (truth && frame.inside[i] && frame.truth[i] > 0) add(i, frame.truth[i], "#009E73");
    }
    return found;
  };
  const drawCloud = () => {
    const pen = cloud.getContext("2d"), size = cloud.width;
    pen.fillStyle = "#e6eaee";
    pen.fillRect(0, 0, size, size);
    if (!frame) return;
    let middle = [0, 0, 0], count = 0;
    frame.inside.forEach((inside, i) => {
      const z = frame.truth[i];
      if (!inside || !z) return;
      const [fx, fy, cx, cy] = frame.camera;
      [((i % frame.width) - cx) * z / fx, (Math.floor(i / frame.width) - cy) * z / fy, z].forEach((p, k) => { middle[k] += p; });
      count++;
    });
    middle = middle.map((sum) => sum / Math.max(count, 1));
    const [cosine, sine, up, out] = [Math.cos(view.turn), Math.sin(view.turn), Math.sin(view.lift), Math.cos(view.lift)];
    const scale = size / 0.24, seen = points().map(([x, y, z, color]) => {
      const [a, b, c] = [x - middle[0], y - middle[1], z - middle[2]];
      const [across, deep] = [cosine * a + sine * c, cosine * c - sine * a];
      return [size / 2 + scale * across, size / 2 + scale * (out * b + up * deep), out * deep - up * b, color];
    }).sort((a, b) => b[2] - a[2]);
    const dot = Math.max(3, (0.8 * scale * median()) / frame.camera[0]);
    for (const [x, y, , color] of seen) { pen.fillStyle = color; pen.fillRect(x - dot / 2, y - dot / 2, dot, dot); }
  };
  let held = null;
  cloud.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; cloud.setPointerCapture(event.pointerId); });
  cloud.addEventListener("pointermove", (event) => {
    if (!held) return;
    view.turn += (event.clientX - held[0]) / 120;
    view.lift = Math.min(Math.max(view.lift + (event.clientY - held[1]) / 120, -1.5), 1.5);
    held = [event.clientX, event.clientY];
    drawCloud();
  });
  for (const end of ["pointerup", "pointercancel"]) cloud.addEventListener(end, () => { held = null; });
  cloud.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] }[event.key];
    if (!step) return;
    event.preventDefault();
    view.turn += step[0];
    view.lift += step[1];
    drawCloud();
  });

  // ---- the controls ----
  const choice = find("frame");
  live.frames.forEach((one, n) => choice.add(new Option(`${n + 1} of ${live.frames.length} (${one.name})`, n)));
  choice.addEventListener("change", () => live.show(+choice.value));
  sliders.forEach((slider) => slider.addEventListener("input", () => { say(slider); ask(); }));
  hidden.addEventListener("change", () => {
    for (const slider of sliders) slider.disabled = hidden.checked;
    ask();
  });
  find("truth").addEventListener("change", drawCloud);
  find("kind").addEventListener("change", drawMap);
  find("wider").addEventListener("click", () => grown(1));
  find("narrower").addEventListener("click", () => grown(0));
  find("reset").addEventListener("click", () => live.show(+choice.value));
  const load = () => {
    find("load").hidden = true;
    told.textContent = "The network (6 MB) is on its way.";
    const script = document.createElement("script");
    script.src = weights;
    script.onload = () => { ready = true; ask(); };
    script.onerror = () => { find("load").hidden = false; told.textContent = `${weights} could not be read.`; };
    document.head.append(script);
  };
  find("load").addEventListener("click", load);
  live.show(0);
  if (navigator.connection?.saveData) find("load").hidden = false;
  else load();
};
addEventListener("DOMContentLoaded", () => live.open(document.getElementById("live"), "_static/live_weights.js"));
