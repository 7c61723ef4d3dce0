// Light or dark: as the system has it, until the switch is used.
(() => {
  const root = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const apply = (theme) => { root.dataset.theme = theme; dispatchEvent(new Event("themechange")); };
  const current = () => chosen || (system.matches ? "dark" : "light");
  apply(current());
  system.addEventListener("change", () => apply(current()));
  addEventListener("beforeprint", () => apply("light"));
  addEventListener("afterprint", () => apply(current()));
  document.addEventListener("click", (event) => {
    if (!event.target.closest("#theme")) return;
    chosen = current() === "dark" ? "light" : "dark";
    apply(chosen);
  });
})();
