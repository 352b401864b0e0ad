// Reads nothing but this page; without it the page still shows every table and closer look. Needs player.js and base.js before it.

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

const hiddenMethods = new Set();

function toggleMethod(index) {
  if (!hiddenMethods.delete(index)) hiddenMethods.add(index);
  for (const button of all(`[data-toggles="${index}"]`)) button.ariaPressed = String(!hiddenMethods.has(index));
  for (const series of all(`.chart [data-method="${index}"]`)) series.style.display = hiddenMethods.has(index) ? "none" : "";
}

function showMetric(button) {
  const plot = button.closest(".plot");
  choose(all("[data-shows]", plot), (other) => other === button);
  for (const metric of all(".metric", plot)) metric.classList.toggle("later", metric.dataset.metric !== button.dataset.shows);
}

/** A chart that tells the values of the frame nearest to the pointer, and where the player is. */
class Reader {
  constructor(chart, values, goTo) {
    Object.assign(this, { chart, values, goTo });
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
    chart.addEventListener("click", () => this.choose());
  }

  choose() {
    if (this.place !== null) this.goTo(this.values.frames[this.place]);
  }

  /** Mark the frame that the player shows. */
  follow(frame) {
    this.cursor ??= this.add("cursor");
    this.cursor.style.cssText = `left:${100 * this.across(frame)}%;top:${100 * this.top}%;height:${100 * this.height}%`;
  }

  /** Shade frames that can be played. */
  shade(first, last) {
    const [left, right] = [first, last].map((frame) => between(this.across(frame), this.left, this.left + this.width));
    this.add("shade").style.cssText = `left:${100 * left}%;width:${100 * (right - left)}%;top:${100 * this.top}%;height:${100 * this.height}%`;
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
    const distances = this.values.frames.map((frame) => Math.abs(this.across(frame) - share));
    this.read(distances.indexOf(Math.min(...distances)));
  }

  step(event) {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "Escape") this.clear();
    if (event.key === "Enter") this.choose();
    if (!move) return;
    event.preventDefault();
    this.read(this.place === null ? 0 : between(this.place + move, 0, this.values.frames.length - 1));
  }

  read(place) {
    this.clear();
    this.place = place;
    const key = this.chart.dataset.key;
    const rows = this.values.methods
      .map((method, index) => ({ name: method.name, index, value: method[key][place] }))
      .filter((row) => row.value !== null && !hiddenMethods.has(row.index))
      .sort((one, other) => other.value - one.value);
    const x = this.across(this.values.frames[place]);
    this.add("reads pointer", `left:${100 * x}%;top:${100 * this.top}%;height:${100 * this.height}%`);
    for (const row of rows) {
      const y = this.down(row.value);
      if (y < this.top - 0.01 || y > this.top + this.height + 0.01) continue;
      this.add(`reads point method-${row.index}`, `left:${100 * x}%;top:${100 * y}%`);
    }
    this.tell(x, rows);
  }

  tell(x, rows) {
    const frame = this.values.frames[this.place];
    const box = this.add("reads reading", `top:${100 * this.top}%`);
    box.setAttribute("role", "status");
    const title = document.createElement("b");
    title.textContent = `frame ${frame}` + (this.values.cuts.includes(frame) ? ", across a cut" : this.values.doubtful.includes(frame) ? ", not counted" : "");
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
    box.style.left = `${between(beside, 0, Math.max(0, width - box.offsetWidth))}px`;
  }

  add(names, style = "") {
    const element = document.createElement("div");
    element.className = names;
    element.style.cssText = style;
    this.chart.append(element);
    return element;
  }

  clear() {
    this.place = null;
    for (const element of all(".reads", this.chart)) element.remove();
  }
}

// ---------------------------------------------------------------- clips

/** The sections about one clip, whose player begins when they are shown. */
class Clip {
  constructor(element) {
    this.element = element;
    this.values = JSON.parse(element.querySelector(".values").textContent);
    this.readers = all(".chart[data-key]", element).map((chart) => new Reader(chart, this.values, (frame) => this.goTo(frame)));
    for (const button of all("[data-shows]", element)) {
      button.addEventListener("click", () => (showMetric(button), this.tell()));
    }
    for (const button of all("[data-goes]", element)) button.addEventListener("click", () => this.inspect(...button.dataset.goes.split(" ").map(Number)));
  }

  tell() {
    this.element.dispatchEvent(new CustomEvent("changed", { bubbles: true }));
  }

  get metric() {
    return this.element.querySelector('[data-shows][aria-checked="true"]').dataset.shows;
  }

