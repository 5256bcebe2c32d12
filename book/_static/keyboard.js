// What scrolls sideways can be reached with the keyboard, also once it is unfolded; its edge fades
// where there is more.
const reach = (box) => {
  const hidden = box.scrollWidth - box.clientWidth;
  const scrolls = hidden > 1 && ["auto", "scroll"].includes(getComputedStyle(box).overflowX);
  if (scrolls && box.tabIndex < 0) box.tabIndex = 0;
  const caption = scrolls && box.querySelector(":scope > figcaption");  // stays as it is
  const [top, under] = [box, caption].map((part) => part && part.getBoundingClientRect().top);
  if (caption) box.style.setProperty("--above", `${under - top}px`);
  box.classList.toggle("goes-on", scrolls && box.scrollLeft < hidden - 4);
};
// Unfolding gives a box its size; the theme sets its own tab stops on loading.
const sizes = new ResizeObserver((changed) => changed.forEach(({ target }) => reach(target)));
const boxes = () => document.querySelectorAll(".bd-article :is(pre, figure, div, span.math)");
const watch = (box) => {
  sizes.observe(box);
  box.addEventListener("scroll", () => reach(box), { passive: true });
};
addEventListener("DOMContentLoaded", () => boxes().forEach(watch));
addEventListener("load", () => {
  setTimeout(() => boxes().forEach(reach), 300);
  // Equations are set later.
  window.MathJax?.startup?.promise?.then(() =>
    document.querySelectorAll(".bd-article mjx-container").forEach(watch));
});
