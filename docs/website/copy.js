// The button that copies a block is in a navigation of its own: numbers tell these apart for screen readers.
new MutationObserver(() => {
  document.querySelectorAll(".md-code__nav").forEach((nav, index) => nav.setAttribute("aria-label", `Block ${index + 1}`));
}).observe(document.body, { childList: true, subtree: true });
