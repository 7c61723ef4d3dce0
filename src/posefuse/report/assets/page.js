  // Links to the sections, the copy button, and colors of charts that follow the theme.
  document.querySelectorAll("main h2").forEach((heading, i) => {
    if (!heading.id) heading.id = `section-${i}`;
    element("sections").append(Object.assign(document.createElement("a"), { href: `#${heading.id}`, textContent: heading.dataset.short || heading.textContent }));
  });
  document.addEventListener("click", async (event) => {
    const button = event.target.closest("[data-copy]");
    if (!button) return;
    const source = element(button.dataset.copy);
    try {
      await navigator.clipboard.writeText(source.textContent);
      button.textContent = "Copied";
    } catch {
      // Pages from disk may lack the permission; the text is selected instead.
      getSelection().selectAllChildren(source);
      button.textContent = "Press Ctrl+C";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
  // What scrolls can be reached with the keyboard.
  function makeScrollable() {
    for (const box of document.querySelectorAll(".wide")) box.tabIndex = box.scrollWidth > box.clientWidth ? 0 : -1;
  }
  later(makeScrollable);
  addEventListener("resize", makeScrollable);
  const chartColors = () => ["ink", "line", "left", "right", "middle", "swapped", "measured", "filled", "missing", ...Array.from({ length: 10 }, (_, i) => `person-${i}`)].map((name) => css(`--${name}`));
  let drawnColors = chartColors();
  addEventListener("themechange", () => {
    const now = chartColors(), renewed = new Map(drawnColors.map((color, i) => [color, now[i]]));
    const renew = (value) => typeof value === "string" ? renewed.get(value) ?? value : Array.isArray(value) ? value.map(renew)
      : value && value.constructor === Object ? Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, key === "x" || key === "y" || key === "z" ? inner : renew(inner)])) : value;
    drawnColors = now;
    for (const plot of document.querySelectorAll(".js-plotly-plot")) Plotly.react(plot, renew(plot.data), renew(plot.layout), config);
  });
