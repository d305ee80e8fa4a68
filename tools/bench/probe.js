// Runs in a page before its own scripts, and notes when what is seen changes.
//
// Each time a function of the page has drawn on the canvas, a small copy of it is read
// back, which waits until it is drawn. Times are those of performance.now() in [ms].
(() => {
  const WIDTH = 320;
  const HEIGHT = 200;
  const DARKER = 16; // of 255, that counts as another pixel
  const probe = (window.g1probe = {
    shots: [], // time and pixels of each picture that differs from the one before
    turns: [], // time and value of each change of the slider that is watched
    frames: 0, // that the browser had since the newest of these
  });
  const small = document.createElement("canvas");
  small.width = WIDTH;
  small.height = HEIGHT;
  const context = small.getContext("2d", { willReadFrequently: true });
  context.globalCompositeOperation = "copy";
  let isDue = false;

  function look(canvas) {
    isDue = false;
    if (!canvas.isConnected) return;
    context.drawImage(canvas, 0, 0, WIDTH, HEIGHT);
    const pixels = context.getImageData(0, 0, WIDTH, HEIGHT).data;
    const [last] = probe.shots.slice(-1);
    // The page draws once a second even if nothing has changed.
    if (last && probe.different(last.pixels, pixels) === 0) return;
    probe.shots.push({ time: performance.now(), pixels });
    probe.frames = 0;
  }

  const prototype = WebGL2RenderingContext.prototype;
  for (const name of [
    "drawElements",
    "drawArrays",
    "drawElementsInstanced",
    "drawArraysInstanced",
  ]) {
    const draw = prototype[name];
    prototype[name] = function (...values) {
      draw.apply(this, values);
      if (!isDue) {
        isDue = true;
        // After all of this drawing, and before the browser takes the picture away.
        queueMicrotask(() => look(this.canvas));
      }
    };
  }

  const count = () => {
    probe.frames += 1;
    requestAnimationFrame(count);
  };
  requestAnimationFrame(count);

  // How many pixels differ between two of the small pictures.
  probe.different = (one, other) => {
    let count = 0;
    for (let i = 0; i < one.length; i += 4) {
      const most = Math.max(
        Math.abs(one[i] - other[i]),
        Math.abs(one[i + 1] - other[i + 1]),
        Math.abs(one[i + 2] - other[i + 2]),
      );
      if (most > DARKER) count += 1;
    }
    return count;
  };

  // Whether nothing has changed for a time.
  probe.rests = (time) => {
    const [last] = probe.shots.slice(-1);
    return Boolean(last) && probe.frames > 2 && performance.now() > last.time + time;
  };

  // Forgets all pictures but the newest.
  probe.forget = () => {
    probe.shots = probe.shots.slice(-1);
    probe.turns = [];
  };

  // When the picture first differed from the oldest one by so many pixels; or null.
  probe.changed = (least) => {
    const [before, ...shots] = probe.shots;
    const found = shots.find((s) => probe.different(before.pixels, s.pixels) >= least);
    return found ? found.time : null;
  };

  // Keeps the newest picture by a name.
  probe.keep = (name) => {
    probe[name] = probe.shots[probe.shots.length - 1].pixels;
  };

  // When the first picture came that shows most of what is on one kept picture, and
  // not on another, as the former shows it; and how many pixels that is.
  probe.seen = (whole, empty) => {
    const parts = (pixels) => probe.different(pixels, probe[empty]);
    const all = parts(probe[whole]);
    const found = probe.shots.find(
      (s) => parts(s.pixels) > 0.9 * all && probe.different(s.pixels, probe[whole]) < 0.1 * all,
    );
    return [found ? found.time : null, all];
  };

  // Notes the values of a slider from now on.
  probe.watch = (slider) => {
    const note = () =>
      probe.turns.push({
        time: performance.now(),
        value: Number(slider.getAttribute("aria-valuenow")),
      });
    new MutationObserver(note).observe(slider, { attributeFilter: ["aria-valuenow"] });
  };

  // When the slider first was near a value; or null.
  probe.turned = (value, near) => {
    const found = probe.turns.find((turn) => Math.abs(turn.value - value) < near);
    return found ? found.time : null;
  };
})();
