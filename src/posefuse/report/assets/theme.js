// Light or dark: as the system has it, until the switch is used; paper is light.
(() => {
  const root = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)"), print = matchMedia("print");
  let chosen = null;
  const apply = (theme) => { root.dataset.theme = theme; dispatchEvent(new Event("themechange")); };
  const current = () => root.classList.contains("paper") ? "light" : chosen || (system.matches ? "dark" : "light");
  // Printing and emulated print media lay out the page for paper; emulation fires no event of printing.
  function turnTo(paper) {
    if (paper === root.classList.contains("paper")) return;
    root.classList.toggle("paper", paper);
    apply(current());
    dispatchEvent(new Event(paper ? "topaper" : "toscreen"));
  }
  apply(current());
  system.addEventListener("change", () => apply(current()));
  addEventListener("beforeprint", () => turnTo(true));
  addEventListener("afterprint", () => turnTo(print.matches));
  print.addEventListener("change", () => turnTo(print.matches));
  document.addEventListener("click", (event) => {
    if (!event.target.closest("#theme")) return;
    chosen = current() === "dark" ? "light" : "dark";
    apply(chosen);
  });
})();
