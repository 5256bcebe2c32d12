// What sticks out of the window, once every folded part of the page is open. Also inside of frames.
(() => {
  const documents = (doc) => [doc, ...[...doc.querySelectorAll("iframe")]
    .filter((frame) => frame.contentDocument).flatMap((frame) => documents(frame.contentDocument))];
  for (const part of document.querySelectorAll("main details, article details")) part.open = true;
  for (const part of document.querySelectorAll("article .toggle-hidden"))
    part.classList.remove("toggle-hidden");
  const told = (element) => `${element.tagName.toLowerCase()}.${element.classList}`.slice(0, 60) +
    ` ${(element.textContent || element.src || "").trim().replace(/\s+/g, " ").slice(0, 50)}`;
  const style = (element) => element.ownerDocument.defaultView.getComputedStyle(element);
  const scrolls = (element) => ["auto", "scroll"].includes(style(element).overflowX);
  const hides = (element) => ["hidden", "clip"].includes(style(element).overflowX);
  const outside = [], hidden = [], squeezed = [], small = [], overlapping = [];
  for (const doc of documents(document)) {
    const width = doc.documentElement.clientWidth;
    const area = doc.querySelector("main") || doc.body;
    if (doc.documentElement.scrollWidth > width + 1)
      outside.push(`${doc.title}: ${doc.documentElement.scrollWidth} px in ${width}`);
    for (const element of area.querySelectorAll("*")) {
      const box = element.getBoundingClientRect();
      if (!box.width || !box.height || element.closest("mjx-assistive-mml, .visually-hidden, .sr-only")) continue;
      if (style(element).visibility === "hidden") continue;
      // Past the window's edge, or past the edge of a box that cuts it off, and out of a finger's reach.
      let reach = null;
      for (let up = element.parentElement; up && up !== doc.body; up = up.parentElement) {
        if (scrolls(up)) { reach = "scrolls"; break; }
        const edge = up.getBoundingClientRect();
        if (hides(up) && box.right > edge.right + 2 && !up.closest("svg")) { reach = "cut"; break; }
      }
      // A film or a frame that moves has to be seen as a whole.
      if (["VIDEO", "IFRAME"].includes(element.tagName) && box.width > width + 1) reach = null;
      if (reach === "cut") hidden.push(told(element));
      else if (reach === null && (box.right > width + 1 || box.left < -1)) outside.push(told(element));
    }
    // A scrubber's picture must not lose its room to the sliders below it.
    const stage = doc !== document && doc.querySelector("#stage img");
    if (stage && stage.naturalWidth) {
      const drawn = Math.min(stage.clientWidth, stage.clientHeight * stage.naturalWidth / stage.naturalHeight);
      if (drawn < 0.9 * Math.min(width, stage.naturalWidth))
        squeezed.push(`${doc.title}: ${Math.round(drawn)} px wide in a frame of ${width}`);
    }
    // Figures are drawn with letters of 10 points, 15 pixels, at their natural size or the one stated.
    for (const image of doc.querySelectorAll(".cell_output img, #stage img")) {
      const meant = image.style.width.endsWith("px") ? parseFloat(image.style.width) : image.naturalWidth;
      const scale = image.getBoundingClientRect().width / meant;
      if (image.naturalWidth && scale > 0 && scale < 0.55)
        small.push(`${(image.alt || image.src).slice(0, 60)}: at ${scale.toFixed(2)} of its size`);
    }
    // Texts that lie on one another, each of them an element without another such one.
    const texts = "p, label, button, output, figcaption, summary, td, th, h1, h2, h3, h4";
    const leaves = [...area.querySelectorAll(texts)]
      .filter((e) => e.textContent.trim() && !e.querySelector(texts) && e.checkVisibility({ visibilityProperty: true, opacityProperty: true }))
      .map((e) => [e, e.getBoundingClientRect()]).filter(([, box]) => box.width > 2 && box.height > 2)
      .sort(([, a], [, b]) => a.top - b.top);
    leaves.forEach(([element, box], at) => {
      for (const [other, below] of leaves.slice(at + 1)) {
        if (below.top > box.bottom - 4) break;
        if (Math.min(box.right, below.right) - Math.max(box.left, below.left) > 4 && !element.contains(other) && !other.contains(element))
          overlapping.push(`${told(element)} / ${told(other)}`);
      }
    });
    if (doc !== document && doc.documentElement.scrollHeight > doc.documentElement.clientHeight + 1)
      squeezed.push(`${doc.title}: ${doc.documentElement.scrollHeight} px high in ${doc.documentElement.clientHeight}`);
  }
  // On a desktop what is printed and what stands in a table is seen without scrolling; on a phone
  // a table's caption is.
  const cut = window.innerWidth < 1200 ?
    [...document.querySelectorAll(".pst-scrollable-table-container caption")]
      .filter((words) => words.getBoundingClientRect().right >
        words.closest(".pst-scrollable-table-container").getBoundingClientRect().right + 1).map(told) :
    [...document.querySelectorAll(".cell_output pre, .pst-scrollable-table-container")]
      .filter((box) => box.scrollWidth > box.clientWidth + 1).map(told);
  return { cut, outside: [...new Set(outside)], hidden: [...new Set(hidden)], squeezed, small, overlapping };
})()
