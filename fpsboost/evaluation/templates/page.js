"use strict";
// Reads nothing but this page. Each part below stands alone; without it the page still shows every table and picture.

const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

// ---------------------------------------------------------------- light and dark

function toggleTheme() {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  try {
    localStorage.setItem("fpsboost-theme", root.dataset.theme);
  } catch (error) {
    // a browser that keeps nothing shows it all the same
  }
}

// ---------------------------------------------------------------- tables

function sortTable(heading) {
  const table = heading.closest("table");
  const column = [...heading.parentElement.children].indexOf(heading);
  const best = heading.dataset.best;
  const order = heading.ariaSort === best ? { ascending: "descending", descending: "ascending" }[best] : best;
  for (const other of all("[aria-sort]", table)) other.ariaSort = "none";
  heading.ariaSort = order;
  const sign = order === "ascending" ? 1 : -1;
  const value = (row) => (row.children[column].dataset.value === "" ? Infinity * sign : +row.children[column].dataset.value);
  const body = table.tBodies[0];
  body.append(...[...body.rows].sort((one, other) => sign * (value(one) - value(other))));
}

// ---------------------------------------------------------------- figures

const values = JSON.parse(document.getElementById("values").textContent);
const hiddenMethods = new Set();

function toggleMethod(index) {
  if (!hiddenMethods.delete(index)) hiddenMethods.add(index);
  for (const button of all(`[data-toggles="${index}"]`)) button.ariaPressed = String(!hiddenMethods.has(index));
  for (const series of all(`.chart [data-method="${index}"]`)) series.style.display = hiddenMethods.has(index) ? "none" : "";
}

function showMetric(button) {
  const plot = button.closest(".plot");
  for (const other of all("[data-shows]", plot)) other.ariaPressed = String(other === button);
  for (const metric of all(".metric", plot)) metric.classList.toggle("later", metric.dataset.metric !== button.dataset.shows);
}

/** A chart that tells the values of the frame nearest to the pointer. */
class Reader {
  constructor(chart) {
    this.chart = chart;
    this.place = null;
    [this.left, this.top, this.width, this.height] = chart.dataset.box.split(" ").map(Number);
    this.x = chart.dataset.x.split(" ").map(Number);
    this.y = chart.dataset.y.split(" ").map(Number);
    this.logarithmic = "logarithmic" in chart.dataset;
    chart.addEventListener("pointermove", (event) => this.point(event));
    chart.addEventListener("pointerdown", (event) => this.point(event));
    chart.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && this.clear());
    chart.addEventListener("blur", () => this.clear());
    chart.addEventListener("keydown", (event) => this.step(event));
  }

  across(frame) {
    return this.left + this.width * ((frame - this.x[0]) / (this.x[1] - this.x[0]));
  }

  down(value) {
    const scale = this.logarithmic ? Math.log : (each) => each;
    const [low, high] = this.y.map(scale);
    return this.top + this.height * (1 - (scale(value) - low) / (high - low));
  }

  point(event) {
    const bounds = this.chart.getBoundingClientRect();
    const share = (event.clientX - bounds.left) / bounds.width;
    const distances = values.frames.map((frame) => Math.abs(this.across(frame) - share));
    this.read(distances.indexOf(Math.min(...distances)));
  }

  step(event) {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "Escape") this.clear();
    if (!move) return;
    event.preventDefault();
    this.read(this.place === null ? 0 : clamp(this.place + move, 0, values.frames.length - 1));
  }

  read(place) {
    this.clear();
    this.place = place;
    const key = this.chart.dataset.key;
    const rows = values.methods
      .map((method, index) => ({ name: method.name, index, value: method[key][place] }))
      .filter((row) => row.value !== null && !hiddenMethods.has(row.index))
      .sort((one, other) => other.value - one.value);
    const x = this.across(values.frames[place]);
    this.add("pointer", `left:${100 * x}%;top:${100 * this.top}%;height:${100 * this.height}%`);
    for (const row of rows) {
      const y = this.down(row.value);
      if (y < this.top - 0.01 || y > this.top + this.height + 0.01) continue;
      this.add(`point method-${row.index}`, `left:${100 * x}%;top:${100 * y}%`);
    }
    this.tell(x, rows);
  }

  tell(x, rows) {
    const frame = values.frames[this.place];
    const box = this.add("reading", `top:${100 * this.top}%`);
    box.setAttribute("role", "status");
    const title = document.createElement("b");
    title.textContent = `frame ${frame}` + (values.cuts.includes(frame) ? ", across a cut" : values.doubtful.includes(frame) ? ", not counted" : "");
    const unit = document.createElement("small");
    unit.textContent = ` ${this.chart.dataset.unit}`;
    title.append(unit);
    box.append(title);
    for (const row of rows) {
      const line = document.createElement("div");
      const name = document.createElement("span");
      const legend = document.querySelector(`[data-toggles="${row.index}"] .mark`).cloneNode(true);
      name.className = "method";
      name.append(legend, row.name);
      const value = document.createElement("span");
      value.textContent = row.value.toPrecision(row.value >= 1000 ? 4 : 3);
      line.append(name, value);
      box.append(line);
    }
    // beside the line, where there is more room, and never beyond the figure
    const width = this.chart.clientWidth;
    const beside = x < 0.5 ? x * width + 14 : x * width - 14 - box.offsetWidth;
    box.style.left = `${clamp(beside, 0, Math.max(0, width - box.offsetWidth))}px`;
  }

  add(names, style) {
    const element = document.createElement("div");
    element.className = `mark-on-chart ${names}`;
    element.style.cssText = style;
    this.chart.append(element);
    return element;
  }

  clear() {
    this.place = null;
    for (const element of all(".mark-on-chart", this.chart)) element.remove();
  }
}

