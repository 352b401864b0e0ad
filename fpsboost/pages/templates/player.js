"use strict";
/* A player of pictures that belong together: several views of each frame, two of them at a time with an edge between.

   On the page: the macro `player` of player.html.j2 (controls, and the data of `PlayerData` in Python), player.css, this
   file, and then `new Player(document.querySelector(".player"))`, or `new Player(element, data)` with

     { names: ["truth", "nlm"], fps: 24, uris: [uri, uri], frames: [{ number: 7, passage: 0, images: [0, 1] }, ...] }

   `number` is what the frame is called, `passage` tells frames that are played in one go from others. `images` has the
   place in `uris` for each view, or one for all of them; `loss` is the mean error of their compression in levels, 0 if there
   is none, missing if nobody knows; `opening` is the number of the frame that the page shows first. Optional elements of the
   macro may be missing. Methods to call: show(place), play(), pause(), choose(side, view), zoomTo(zoom, centre),
   setMode(mode), restyle() after `nameOf` was replaced. The element gets an event "shown" after each frame that was
   drawn, and "changed" after anything else that the user chose; both bubble. */

const HEAT = ["#000004", "#420a68", "#932667", "#dd513a", "#fca50a", "#fcffa4"];
const BOOST = 4; // by which differences are enlarged
const ZOOMS = [0, 1, 2, 4, 8, 16];

/** Mark the one of several buttons that is chosen; as with radio buttons, the tab key stops at that one alone. */
function choose(buttons, isChosen) {
  const chosen = [...buttons].findIndex(isChosen);
  buttons.forEach((button, place) => {
    button.ariaChecked = String(place === chosen);
    button.tabIndex = place === Math.max(0, chosen) ? 0 : -1;
  });
}

