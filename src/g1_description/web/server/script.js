// Spares browsers without a GPU, and keeps the arrow keys from turning the camera.
(() => {
  // Without a GPU a picture takes seconds with shadows and smooth edges: the server
  // leaves out the shadows. Viser's module runs after this script.
  const SOFTWARE = /swiftshader|llvmpipe|softpipe|basic render/i;
  const RESOLUTION = 0.75;  // of the window's pixels
  const make = HTMLCanvasElement.prototype.getContext;

  /** Return whether the browser draws in software. */
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

  // Keys of the page act at this element; further up, viser turns the camera with them.
  document.documentElement.addEventListener("keydown", (event) => {
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") event.stopPropagation();
  });
})();
