// The page on which a reader restores a glass: picture, hand and hole on the left, cloud on the right.
"use strict";
live.frames = [];
live.frame = (stored) => live.frames.push(stored);

live.open = (home, weights) => {
  const find = (name) => home.querySelector(`[data-part="${name}"]`);
  const picture = find("picture"), cloud = find("cloud"), told = find("told"), view = { turn: 0.5, lift: 0.25 };
  const sliders = ["right", "up", "away"].map((name) => find(name));
  const brush = find("brush"), FINGERS = [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12], [13, 14, 15, 16], [17, 18, 19, 20]];
  let frame, mask, window_, shown, restored = null, ready = false, wanted = 0;

  const hand = () => {
    const [right, up, away] = sliders.map((slider) => slider.value / 100);
    return frame.keypoints.map(([x, y, z]) => [x + right, y - up, z + away]);
  };
  const uv = ([x, y, z]) => [(frame.camera[0] * x) / z + frame.camera[2], (frame.camera[1] * y) / z + frame.camera[3]];

  const say = (slider) => { slider.nextElementSibling.textContent = `${slider.value} cm`; };

  live.show = (number) => {
    frame = live.unpacked(live.frames[number]);
    mask = frame.inside.slice();
    for (const slider of sliders) { slider.value = 0; say(slider); }
    // A square around glass and hand, in pixels of the frame.
    const spots = frame.keypoints.map(uv);
    mask.forEach((inside, i) => { if (inside) spots.push([i % frame.width, Math.floor(i / frame.width)]); });
    const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((axis) => pick(...spots.map((s) => s[axis]))));
    const side = Math.min(1.15 * Math.max(high[0] - low[0], high[1] - low[1], 60), frame.height);
    const corner = [0, 1].map((axis) => Math.min(Math.max((low[axis] + high[axis] - side) / 2, 0), [frame.width, frame.height][axis] - side));
    window_ = { left: corner[0], top: corner[1], side };
    shown = new Image();
    shown.onload = drawPicture;
    shown.src = `data:image/jpeg;base64,${frame.shown}`;
    ask();
  };

  // ---- the picture, the hole and the hand ----
  const drawPicture = () => {
    const pen = picture.getContext("2d"), { left, top, side } = window_, zoom = picture.width / side;
    const fine = shown.naturalWidth / frame.width;
    const at = ([u, v]) => [(u + 0.5 - left) * zoom, (v + 0.5 - top) * zoom];
    if (shown.naturalWidth)
      pen.drawImage(shown, left * fine, top * fine, side * fine, side * fine, 0, 0, picture.width, picture.width);
    pen.fillStyle = "rgb(0 114 178 / 45%)";
    mask.forEach((inside, i) => {
      if (!inside) return;
      const edges = [0.5, -0.5].map((half) => at([(i % frame.width) - half, Math.floor(i / frame.width) - half]).map(Math.round));
      pen.fillRect(...edges[0], edges[1][0] - edges[0][0], edges[1][1] - edges[0][1]);
    });
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
  const ask = () => {
    const mine = ++wanted;
    if (frame) drawPicture();
    if (!ready) { restored = null; told.textContent = "The hole is empty: load the network."; return drawCloud(); }
    setTimeout(() => {
      if (mine !== wanted) return;
      const started = performance.now();
      try { restored = live.restore(frame, hand(), mask); } catch (problem) {
        restored = null;
        told.textContent = `No answer: ${problem.message}. The button "as it was" begins anew.`;
        return drawCloud();
      }
      const spent = performance.now() - started;
      let square = 0, right = 0, count = 0, all = 0;
      restored.forEach((z, i) => {
        if (z > 0) all++;
        if (!(z > 0 && frame.inside[i] && frame.truth[i] > 0)) return;
        const off = Math.abs(z - frame.truth[i]);
        square += off * off; right += off < 0.02; count++;
      });
      told.textContent = count
        ? `On the glass it is off by ${(100 * Math.sqrt(square / count)).toFixed(1)} cm (root mean square); ` +
          `${Math.round((100 * right) / count)} % are right to 2 cm. ${all} pixels in ${spent.toFixed(0)} ms.`
        : `${all} pixels in ${spent.toFixed(0)} ms, none of them of the glass.`;
      drawCloud();
    }, 20);
  };

  // ---- the cloud ----
  const points = () => {
    const { width, camera: [fx, fy, cx, cy] } = frame, found = [], far = hand()[9][2] + 0.15, truth = find("truth").checked;
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
    const scale = size / 0.3, seen = points().map(([x, y, z, color]) => {
      const [a, b, c] = [x - middle[0], y - middle[1], z - middle[2]];
      const [across, deep] = [cosine * a + sine * c, cosine * c - sine * a];
      return [size / 2 + scale * across, size / 2 + scale * (out * b + up * deep), out * deep - up * b, color];
    }).sort((a, b) => b[2] - a[2]);
    for (const [x, y, , color] of seen) { pen.fillStyle = color; pen.fillRect(x - 2, y - 2, 4, 4); }
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
  find("truth").addEventListener("change", drawCloud);
  find("wider").addEventListener("click", () => grown(1));
  find("narrower").addEventListener("click", () => grown(0));
  find("reset").addEventListener("click", () => live.show(+choice.value));
  find("load").addEventListener("click", () => {
    find("load").disabled = true;
    told.textContent = "The network is on its way.";
    const script = document.createElement("script");
    script.src = weights;
    script.onload = () => { ready = true; find("load").hidden = true; ask(); };
    script.onerror = () => { find("load").disabled = false; told.textContent = `${weights} could not be read.`; };
    document.head.append(script);
  });
  live.show(0);
};
addEventListener("DOMContentLoaded", () => live.open(document.getElementById("live"), "_static/live_weights.js"));