/** Arrow keys choose the next or the previous of such buttons, before a player takes them for its frames. */
document.addEventListener("keydown", (event) => {
  const buttons = [...(event.target.closest("[role=radiogroup]")?.querySelectorAll("[role=radio]") ?? [])];
  const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  if (!by || !buttons.length || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  event.stopPropagation();
  const next = buttons.at((buttons.indexOf(event.target) + by) % buttons.length);
  next.focus();
  next.click();
}, true);

const between = (value, low, high) => Math.min(high, Math.max(low, value));

/** 256 colours, red, green and blue of each, between the stops of the legend. */
const heatColours = (() => {
  const stops = HEAT.map((each) => [1, 3, 5].map((at) => parseInt(each.slice(at, at + 2), 16)));
  return Array.from({ length: 256 }, (_, level) => {
    const place = (level / 255) * (stops.length - 1);
    const low = Math.min(Math.floor(place), stops.length - 2);
    return stops[low].map((value, channel) => value + (stops[low + 1][channel] - value) * (place - low));
  });
})();

class Player {
  constructor(element, data = JSON.parse(element.querySelector(".played").textContent)) {
    this.element = element;
    this.read = new Map();
    this.enlarged = new Map();
    this.decoding = new Map();
    this.take(data);
    this.nameOf = (view) => this.names[view];
    this.stage = element.querySelector(".stage");
    this.canvas = element.querySelector("canvas");
    this.context = this.canvas.getContext("2d");
    this.width = +this.canvas.width;
    this.height = +this.canvas.height;
    this.sides = { left: 0, right: Math.min(1, this.names.length - 1) };
    this.place = 0;
    this.mode = "wipe";
    this.zoom = 0; // 0 fits the picture into its place, others are screen pixels for each of its pixels
    this.centre = { x: this.width / 2, y: this.height / 2 };
    this.speed = 1;
    this.range = 64; // levels at the bright end of the error's colours
    this.fingers = new Map(); // where pointers are that touch the stage
    this.images = [];
    this.listen();
    this.show(0);
  }

  /** Take other frames, which `show` and `restyle` then draw. */
  take({ names, fps, uris, frames, opening }) {
    Object.assign(this, { names, fps, opening });
    this.frames = frames.map((frame) => ({ ...frame, images: frame.images.map((place) => uris[place]) }));
    this.decoding.clear();
    this.read.clear();
    this.enlarged.clear();
  }

  find(selector) {
    return this.element.querySelector(selector);
  }

  listen() {
    const clicks = {
      ".back": () => this.step(-1),
      ".forth": () => this.step(1),
      ".play": () => (this.timer ? this.pause() : this.play()),
      ".slow": () => this.setSpeed(this.speed === 1 ? 0.25 : 1),
      ".flip": () => this.flip(),
    };
    for (const [selector, action] of Object.entries(clicks)) this.find(selector)?.addEventListener("click", action);
    for (const chip of this.element.querySelectorAll("[data-side]")) {
      chip.addEventListener("click", () => this.choose(chip.dataset.side, +chip.dataset.view));
    }
    for (const each of this.element.querySelectorAll("[data-mode]")) {
      each.addEventListener("click", () => this.setMode(each.dataset.mode));
    }
    for (const each of this.element.querySelectorAll("[data-zoom]")) {
      each.addEventListener("click", () => this.zoomTo(+each.dataset.zoom));
    }
    this.seek = this.find(".seek");
    this.seek.max = this.frames.length - 1;
    this.seek.addEventListener("input", () => this.stepTo(+this.seek.value));
    this.wipe = this.find(".wipe");
    this.wipe.addEventListener("input", () => this.restyle());
    this.find(".range")?.addEventListener("change", (event) => this.setRange(+event.target.value));
    this.element.addEventListener("keydown", (event) => this.press(event));
    this.stage.addEventListener("pointerdown", (event) => this.grab(event));
    this.stage.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) this.stage.addEventListener(name, (event) => this.letGo(event));
    this.stage.addEventListener("dblclick", (event) => this.zoomTo(this.larger() ?? 0, this.pixelAt(event)));
    this.stage.addEventListener("wheel", (event) => this.turn(event), { passive: false });
    new ResizeObserver(() => this.fit()).observe(this.stage);
  }

  tell(name) {
    this.element.dispatchEvent(new CustomEvent(name, { bubbles: true }));
  }

  // -------------------------------------------------------------- frames

  /** The decoded pictures of a frame, one for each view. */
  load(place) {
    if (!this.decoding.has(place)) {
      const decoded = this.frames[place].images.map(async (uri) => {
        const image = new Image();
        image.src = uri;
        await image.decode();
        return image;
      });
      this.decoding.set(place, Promise.all(decoded));
    }
    return this.decoding.get(place);
  }

  async show(place) {
    this.place = between(place, 0, this.frames.length - 1);
    const images = await this.load(this.place);
    if (this.place !== place) return; // another frame was asked for meanwhile
    this.images = images;
    this.read.clear();
    this.enlarged.clear();
    for (const next of [place - 1, place + 1]) if (this.frames[next]) this.load(next);
    this.fit();
    this.seek.value = place;
    const text = `frame ${this.frames[place].number}`;
    this.seek.setAttribute("aria-valuetext", text);
    this.find(".place").textContent = text + (this.frames[place].note ? `, ${this.frames[place].note}` : "");
    this.tellLoss(this.frames[place].loss);
    this.tell("shown");
  }

  /** How far the pixels of the page can be trusted. */
  tellLoss(loss) {
    const output = this.find(".loss");
    if (!output || loss === undefined) return;
    output.textContent = loss ? `Compressed: each picture is off by about ${loss} levels.` : "Exact: kept without loss.";
  }

  stepTo(place) {
    this.pause();
    return this.show(between(place, 0, this.frames.length - 1));
  }

  step(by) {
    return this.stepTo(this.place + by);
  }

  /** Play the passage of the current frame, again and again, each frame for its time. */
  async play() {
    const { passage } = this.frames[this.place];
    const places = this.frames.map((_, place) => place).filter((place) => this.frames[place].passage === passage);
    const first = places.indexOf(this.place) + (this.place === places.at(-1) ? 1 : 0);
    this.setPlaying(true);
    await Promise.all(places.map((place) => this.load(place)));
    if (!this.timer) return; // paused meanwhile
    const begin = performance.now();
    const tick = (now) => {
      if (!this.timer) return;
      const count = Math.max(0, Math.floor(((now - begin) / 1000) * this.fps * this.speed));
      const place = places[(first + count) % places.length];
      if (place !== this.place) this.show(place);
      this.timer = requestAnimationFrame(tick);
    };
    this.timer = requestAnimationFrame(tick);
  }

  pause() {
    if (!this.timer) return;
    cancelAnimationFrame(this.timer);
    this.setPlaying(false);
    this.tell("changed");
  }

  setPlaying(on) {
    this.timer = on ? -1 : 0; // until the first tick
    const button = this.find(".play");
    button.ariaLabel = on ? "Pause" : "Play";
    button.classList.toggle("is-playing", on);
  }

  setSpeed(speed) {
    const on = Boolean(this.timer);
    this.pause();
    this.speed = speed;
    this.find(".slow").ariaPressed = String(speed !== 1);
    if (on) this.play();
  }

  // -------------------------------------------------------------- which pictures, and how

  choose(side, view) {
    if (view >= this.names.length || this.locked) return; // while names are hidden, they cannot be chosen
    const other = side === "left" ? "right" : "left";
    if (this.sides[other] === view) this.sides[other] = this.sides[side];
    this.sides[side] = view;
    // what was chosen is seen: where the other side fills the stage, the edge jumps
    if (this.wipe.value === (side === "left" ? "0" : "100")) this.wipe.value = side === "left" ? 100 : 0;
    this.restyle();
    this.tell("changed");
  }

  setMode(mode) {
    if (this.locked) return;
    this.mode = mode;
    this.restyle();
    this.tell("changed");
  }

  setRange(range) {
    this.range = range;
    this.restyle();
    this.tell("changed");
  }

  /** All of the right picture first, then all of the left one, and so on. */
  flip() {
    const whole = this.wipe.value === "0" || this.wipe.value === "100";
    this.wipe.value = whole ? 100 - this.wipe.value : 0;
    this.restyle();
  }

  zoomTo(zoom, centre = this.centre) {
    this.zoom = zoom;
    this.centre = { ...centre };
    this.fit();
    this.restyle();
    this.tell("changed");
  }

  /** Zoom so that a pixel of the picture comes to lie where the pointer is; what would be smaller than the stage fits it. */
  zoomAround(scale, pixel, { clientX, clientY }) {
    const bounds = this.stage.getBoundingClientRect();
    const kept = Math.min(scale, ZOOMS.at(-1));
    const x = pixel.x - (clientX - bounds.left - bounds.width / 2) / kept;
    const y = pixel.y - (clientY - bounds.top - bounds.height / 2) / kept;
    this.zoomTo(kept <= this.fitting() ? 0 : Math.round(100 * kept) / 100, { x, y });
  }

  /** The next zooms that enlarge and reduce what is seen. */
  larger() {
    return ZOOMS.find((zoom) => zoom > this.scale());
  }

  smaller() {
    return ZOOMS.findLast((zoom) => zoom < this.scale() && zoom > this.fitting()) ?? 0;
  }

  // -------------------------------------------------------------- drawing

  fitting() {
    return this.stage.clientWidth / this.width;
  }

  scale() {
    return this.zoom || this.fitting();
  }

  /** Left and top of the whole picture on the stage, and its size there. */
  box() {
    const scale = this.scale();
    const [across, down] = [this.stage.clientWidth, this.stage.clientHeight];
    const kept = (value, size, room) => (size * scale <= room ? size / 2 : between(value, room / scale / 2, size - room / scale / 2));
    this.centre = { x: kept(this.centre.x, this.width, across), y: kept(this.centre.y, this.height, down) };
    return [across / 2 - this.centre.x * scale, down / 2 - this.centre.y * scale, this.width * scale, this.height * scale];
  }

  /** Give the canvas as many pixels as the screen has there. */
  fit() {
    const [width, height] = [this.stage.clientWidth, this.stage.clientHeight].map((each) => Math.round(each * devicePixelRatio));
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.restyle();
  }

  picture(side) {
    return this.images[this.sides[side]] ?? this.images[0];
  }

  restyle() {
    this.stage.style.setProperty("--wipe", `${this.wipe.value}%`);
    this.stage.classList.toggle("is-zoomed", this.zoom > 0);
    this.element.classList.toggle("shows-error", this.mode === "error");
    for (const [side, view] of Object.entries(this.sides)) {
      choose(this.element.querySelectorAll(`[data-side="${side}"]`), (chip) => +chip.dataset.view === view);
    }
    choose(this.element.querySelectorAll("[data-mode]"), ({ dataset }) => dataset.mode === this.mode);
    choose(this.element.querySelectorAll("[data-zoom]"), ({ dataset }) => +dataset.zoom === this.zoom);
    const range = this.find(".range");
    if (range) range.value = this.range;
    this.draw();
    this.tag();
  }

  draw() {
    if (!this.images.length) return;
    const { context, canvas } = this;
    const box = this.box().map((each) => each * devicePixelRatio);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.imageSmoothingEnabled = this.scale() * devicePixelRatio < 2; // larger ones show their pixels
    context.imageSmoothingQuality = "high";
    if (this.mode === "error") return context.drawImage(this.error(), ...box);
    context.drawImage(this.seen("left"), ...box);
    const edge = (canvas.width * this.wipe.value) / 100;
    context.save();
    context.beginPath();
    context.rect(edge, 0, canvas.width - edge, canvas.height);
    context.clip();
    context.clearRect(edge, 0, canvas.width - edge, canvas.height);
    context.drawImage(this.seen("right"), ...box);
    context.restore();
  }

  /** The pixels of a picture, at the size of the first view; kept until another frame is shown. */
  pixels(image) {
    if (!this.read.has(image)) {
      const { naturalWidth: width, naturalHeight: height } = this.images[0]; // a guide may be smaller
      const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
      context.drawImage(image, 0, 0, width, height);
      this.read.set(image, context.getImageData(0, 0, width, height));
    }
    return this.read.get(image);
  }

  seen(side) {
    return this.mode === "boost" ? this.boosted(this.picture(side)) : this.picture(side);
  }

  /** The first view, and a picture's difference from it enlarged; kept until another frame is shown. */
  boosted(image) {
    if (!this.enlarged.has(image)) {
      const [truth, other] = [this.images[0], image].map((each) => this.pixels(each));
      const canvas = new OffscreenCanvas(truth.width, truth.height);
      const drawn = new ImageData(truth.data.map((value, at) => value + BOOST * (other.data[at] - value)), truth.width);
      canvas.getContext("2d").putImageData(drawn, 0, 0);
      this.enlarged.set(image, canvas);
    }
    return this.enlarged.get(image);
  }

  /** The mean absolute difference of the two pictures' channels, as colours. */
  error() {
    const [one, other] = ["left", "right"].map((side) => this.pixels(this.picture(side)));
    const canvas = new OffscreenCanvas(one.width, one.height);
    const found = new ImageData(one.width, one.height);
    const [a, b, out] = [one.data, other.data, found.data];
    for (let at = 0; at < out.length; at += 4) {
      const error = (Math.abs(a[at] - b[at]) + Math.abs(a[at + 1] - b[at + 1]) + Math.abs(a[at + 2] - b[at + 2])) / 3;
      const colour = heatColours[Math.min(255, Math.round((255 * error) / this.range))];
      [out[at], out[at + 1], out[at + 2], out[at + 3]] = [colour[0], colour[1], colour[2], 255];
    }
    canvas.getContext("2d").putImageData(found, 0, 0);
    return canvas;
  }

  /** Names of the two pictures, each as long as it lies on its own picture; one that fills the stage has its name on the left. */
  tag() {
    const tags = ["left", "right"].map((side) => this.find(`.tag.${side}`));
    const names = ["left", "right"].map((side) => this.nameOf(this.sides[side]) + (this.mode === "boost" && this.sides[side] ? `, differences ×${BOOST}` : ""));
    const share = this.wipe.value / 100;
    const whole = this.mode === "error" || share === 0 || share === 1;
    const texts = this.mode === "error" ? [`difference of ${names[0]} and ${names[1]}`, ""] : whole ? [names[share ? 0 : 1], ""] : names;
    tags.forEach((tag, index) => {
      tag.textContent = texts[index];
      tag.hidden = texts[index] === "";
      const room = (index ? 1 - share : share) * this.stage.clientWidth;
      tag.style.visibility = whole || tag.offsetWidth + 20 <= room ? "" : "hidden";
    });
  }

  // -------------------------------------------------------------- pointer and keys

  pixelAt(event) {
    const bounds = this.stage.getBoundingClientRect();
    const [left, top] = this.box();
    return { x: (event.clientX - bounds.left - left) / this.scale(), y: (event.clientY - bounds.top - top) / this.scale() };
  }

  /** A drag moves the edge; in a picture that is larger than the stage it moves the picture, unless it begins at the edge. */
  grab(event) {
    if (event.button) return;
    this.fingers.set(event.pointerId, event);
    if (this.fingers.size > 1) return this.pinch();
    const bounds = this.stage.getBoundingClientRect();
    const edge = bounds.left + (bounds.width * this.wipe.value) / 100;
    const atEdge = this.mode !== "error" && (!this.zoom || Math.abs(event.clientX - edge) < 20);
    this.held = atEdge ? "edge" : this.zoom ? "picture" : null;
    if (this.held) this.stage.setPointerCapture(event.pointerId);
    this.move(event);
  }

  letGo(event) {
    this.fingers.delete(event.pointerId);
    this.held = null;
  }

  /** What two fingers have between them when they begin. */
  pinch() {
    const { middle, distance } = this.span();
    this.held = "fingers";
    this.pinched = { pixel: this.pixelAt(middle), ratio: this.scale() / distance };
  }

  span() {
    const [one, other] = this.fingers.values();
    const middle = { clientX: (one.clientX + other.clientX) / 2, clientY: (one.clientY + other.clientY) / 2 };
    return { middle, distance: Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1 };
  }

  /** The wheel scrolls the page; with the control key, which the pinch of a touch pad brings along, it zooms the picture. */
  turn(event) {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    this.zoomAround(this.scale() * 2 ** (between(-event.deltaY, -100, 100) / 100), this.pixelAt(event), event);
  }

  move(event) {
    const before = this.fingers.get(event.pointerId);
    if (before) this.fingers.set(event.pointerId, event);
    if (this.held === "fingers") {
      const { middle, distance } = this.span();
      return this.zoomAround(this.pinched.ratio * distance, this.pinched.pixel, middle);
    }
    const bounds = this.stage.getBoundingClientRect();
    if (this.held === "edge") {
      this.wipe.value = between((100 * (event.clientX - bounds.left)) / bounds.width, 0, 100);
      this.restyle();
    } else if (this.held === "picture") {
      this.pan((before.clientX - event.clientX) / this.scale(), (before.clientY - event.clientY) / this.scale());
    }
    this.readPixel(this.pixelAt(event));
  }

  pan(dx, dy) {
    this.centre = { x: this.centre.x + dx, y: this.centre.y + dy };
    this.restyle();
    this.tell("changed");
  }

  /** Say what both pictures have in one pixel: red, green, blue, 8-bit values. */
  readPixel(at) {
    const output = this.find(".pixel");
    if (!output || !this.images.length) return;
    const [x, y] = [Math.floor(at.x), Math.floor(at.y)];
    if (x < 0 || y < 0 || x >= this.width || y >= this.height) return;
    const about = this.frames[this.place].loss === 0 ? "" : "about ";
    const parts = ["left", "right"].map((side) => {
      const { data, width, height } = this.pixels(this.picture(side));
      const begin = 4 * (Math.floor((y * height) / this.height) * width + Math.floor((x * width) / this.width));
      const colour = [...data.slice(begin, begin + 3)];
      const swatch = document.createElement("i");
      swatch.style.background = `rgb(${colour})`;
      const text = document.createElement("span");
      text.append(swatch, `${this.nameOf(this.sides[side])} ${about}${colour.join(" ")}`);
      return text;
    });
    const place = document.createElement("span");
    place.textContent = `column ${x}, row ${y}`;
    output.replaceChildren(place, ...parts);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select")) return;
    if (event.key === " " && event.target.closest("button")) return; // presses it
    const digit = /^(?:Digit|Numpad)(\d)$/.exec(event.code);
    const pans = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const actions = {
      ArrowLeft: () => this.step(-1),
      ArrowRight: () => this.step(1),
      Home: () => this.stepTo(0),
      End: () => this.stepTo(this.frames.length - 1),
      " ": () => (this.timer ? this.pause() : this.play()),
      f: () => this.flip(),
      d: () => this.setMode(this.mode === "boost" ? "wipe" : "boost"),
      e: () => this.setMode(this.mode === "error" ? "wipe" : "error"),
      "+": () => this.zoomTo(this.larger() ?? this.zoom),
      "-": () => this.zoomTo(this.smaller()),
    };
    let action = actions[event.key];
    if (digit) action = () => this.choose(event.shiftKey ? "left" : "right", +digit[1]);
    if (pans && event.shiftKey) {
      const stride = 32 / this.scale();
      action = () => (this.pan(pans[0] * stride, pans[1] * stride), this.readPixel(this.centre));
    }
    if (!action || (pans && !event.shiftKey && pans[1])) return;
    event.preventDefault();
    action();
  }
}