  set metric(key) {
    const button = this.element.querySelector(`[data-shows="${CSS.escape(key)}"]`);
    if (button) showMetric(button);
  }

  open() {
    if (this.player) return;
    const screen = this.element.querySelector(".player");
    this.player = new Player(screen);
    const passages = Map.groupBy ? [...Map.groupBy(this.player.frames, (frame) => frame.passage).values()] : [];
    if (passages.length > 1) {
      for (const each of passages) for (const reader of this.readers) reader.shade(each[0].number, each.at(-1).number);
    }
    screen.addEventListener("shown", () => {
      for (const reader of this.readers) reader.follow(this.player.frames[this.player.place].number);
    });
    this.blind = new BlindTest(this.element.querySelector(".blind"), this.player);
    this.goTo(this.player.opening);
  }

  /** Show a frame, or the nearest one that can be played. */
  goTo(frame) {
    const distances = this.player.frames.map((each) => Math.abs(each.number - frame));
    const shown = this.player.stepTo(distances.indexOf(Math.min(...distances)));
    const { top, bottom } = this.player.stage.getBoundingClientRect();
    if (bottom < 0 || top > innerHeight) this.player.stage.scrollIntoView({ block: "nearest" });
    return shown;
  }

  async inspect(frame, x, y) {
    await this.goTo(frame);
    this.player.zoomTo(4, { x, y });
    this.player.stage.scrollIntoView({ block: "center" });
  }
}

// ---------------------------------------------------------------- blind test

/** Two methods, drawn by chance, on sides drawn by chance; the page counts which is preferred and tells at the end. */
class BlindTest {
  constructor(element, player) {
    Object.assign(this, { element, player });
    this.named = player.nameOf;
    this.methods = player.names.map((_, view) => view).filter((view) => view && player.names[view] !== "guide");
    const clicks = {
      ".begins": () => this.begin(),
      ".ends": () => this.end(),
      ".truth-too": () => this.showTruth(!this.seesTruth),
      ".copies": (event) => copyText(this.find(".tally"), event.currentTarget),
    };
    for (const [selector, action] of Object.entries(clicks)) this.find(selector).addEventListener("click", action);
    for (const button of all("[data-vote]", element)) button.addEventListener("click", () => this.vote(button.dataset.vote));
    this.find(".begins").hidden = this.methods.length < 2;
  }

  find(selector) {
    return this.element.querySelector(selector);
  }

  get isOn() {
    return this.player.element.classList.contains("is-blind");
  }

  begin() {
    this.rounds = [];
    this.tell([]);
    this.before = { sides: { ...this.player.sides }, place: this.player.place };
    this.player.setMode("wipe");
    this.player.find(".pixel").replaceChildren(); // it may have names
    this.switchTo(true);
    this.draw();
  }

  switchTo(on) {
    this.player.element.classList.toggle("is-blind", on);
    this.player.locked = on;
    this.find(".begins").hidden = on;
    this.find(".votes").hidden = !on;
    this.player.nameOf = on ? (view) => (view === 0 ? "truth" : view === this.pair[0] ? "A" : "B") : this.named;
  }

