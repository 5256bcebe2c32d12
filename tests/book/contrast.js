// Texts that stand out too little from what is behind them (WCAG 2: 4.5 to 1, large ones 3 to 1), and
// what lies behind each picture. Also inside of frames.
(() => {
  const documents = (doc) => [doc, ...[...doc.querySelectorAll("iframe")]
    .filter((frame) => frame.contentDocument).flatMap((frame) => documents(frame.contentDocument))];
  const probe = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const known = new Map();
  const parse = (text) => {  // any CSS colour as [r, g, b, alpha]
    if (!known.has(text)) {
      const plain = /^rgba?\(([^)]+)\)$/.exec(text);
      if (plain) {
        const numbers = plain[1].split(/[\s,/]+/).map(Number);
        known.set(text, [numbers[0], numbers[1], numbers[2], numbers[3] ?? 1]);
      } else {
        probe.clearRect(0, 0, 1, 1); probe.fillStyle = text; probe.fillRect(0, 0, 1, 1);
        const [r, g, b, a] = probe.getImageData(0, 0, 1, 1).data;
        known.set(text, [r, g, b, a / 255]);
      }
    }
    return known.get(text);
  };
  const over = (top, below) => [0, 1, 2].map((i) => top[3] * top[i] + (1 - top[3]) * below[i]);
  const style = (element) => element.ownerDocument.defaultView.getComputedStyle(element);
  const behind = new Map();
  const backdrop = (element) => {  // the opaque colour on which the element's content stands
    if (!element) return [255, 255, 255];
    if (!behind.has(element)) {
      const own = parse(style(element).backgroundColor);
      const frame = element.parentElement === null && element.ownerDocument.defaultView.frameElement;
      const below = own[3] === 1 ? null : backdrop(frame || element.parentElement);
      behind.set(element, below ? over(own, below) : own.slice(0, 3));
    }
    return behind.get(element);
  };
  const fades = new Map();
  const fading = (element) => {
    if (!fades.has(element))
      fades.set(element, Number(style(element).opacity) * (element.parentElement ? fading(element.parentElement) : 1));
    return fades.get(element);
  };
  const luminance = (colour) => {
    const [r, g, b] = colour.map((v) => {
      const c = v / 255;
      return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (a, b) => {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
  };
  const weak = new Map();
  let texts = 0;
  const look = (element, text) => {
    if (!element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) return;
    if (element.closest(".visually-hidden, .sr-only, mjx-assistive-mml, script, style, noscript, select")) return;
    const box = element.getBoundingClientRect();
    if (box.width < 2 || box.height < 2 || element.closest("[disabled], [aria-disabled=true]")) return;
    texts += 1;
    const css = style(element), below = backdrop(element);
    const colour = parse(element.closest("svg") ? css.fill : css.color);
    const opacity = fading(element);
    const found = ratio(over([...colour.slice(0, 3), colour[3] * opacity], below), below);
    const size = parseFloat(css.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(css.fontWeight) >= 700);
    if (found + 0.005 >= (large ? 3 : 4.5)) return;
    const rgb = (c) => c.map((v) => Math.round(v)).slice(0, 3).join(",");
    const place = `${element.tagName.toLowerCase()}.${[...element.classList].join(".")}`.slice(0, 50);
    const key = `${place} (${rgb(colour)} on ${rgb(below)})`;
    if (!weak.has(key)) weak.set(key, `${found.toFixed(2)} ${key} ${text.trim().slice(0, 40)}`);
  };
  const pictures = [];
  for (const doc of documents(document)) {
    const walker = doc.createTreeWalker(doc.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode())
      if (walker.currentNode.data.trim()) look(walker.currentNode.parentElement, walker.currentNode.data);
    for (const formula of doc.querySelectorAll("mjx-container")) look(formula, "formula");
    for (const image of doc.querySelectorAll("article img, #stage img"))
      if (image.checkVisibility())
        pictures.push({ src: image.src, behind: backdrop(image).map((v) => Math.round(v)) });
  }
  return { texts, weak: [...weak.values()], pictures };
})()
