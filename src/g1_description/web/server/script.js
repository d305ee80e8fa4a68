// What the page does beside viser: sends files, copies texts, says what happened, takes
// typed numbers when they are whole, and spares phones and browsers without a GPU.
(() => {
  const readOnly = READ_ONLY;
  const TOAST_TIME = 6000;  // ms
  const PIECE = 256 * 1024;  // bytes
  const AHEAD = 4 * PIECE;  // most bytes that wait to be sent

  // Without a GPU a picture takes seconds with shadows and smooth edges: the server is
  // told to leave out the shadows. Viser's module runs after this script.
  const SOFTWARE = /swiftshader|llvmpipe|softpipe|basic render/i;
  const RESOLUTION = 0.75;  // of the window's pixels
  const make = HTMLCanvasElement.prototype.getContext;

  /** Tell whether the browser draws in software. */
  function drawsInSoftware() {
    const gl = make.call(document.createElement("canvas"), "webgl2");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return SOFTWARE.test(name);
  }

  const address = new URL(location);
  const slow = !address.searchParams.has("fixedDpr") && drawsInSoftware();
  document.cookie = "g1_slow=1; Path=/; SameSite=Strict" + (slow ? "" : "; Max-Age=0");
  if (slow) {
    address.searchParams.set("fixedDpr", RESOLUTION);
    history.replaceState(null, "", address);
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return make.call(this, kind, { ...options, antialias: false });
    };
  }

  // On a phone the panel covers half of the robot: it starts folded.
  if (matchMedia("(max-width: 36em) and (pointer: coarse)").matches) {
    new MutationObserver((_, observer) => {
      const head = document.querySelector("[style*='height: 3.5em'][style*='pointer']");
      if (head === null) return;
      observer.disconnect();
      head.click();
    }).observe(document.body, { childList: true, subtree: true });
  }

  const toasts = document.createElement("div");
  toasts.setAttribute("role", "status");
  toasts.style.cssText = "position:fixed;bottom:1em;left:50%;z-index:100000;"
    + "transform:translateX(-50%);max-width:90vw;pointer-events:none;font:14px sans-serif";
  const outline = document.createElement("div");
  outline.style.cssText = "position:fixed;inset:0;z-index:99999;pointer-events:none;"
    + "border:4px dashed #228be6;background:#228be622;display:none";
  document.body.append(outline, toasts);

  /** Show a sentence for some seconds. */
  function toast(text, failed) {
    const box = document.createElement("div");
    box.className = failed ? "g1-toast g1-failed" : "g1-toast";
    box.textContent = text;
    box.style.cssText = "margin-top:.5em;padding:.6em 1em;border-radius:6px;color:#fff;"
      + "overflow-wrap:anywhere;background:" + (failed ? "#c92a2a" : "#2b2f36");
    toasts.append(box);
    setTimeout(() => box.remove(), TOAST_TIME);
  }

  /** Send the pieces of a file, no faster than they go. */
  async function sendPieces(socket, file) {
    for (let start = 0; start < file.size; start += PIECE) {
      const piece = await file.slice(start, start + PIECE).arrayBuffer();
      while (socket.bufferedAmount > AHEAD) {
        await new Promise((resolve) => setTimeout(resolve, 20));
      }
      if (socket.readyState !== WebSocket.OPEN) return;
      socket.send(piece);
    }
  }

  /** Send a file over a connection of its own; resolve with what came of it. */
  function send(file) {
    return new Promise((resolve) => {
      const query = new URLSearchParams({ name: file.name, size: file.size });
      const scheme = location.protocol === "https:" ? "wss://" : "ws://";
      const socket = new WebSocket(scheme + location.host + "/upload?" + query);
      socket.onmessage = (event) => {
        const answer = JSON.parse(event.data);
        if (answer.state !== "ready") return resolve(answer);
        sendPieces(socket, file).catch(() => {
          resolve({ state: "failed", text: file.name + " cannot be read." });
          socket.close();
        });
      };
      const lost = { state: "failed", text: file.name + " could not be sent." };
      socket.onclose = () => resolve(lost);
    });
  }

  let sending = Promise.resolve();  // one file after the other

  /** Send a file; what came of it is shown. */
  function upload(file) {
    if (!file) return sending;
    if (readOnly) {
      toast("This page is read-only: files cannot be uploaded.", true);
      return sending;
    }
    toast("Sending " + file.name + " ...");
    sending = sending.then(() => send(file))
      .then((answer) => toast(answer.text, answer.state !== "done"));
    return sending;
  }

  /** Put text on the clipboard where the browser has no way for insecure pages. */
  function copyByHand(text) {
    const area = document.createElement("textarea");
    area.value = text;
    area.style.cssText = "position:fixed;opacity:0";
    document.body.append(area);
    area.select();
    const copied = document.execCommand("copy");
    area.remove();
    if (!copied) throw new Error("The browser does not let the page copy.");
  }

  /** Fetch a text of the page's server, and put it on the clipboard. */
  async function copy(path) {
    try {
      const response = await fetch(path, { cache: "no-store" });
      const text = await response.text();
      if (!response.ok) throw new Error(text);
      if (navigator.clipboard) await navigator.clipboard.writeText(text);
      else copyByHand(text);
      toast("Copied " + path.replace(/^\//, "") + ".");
    } catch (error) {
      toast(error.message, true);
    }
  }

  const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  const show = (visible) => { outline.style.display = visible ? "block" : "none"; };
  addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    show(true);
  }, true);
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) show(false); }, true);
  addEventListener("drop", (event) => {
    show(false);
    if (!hasFiles(event)) return;
    event.preventDefault();
    event.stopPropagation();
    for (const file of event.dataTransfer.files) upload(file);
  }, true);

  // Viser takes each key for a value: "-0" of "-0.5" for 0, and "1" of "1.05" for where
  // the robot shall go. So what is typed is kept from it until Enter, or the field is
  // left, and meanwhile the field is kept from what viser writes.
  const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)$/;
  const native = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  let typed = null;  // { field, property, shown }
  const isNumber = (field) => field instanceof HTMLInputElement && field.inputMode;

  /** Keep a field for the person who types into it. */
  function keep(field) {
    if (typed?.field === field) return;
    const property = Object.getOwnPropertyDescriptor(field, "value");  // React's
    typed = { field, property, shown: field.value };
    Object.defineProperty(field, "value", {
      configurable: true,
      get: native.get,
      set(value) { if (typed?.field === field) typed.shown = String(value); },
    });
  }

  /** Give the field back; hand on what was typed, if that is a number. */
  function commit() {
    if (typed === null) return;
    const { field, property, shown } = typed;
    const text = native.get.call(field).trim();
    typed = null;
    delete field.value;
    if (property) Object.defineProperty(field, "value", property);
    field.value = shown;
    if (text === shown || text === "" || !field.isConnected) return;
    if (!NUMBER.test(text)) return toast("'" + text + "' is no number such as -0.5.", true);
    enter(field, text.replace("+", ""));
  }

  /** Enter a number into a field. */
  function enter(field, text) {
    // As if all were replaced with one key: the field asks what was selected before, and
    // takes the focus a little later, which may have gone elsewhere.
    field.focus = () => {};
    setTimeout(() => delete field.focus, 200);
    field.setSelectionRange(0, field.value.length);
    field.dispatchEvent(new KeyboardEvent("keydown", { bubbles: true }));
    native.set.call(field, text);  // past React: it sees a change
    field.setSelectionRange(text.length, text.length);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }

  addEventListener("beforeinput", (event) => {
    if (event.isTrusted && isNumber(event.target)) keep(event.target);
  }, true);
  for (const name of ["input", "change"]) {
    addEventListener(name, (event) => {
      if (event.isTrusted && event.target === typed?.field) event.stopImmediatePropagation();
    }, true);
  }
  addEventListener("keydown", (event) => {
    if (event.key === "Escape" && typed !== null) native.set.call(typed.field, typed.shown);
    if (["Enter", "Tab", "Escape", "ArrowUp", "ArrowDown"].includes(event.key)) commit();
  }, true);
  addEventListener("pointerdown", (event) => {
    if (event.isTrusted && event.target !== typed?.field) commit();
  }, true);
  addEventListener("blur", (event) => {
    if (event.target === typed?.field) commit();
  }, true);

  // Viser tells of clicks only: a mouse that rests on the scene clicks with keys that
  // nobody holds together, and the name of the link is shown.
  const RESTS = 200;  // ms
  let resting = null;
  addEventListener("pointermove", (event) => {
    clearTimeout(resting);
    const { target, clientX, clientY, pointerId, buttons } = event;
    if (!event.isTrusted || event.pointerType !== "mouse" || buttons) return;
    if (readOnly || !target.matches?.("canvas[data-engine]")) return;
    const options = {
      clientX, clientY, pointerId, pointerType: "mouse", isPrimary: true, bubbles: true,
      ctrlKey: true, altKey: true, shiftKey: true,
    };
    resting = setTimeout(() => {
      target.dispatchEvent(new PointerEvent("pointerdown", options));
      target.dispatchEvent(new PointerEvent("pointerup", options));
    }, RESTS);
  }, true);
  for (const name of ["pointerdown", "pointerout", "wheel", "blur"]) {
    addEventListener(name, () => clearTimeout(resting), { capture: true, passive: true });
  }

  const PLOT_TIME = "Time in the plots";

  // A press in a plot, or a drag, goes to that time: it is entered into the field below.
  let pressed = null;  // where plots take the mouse

  /** Show the time under the mouse. */
  function goTo(event) {
    const plot = pressed.closest(".uplot");
    const all = Object.values(window.__viserTestpoints?.uplots ?? {});
    const chart = all.find((one) => one.chart.root === plot)?.chart;
    const label = [...document.querySelectorAll("label")]
      .find((one) => one.textContent.trim() === PLOT_TIME);
    const field = document.getElementById(label?.htmlFor);
    if (!chart || !field) return;
    const { left, width } = pressed.getBoundingClientRect();
    const at = chart.posToVal(Math.min(Math.max(event.clientX - left, 0), width), "x");
    enter(field, at.toFixed(3));
  }

  addEventListener("pointerdown", (event) => {
    pressed = event.button ? null : event.target.closest?.(".u-over");
    if (pressed) goTo(event);
  });
  addEventListener("pointermove", (event) => {
    if (!event.buttons) pressed = null;  // it was released outside of the window
    if (pressed) goTo(event);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    addEventListener(name, () => { pressed = null; });
  }

  /** Find the button with these words. */
  function find(words) {
    const buttons = [...document.querySelectorAll("button")];
    return buttons.find((button) => button.textContent.trim() === words);
  }

  /** Press the button with these words. */
  const press = (words) => find(words)?.click();

  // Keys of the list of motions, where nobody types.
  const PRESSED = { n: "Next", p: "Previous", k: "Keep", x: "Exclude" };
  addEventListener("keydown", (event) => {
    const { key, target, ctrlKey, altKey, metaKey } = event;
    const types = target.matches?.("input, textarea, select, [contenteditable]");
    if (types || ctrlKey || altKey || metaKey || !(key in PRESSED)) return;
    if (find("Undecided")) press(PRESSED[key]);  // else there is no list
  });

  // Keys of the page act at this element; further up, viser turns the camera with them.
  document.documentElement.addEventListener("keydown", (event) => {
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") event.stopPropagation();
  });

  window.g1 = { upload, copy, press, toast };
})();
