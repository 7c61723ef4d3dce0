  // What takes long is done piece by piece after the first frame, while the browser is idle, and before a page is printed.
  const pending = [];
  let working = true;
  // Browsers without idle callbacks take a short pause instead; a busy page waits at most 0.2 s for the next piece.
  const whenIdle = window.requestIdleCallback ? (task) => requestIdleCallback(task, { timeout: 200 }) : (task) => setTimeout(task, 10);
  function work(deadline) {
    do {
      const next = pending.shift();
      working = Boolean(next);
      if (!next) { finishLoading(); return; }
      next();
    } while (deadline?.timeRemaining?.() > 10);
    whenIdle(work);
  }
  function later(task) {
    pending.push(task);
    if (working) return;
    working = true;
    whenIdle(work);
  }
  function runLibrary(id) {
    const library = document.createElement("script");
    library.textContent = document.getElementById(id).textContent;
    document.body.append(library);
  }
  // The page counts as loading until its charts are drawn, so that automatic captures of the loaded page are complete.
  // An open document in a frame delays the event `load`, and nothing else; for a long recording, at most 8 s.
  const MOST_LOADING_MS = 8000;
  const holder = Object.assign(document.createElement("iframe"), { hidden: true, title: "loading" });
  document.body.append(holder);
  holder.contentDocument?.open();
  function finishLoading() {
    if (!holder.isConnected) return;
    holder.contentDocument?.close();
    holder.remove();
  }
  setTimeout(finishLoading, MOST_LOADING_MS);
  // Two frames later, the first one is on the screen; pages in the background have no frames.
  const start = () => setTimeout(work);
  addEventListener("DOMContentLoaded", () => document.hidden ? start() : requestAnimationFrame(() => requestAnimationFrame(start)));
  const isPaper = () => document.documentElement.classList.contains("paper");
  addEventListener("topaper", () => { while (pending.length) pending.shift()(); });