  /** The next two methods and the next passage. */
  draw() {
    const { player } = this;
    const methods = [...this.methods];
    const first = methods.splice(Math.floor(Math.random() * methods.length), 1)[0];
    this.pair = [first, methods[Math.floor(Math.random() * methods.length)]];
    const passages = [...new Set(player.frames.map((frame) => frame.passage))].filter(
      (passage) => player.frames.filter((frame) => frame.passage === passage).length > 1,
    );
    const passage = passages[Math.floor(Math.random() * passages.length)];
    player.sides = { left: this.pair[0], right: this.pair[1] };
    player.wipe.value = 50;
    this.showTruth(false);
    this.find(".count").textContent = counted(this.rounds.length, "vote");
    player.stepTo(player.frames.findIndex((frame) => frame.passage === passage)).then(() => {
      if (this.isOn && !matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
    });
  }

  /** Show the truth in place of both, or both again. */
  showTruth(on) {
    this.seesTruth = on;
    this.find(".truth-too").ariaPressed = String(on);
    this.player.sides = on ? { left: 0, right: 0 } : { left: this.pair[0], right: this.pair[1] };
    this.player.restyle();
  }

  /** Show lines of text as the result. */
  tell(lines) {
    this.find(".tally").replaceChildren(...lines.map((line) => Object.assign(document.createElement("div"), { textContent: line })));
    Object.assign(this.find(".copies"), { hidden: !lines.length, textContent: "Copy the result" });
  }

  vote(side) {
    this.rounds.push({ pair: this.pair, preferred: { left: this.pair[0], right: this.pair[1] }[side] ?? null });
    this.draw();
  }

  end() {
    this.switchTo(false);
    this.player.pause();
    this.player.sides = this.before.sides;
    this.player.stepTo(this.before.place);
    this.player.restyle();
    const rows = this.player.names.slice(1).map((name, index) => {
      const met = this.rounds.filter((round) => round.pair.includes(index + 1));
      return { name, met: met.length, won: met.filter((round) => round.preferred === index + 1).length };
    });
    rows.sort((one, other) => other.won / (other.met || 1) - one.won / (one.met || 1));
    const undecided = this.rounds.filter((round) => round.preferred === null).length;
    const lines = rows.filter((row) => row.met).map((row) => `${row.name}: preferred in ${row.won} of ${row.met}`);
    const clip = this.element.closest(".clip").dataset.name;
    this.tell([`${clip}: ${counted(this.rounds.length, "vote")}${undecided ? `, ${undecided} without a difference` : ""}`, ...lines]);
  }
}

const counted = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;

// ---------------------------------------------------------------- the address

/** What the page shows, as a part of its address behind #: an address that is copied shows the same. */
class Address {
  constructor(clips) {
    this.clips = clips;
    this.current = 0;
    addEventListener("hashchange", () => this.read());
    for (const name of ["shown", "changed"]) document.addEventListener(name, () => this.write());
    for (const button of all("[data-clip]")) button.addEventListener("click", () => (this.turnTo(+button.dataset.clip), this.write()));
  }

  get clip() {
    return this.clips[this.current];
  }

  turnTo(place) {
    this.clip.player?.pause();
    this.current = place;
    this.clips.forEach((clip, index) => clip.element.classList.toggle("later", index !== place));
    choose(all("[data-clip]"), (button) => +button.dataset.clip === place);
    for (const link of all("[data-section]")) link.hash = link.dataset.section + (place ? `-${place + 1}` : "");
    this.clip.open();
  }

  write() {
    const { player, blind, metric } = this.clip;
    if (!player || player.timer || blind.isOn || this.reads) return;
    const values = {
      ...(this.clips.length > 1 ? { clip: this.current + 1 } : {}),
      frame: player.frames[player.place].number,
      left: player.names[player.sides.left],
      right: player.names[player.sides.right],
      edge: Math.round(player.wipe.value),
      ...(player.mode === "error" ? { error: player.range } : {}),
      ...(player.mode === "boost" ? { boost: 1 } : {}),
      ...(player.zoom ? { zoom: player.zoom, x: Math.round(player.centre.x), y: Math.round(player.centre.y) } : {}),
      metric,
    };
    history.replaceState(null, "", `#${new URLSearchParams(values)}`);
  }

  /** Show what a link leads to, which may lie in a clip that is not shown. */
  showSection(element) {
    const place = this.clips.findIndex((clip) => clip.element.contains(element));
    if (place < 0 || place === this.current) return;
    this.turnTo(place);
    element.scrollIntoView();
  }

  async read() {
    const values = new URLSearchParams(location.hash.slice(1));
    if (this.clip.blind?.isOn) return; // it would tell names
    if (!values.has("frame")) return this.showSection(document.getElementById(location.hash.slice(1)));
    this.reads = true;
    this.turnTo(between((+values.get("clip") || 1) - 1, 0, this.clips.length - 1));
    const { clip } = this;
    const { player } = clip;
    for (const side of ["left", "right"]) {
      const view = player.names.indexOf(values.get(side));
      if (view >= 0) player.sides[side] = view;
    }
    player.wipe.value = values.get("edge") ?? 50;
    player.mode = values.has("error") ? "error" : values.has("boost") ? "boost" : "wipe";
    player.range = +values.get("error") || player.range;
    if (values.has("metric")) clip.metric = values.get("metric");
    await clip.goTo(+values.get("frame"));
    player.zoomTo(+values.get("zoom") || 0, values.has("x") ? { x: +values.get("x"), y: +values.get("y") } : player.centre);
    this.reads = false;
  }
}

for (const button of all(".sort")) button.addEventListener("click", () => sortTable(button.parentElement));
for (const button of all("[data-toggles]")) button.addEventListener("click", () => toggleMethod(+button.dataset.toggles));
const address = new Address(all(".clip").map((element) => new Clip(element)));
address.turnTo(0);
address.read();
