// What scrolls sideways can be reached with the keyboard, also once it is unfolded.
const reach = () => {
  for (const box of document.querySelectorAll(".bd-article :is(pre, figure, div)"))
    if (box.scrollWidth > box.clientWidth && ["auto", "scroll"].includes(getComputedStyle(box).overflowX))
      box.tabIndex = 0;
};
for (const change of ["load", "resize"]) addEventListener(change, () => setTimeout(reach, 300));
document.addEventListener("click", () => setTimeout(reach, 300));
