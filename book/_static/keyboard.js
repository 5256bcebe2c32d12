// What scrolls sideways can be reached with the keyboard, also once it is unfolded; its edge fades
// where there is more.
const reach = () => {
  for (const box of document.querySelectorAll(".bd-article :is(pre, figure, div)")) {
    const hidden = box.scrollWidth - box.clientWidth;
    const scrolls = hidden > 1 && ["auto", "scroll"].includes(getComputedStyle(box).overflowX);
    if (scrolls && box.tabIndex < 0) {
      box.tabIndex = 0;
      box.addEventListener("scroll", reach, { passive: true });
    }
    box.classList.toggle("goes-on", scrolls && box.scrollLeft < hidden - 4);
  }
};
for (const change of ["load", "resize"]) addEventListener(change, () => setTimeout(reach, 300));
document.addEventListener("click", () => setTimeout(reach, 300));