// ---------------------------------------------------------------- pictures

/** Two pictures of one frame with an edge between them. */
class Viewer {
  constructor(element) {
    this.element = element;
    this.stage = element.querySelector(".stage");
    this.layers = all(".layer", element);
    this.names = this.layers.map((layer) => layer.querySelector("figcaption").textContent);
    this.sides = { left: 0, right: Math.min(1, this.layers.length - 1) };
    this.wipe = element.querySelector(".wipe");
    this.gain = element.querySelector(".gain");
    for (const chip of all("[data-side]", element)) {
      chip.addEventListener("click", () => this.choose(chip.dataset.side, +chip.dataset.picture));
    }
    this.wipe.addEventListener("input", () => this.show());
    this.gain.addEventListener("input", () => this.show());
    element.querySelector(".flip").addEventListener("click", () => this.flip());
    element.querySelector(".differ").addEventListener("click", () => this.differ());
    element.querySelector(".spots").addEventListener("click", (event) => this.toggleSpots(event.currentTarget));
    this.stage.addEventListener("pointerdown", (event) => this.drag(event));
    this.stage.addEventListener("pointermove", (event) => event.buttons && this.drag(event));
    new ResizeObserver(() => this.show()).observe(this.stage);
    this.stage.addEventListener("keydown", (event) => this.press(event));
    this.show();
  }

  choose(side, picture) {
    if (picture >= this.layers.length) return;
    const other = side === "left" ? "right" : "left";
    if (this.sides[other] === picture) this.sides[other] = this.sides[side];
    this.sides[side] = picture;
    // what was chosen is seen: where the other side fills the frame, the edge jumps
    if (this.wipe.value === (side === "left" ? "0" : "100")) this.wipe.value = side === "left" ? 100 : 0;
    this.show();
  }

  show() {
    const differing = this.element.classList.contains("differing");
    this.layers.forEach((layer, index) => {
      layer.classList.toggle("is-left", index === this.sides.left);
      layer.classList.toggle("is-right", index === this.sides.right);
    });
    for (const chip of all("[data-side]", this.element)) {
      chip.ariaPressed = String(this.sides[chip.dataset.side] === +chip.dataset.picture);
    }
    this.stage.style.setProperty("--wipe", `${this.wipe.value}%`);
    this.stage.style.setProperty("--gain", this.gain.value);
    this.element.querySelector("output").textContent = `${this.gain.value}×`;
    const [left, right] = [this.names[this.sides.left], this.names[this.sides.right]];
    if (differing) this.tag(`difference of ${left} and ${right}, ${this.gain.value}×`, 1, "", 0);
    else this.tag(left, this.wipe.value / 100, right, 1 - this.wipe.value / 100);
  }

  /** Names of the two pictures, each as long as it lies on its own picture; a picture that fills the frame has its name on the left. */
  tag(left, leftShare, right, rightShare) {
    const tags = ["left", "right"].map((side) => this.element.querySelector(`.tag.${side}`));
    const whole = leftShare === 0 || rightShare === 0;
    const [texts, shares] = whole ? [[leftShare ? left : right, ""], [1, 0]] : [[left, right], [leftShare, rightShare]];
    tags.forEach((tag, index) => {
      tag.textContent = texts[index];
      tag.hidden = texts[index] === "";
      tag.style.visibility = whole || tag.offsetWidth + 20 <= shares[index] * this.stage.clientWidth ? "" : "hidden";
    });
  }

  moveTo(per_cent) {
    this.wipe.value = clamp(per_cent, 0, 100);
    this.show();
  }

  drag(event) {
    if (this.element.classList.contains("differing") || !event.isPrimary) return; // two fingers zoom
    const bounds = this.stage.getBoundingClientRect();
    this.stage.setPointerCapture(event.pointerId);
    this.moveTo((100 * (event.clientX - bounds.left)) / bounds.width);
  }

  /** All of the right picture first, then all of the left one, and so on. */
  flip() {
    const whole = this.wipe.value === "0" || this.wipe.value === "100";
    this.moveTo(whole ? 100 - this.wipe.value : 0);
  }

  differ() {
    const on = this.element.classList.toggle("differing");
    this.element.querySelector(".differ").ariaPressed = String(on);
    this.wipe.parentElement.hidden = on;
    this.gain.parentElement.hidden = !on;
    this.show();
  }

  toggleSpots(button) {
    button.ariaPressed = String(!this.element.classList.toggle("spotless"));
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const digit = /^Digit(\d)$/.exec(event.code) || /^Numpad(\d)$/.exec(event.code);
    const actions = {
      ArrowLeft: () => this.moveTo(+this.wipe.value - 2),
      ArrowRight: () => this.moveTo(+this.wipe.value + 2),
      Home: () => this.moveTo(0),
      End: () => this.moveTo(100),
      " ": () => this.flip(),
      d: () => this.differ(),
    };
    const action = digit ? () => this.choose(event.shiftKey ? "left" : "right", +digit[1]) : actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }
}

document.querySelector(".theme").addEventListener("click", toggleTheme);
for (const button of all(".sort")) button.addEventListener("click", () => sortTable(button.parentElement));
for (const button of all("[data-toggles]")) button.addEventListener("click", () => toggleMethod(+button.dataset.toggles));
for (const button of all("[data-shows]")) button.addEventListener("click", () => showMetric(button));
for (const chart of all(".chart[data-key]")) new Reader(chart);
for (const viewer of all(".viewer")) new Viewer(viewer);
